//! Models of OpenCV's rational and thin prism lenses: the coefficients that are estimated.

use super::{BrownModel, Columns, DistortionModel, INTRINSICS};

/// Index of `p1` among the coefficients: after `k1` to `k6`.
const TANGENTIAL: usize = 6;

/// Number of coefficients up to `p2`: `k1` to `k6`, `p1`, `p2`.
const RATIONAL: usize = 8;

/// Number of coefficients up to `s4`.
const THIN_PRISM: usize = 12;

/// The models of a lens that has the first coefficients of OpenCV's model.
///
/// All models of Brown's lens are nested in them: with `k4` to `k6` and `s1` to `s4` at zero the
/// lenses are the same.
pub trait OpenCvModel: DistortionModel {
    /// Number of coefficients of the lens.
    const COEFFICIENTS: usize;

    /// The richest of Brown's models that is nested in this one.
    fn brown(self) -> BrownModel;
}

/// The coefficients of a [`Rational`](super::Rational) lens that are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum RationalModel {
    /// The coefficients of Brown's lens.
    Brown(BrownModel),
    /// `k1` to `k6`, `p1, p2`.
    Rational,
}

/// The coefficients of a [`ThinPrism`](super::ThinPrism) lens that are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ThinPrismModel {
    /// The coefficients of Brown's lens.
    Brown(BrownModel),
    /// `k1, k2, k3, p1, p2`, `s1` to `s4`.
    BrownPrism,
    /// All: `k1` to `k6`, `p1, p2`, `s1` to `s4`.
    ThinPrism,
}

impl ThinPrismModel {
    /// Models with tangential terms, the poorer first, without the richest.
    pub(crate) const TANGENTIAL: [Self; 2] = [Self::Brown(BrownModel::Brown), Self::BrownPrism];
}

impl Default for RationalModel {
    fn default() -> Self {
        Self::Brown(BrownModel::default())
    }
}

impl Default for ThinPrismModel {
    fn default() -> Self {
        Self::Brown(BrownModel::default())
    }
}

impl DistortionModel for RationalModel {
    const NESTED: &'static [Self] = &[
        Self::Brown(BrownModel::None),
        Self::Brown(BrownModel::Radial1),
        Self::Brown(BrownModel::Radial2),
        Self::Brown(BrownModel::Radial3),
        Self::Brown(BrownModel::Brown),
        Self::Rational,
    ];

    fn columns(self) -> Columns {
        match self {
            Self::Brown(model) => columns_of(model),
            Self::Rational => Columns::of(INTRINSICS..INTRINSICS + RATIONAL),
        }
    }

    fn straightening_coefficients(self) -> usize {
        self.brown().straightening_coefficients()
    }

    fn name(self) -> String {
        match self {
            Self::Brown(model) => model.name(),
            Self::Rational => "rational".into(),
        }
    }
}

impl DistortionModel for ThinPrismModel {
    const NESTED: &'static [Self] = &[
        Self::Brown(BrownModel::None),
        Self::Brown(BrownModel::Radial1),
        Self::Brown(BrownModel::Radial2),
        Self::Brown(BrownModel::Radial3),
        Self::Brown(BrownModel::Brown),
        Self::BrownPrism,
        Self::ThinPrism,
    ];

    fn columns(self) -> Columns {
        match self {
            Self::Brown(model) => columns_of(model),
            Self::BrownPrism => {
                let brown = columns_of(BrownModel::Brown).iter();
                Columns::of(brown.chain(INTRINSICS + RATIONAL..INTRINSICS + THIN_PRISM))
            }
            Self::ThinPrism => Columns::of(INTRINSICS..INTRINSICS + THIN_PRISM),
        }
    }

    fn straightening_coefficients(self) -> usize {
        self.brown().straightening_coefficients()
    }

    fn name(self) -> String {
        match self {
            Self::Brown(model) => model.name(),
            Self::BrownPrism => "brown_prism".into(),
            Self::ThinPrism => "thin_prism".into(),
        }
    }
}

impl OpenCvModel for RationalModel {
    const COEFFICIENTS: usize = RATIONAL;

    fn brown(self) -> BrownModel {
        match self {
            Self::Brown(model) => model,
            Self::Rational => BrownModel::Brown,
        }
    }
}

impl OpenCvModel for ThinPrismModel {
    const COEFFICIENTS: usize = THIN_PRISM;

    fn brown(self) -> BrownModel {
        match self {
            Self::Brown(model) => model,
            Self::BrownPrism | Self::ThinPrism => BrownModel::Brown,
        }
    }
}

/// Returns the columns of Brown's coefficients in these lenses.
fn columns_of(model: BrownModel) -> Columns {
    let radial = INTRINSICS..INTRINSICS + model.radial_coefficients();
    let tangential = INTRINSICS + TANGENTIAL..INTRINSICS + RATIONAL;
    match model {
        BrownModel::Brown => Columns::of(radial.chain(tangential)),
        _ => Columns::of(radial),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Lens, Rational, ThinPrism};
    use super::*;

    fn names<L: Lens>(model: L::Model) -> Vec<&'static str> {
        let columns = model.columns().iter();
        columns.map(|column| L::parameter_names()[column]).collect()
    }

    #[test]
    fn models_have_the_coefficients_that_they_name() {
        let rational = names::<Rational>(RationalModel::Rational);
        assert_eq!(rational.join(" "), "k1 k2 k3 k4 k5 k6 p1 p2");
        let prism = names::<ThinPrism>(ThinPrismModel::BrownPrism);
        assert_eq!(prism.join(" "), "k1 k2 k3 p1 p2 s1 s2 s3 s4");
        let all = names::<ThinPrism>(ThinPrismModel::ThinPrism);
        assert_eq!(all.join(" "), "k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4");
        let radial = names::<Rational>(RationalModel::default());
        assert_eq!(radial, ["k1", "k2"]);
    }

    #[test]
    fn each_model_is_nested_in_the_next() {
        for pair in ThinPrismModel::NESTED.windows(2) {
            let extra = pair[0].columns().without(pair[1].columns());
            assert_eq!(extra, Columns::NONE, "{pair:?}");
        }
        let poorer = ThinPrismModel::ThinPrism.poorer();
        assert_eq!(poorer, Some(ThinPrismModel::BrownPrism));
        let poorer = RationalModel::Rational.poorer();
        assert_eq!(poorer, Some(RationalModel::Brown(BrownModel::Brown)));
    }
}
