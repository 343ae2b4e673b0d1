//! Models of Brown's lens: the coefficients that are estimated.

use super::{Columns, DistortionModel, INTRINSICS};

/// The coefficients of a [`Brown`](super::Brown) lens that are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum BrownModel {
    /// None: a pinhole.
    None,
    /// `k1`.
    Radial1,
    /// `k1, k2`.
    #[default]
    Radial2,
    /// `k1, k2, k3`.
    Radial3,
    /// `k1, k2, k3, p1, p2`.
    Brown,
}

impl BrownModel {
    /// Number of radial coefficients.
    pub fn radial_coefficients(self) -> usize {
        match self {
            BrownModel::None => 0,
            BrownModel::Radial1 => 1,
            BrownModel::Radial2 => 2,
            BrownModel::Radial3 | BrownModel::Brown => 3,
        }
    }
}

impl DistortionModel for BrownModel {
    const NESTED: &'static [Self] = &[
        BrownModel::None,
        BrownModel::Radial1,
        BrownModel::Radial2,
        BrownModel::Radial3,
        BrownModel::Brown,
    ];

    fn columns(self) -> Columns {
        let tangential = if self == BrownModel::Brown { 2 } else { 0 };
        Columns::of(INTRINSICS..INTRINSICS + self.radial_coefficients() + tangential)
    }

    fn straightening_coefficients(self) -> usize {
        self.radial_coefficients().min(2)
    }
}
