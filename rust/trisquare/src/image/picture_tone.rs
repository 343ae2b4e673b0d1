//! Unknowns in the coding of a picture that displace all of its edges.

use nalgebra::Matrix2;

use super::power_curve::{PowerCurve, TONE_PARAMETERS, TonePrior};
use super::tone::{Tone, ToneCurve};

/// How the coding of a picture is known or estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum PictureTone {
    /// The curve is known.
    Known(Tone),
    /// The curve is estimated, from this initial curve.
    Estimated(PowerCurve),
    /// The curve is estimated from this initial curve, but does not quite describe the coding, as
    /// after JPEG: its edges are displaced a little, as for [`Shifted`](Self::Shifted).
    Approximated(
        PowerCurve,
        #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::stored::positive"))] f64,
    ),
    /// No curve describes the coding. With this curve all edges are displaced towards the dark by
    /// the same distance, with mean zero and the given standard deviation in pixels.
    Shifted(
        PowerCurve,
        #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::stored::positive"))] f64,
    ),
}

impl PictureTone {
    /// The given or initial curve.
    #[must_use]
    pub fn tone(&self) -> Tone {
        match *self {
            Self::Known(tone) => tone,
            Self::Estimated(curve) | Self::Approximated(curve, _) | Self::Shifted(curve, _) => {
                Tone::Power(curve)
            }
        }
    }

    /// Whether the curve is usable, and the standard deviation positive.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let is_positive = |std: f64| std > 0.0 && std.is_finite();
        self.tone().is_valid() && self.shift_std().is_none_or(is_positive)
    }

    /// Prior standard deviation of the common displacement of all edges, pixels.
    fn shift_std(&self) -> Option<f64> {
        match *self {
            Self::Known(_) | Self::Estimated(_) => None,
            Self::Approximated(_, std) | Self::Shifted(_, std) => Some(std),
        }
    }
}

/// Number of parameters that the pixels of a picture share: those of its tone curve, the shift, and
/// the kurtosis of its lens's blur.
pub(crate) const PICTURE_PARAMETERS: usize = TONE_PARAMETERS + 2;
pub(crate) const SHIFT: usize = TONE_PARAMETERS;
pub(crate) const KURTOSIS: usize = TONE_PARAMETERS + 1;

/// Prior standard deviation of the kurtosis of a lens's blur, over 24. A lens out of focus spreads
/// light over a disc (-0.04 times the square of its share of the variance), one with wings over
/// more.
const KURTOSIS_STD: f64 = 0.004;
/// Prior information on that kurtosis.
pub(crate) const USUAL_KURTOSIS: f64 = 1.0 / (KURTOSIS_STD * KURTOSIS_STD);

/// Current values in a fit of how a picture was coded.
#[derive(Clone)]
pub(crate) struct PictureState {
    given: PictureTone,
    pub curve: ToneCurve,
    /// Common apparent displacement of all edges towards the dark, px.
    pub shift: f64,
    /// Kurtosis of the lens's blur, over 24, in addition to that of the pixel's box.
    pub kurtosis: f64,
    pub kurtosis_role: KurtosisRole,
}

/// Role of the kurtosis of a lens's blur in a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum KurtosisRole {
    /// A parameter of the fit.
    Estimated,
    /// Held at zero, with an uncertainty for its effect. The profiles do not quite fit any curve,
    /// as after JPEG, and an apparent kurtosis may be no more than that misfit.
    Doubted,
    /// Held at zero. Only an estimate of a tone curve that is not nearly linear would absorb the
    /// shape of a symmetric blur.
    Irrelevant,
}

impl KurtosisRole {
    fn of(given: PictureTone) -> Self {
        if given.tone().power().is_like_linear() {
            return Self::Irrelevant;
        }
        match given {
            PictureTone::Estimated(_) => Self::Estimated,
            PictureTone::Approximated(..) => Self::Doubted,
            PictureTone::Known(_) | PictureTone::Shifted(..) => Self::Irrelevant,
        }
    }
}

/// Prior information on a picture's parameters, and its product with the differences from the
/// parameters to the prior's means.
pub(crate) struct PicturePrior {
    pub information: [f64; PICTURE_PARAMETERS],
    pub gradient: [f64; PICTURE_PARAMETERS],
}

impl PictureState {
    pub fn of(given: PictureTone) -> Self {
        Self {
            given,
            curve: given.tone().curve(),
            shift: 0.0,
            kurtosis: 0.0,
            kurtosis_role: KurtosisRole::of(given),
        }
    }

    pub fn has_free_curve(&self) -> bool {
        use PictureTone::{Approximated, Estimated};
        matches!(self.given, Estimated(_) | Approximated(..))
    }

    pub fn has_free_shift(&self) -> bool {
        self.given.shift_std().is_some()
    }

    /// The same state with an estimated kurtosis held, as if all blurs were normal.
    pub fn with_held_kurtosis(mut self) -> Self {
        if self.has_free_kurtosis() {
            self.kurtosis_role = KurtosisRole::Doubted;
        }
        self
    }

    /// The same state with a doubted kurtosis estimated.
    pub fn with_free_kurtosis(mut self) -> Self {
        if self.kurtosis_role == KurtosisRole::Doubted {
            self.kurtosis_role = KurtosisRole::Estimated;
        }
        self
    }

    pub fn has_free_kurtosis(&self) -> bool {
        self.kurtosis_role == KurtosisRole::Estimated
    }

    /// Standard deviation (px) of the displacement of all edges beside an estimated curve, if there
    /// may be one and the curve is one that cameras write. In that case it is probably zero.
    pub fn unlikely_shift(&self) -> Option<f64> {
        let is_usual = |_: &f64| match self.given.tone() {
            Tone::Power(given) => self.has_free_curve() && !given.is_like_linear(),
            _ => false,
        };
        self.given.shift_std().filter(is_usual)
    }

    /// The curve, if it is of the estimated family.
    pub fn power(&self) -> Option<PowerCurve> {
        match self.curve.tone() {
            Tone::Power(power) => Some(power),
            _ => None,
        }
    }

    /// The prior on the parameters: usual curves and a small shift. Parameters that are held have
    /// no derivatives, and get unit information.
    pub fn prior(&self) -> PicturePrior {
        let mut prior = PicturePrior {
            information: [1.0; PICTURE_PARAMETERS],
            gradient: [0.0; PICTURE_PARAMETERS],
        };
        if let Some(power) = self.power().filter(|_| self.has_free_curve()) {
            let usual = TonePrior::at(&power);
            prior.information[..TONE_PARAMETERS].copy_from_slice(&usual.information);
            prior.gradient[..TONE_PARAMETERS].copy_from_slice(&usual.gradient);
        }
        if let Some(std) = self.given.shift_std() {
            let information = 1.0 / (std * std);
            prior.information[SHIFT] = information;
            prior.gradient[SHIFT] = -information * self.shift;
        }
        if self.has_free_kurtosis() {
            prior.information[KURTOSIS] = USUAL_KURTOSIS;
            prior.gradient[KURTOSIS] = -USUAL_KURTOSIS * self.kurtosis;
        }
        prior
    }

    pub fn moved(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        if let Some(power) = self.power().filter(|_| self.has_free_curve()) {
            next.curve = Tone::Power(power.moved(&[step[0], step[1]])).curve();
        }
        if self.has_free_shift() {
            next.shift += step[SHIFT];
        }
        if self.has_free_kurtosis() {
            next.kurtosis += step[KURTOSIS];
        }
        next
    }
}

/// Estimate of how a picture was coded.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ToneFit {
    /// The tone curve.
    pub curve: PowerCurve,
    /// Covariance of the logarithm of gamma and of the toe, if they were estimated.
    pub covariance: Option<Matrix2<f64>>,
    /// Common apparent displacement of all edges towards the dark and its standard deviation,
    /// pixels, if no curve described them.
    pub shift: Option<(f64, f64)>,
}

impl ToneFit {
    /// Standard deviation of the curve's effective gamma, if it was estimated.
    #[must_use]
    pub fn effective_gamma_std(&self) -> Option<f64> {
        let covariance = self.covariance?;
        Some(self.curve.effective_gamma_std(&covariance))
    }
}
