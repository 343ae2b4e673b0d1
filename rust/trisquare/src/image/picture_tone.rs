//! What is not known of how a picture was coded, and moves all of its edges.

use nalgebra::Matrix2;

use super::power_curve::{PowerCurve, TONE_PARAMETERS, TonePrior};
use super::tone::{Tone, ToneCurve};

/// How a picture was coded.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum PictureTone {
    /// By this curve.
    Known(Tone),
    /// By a curve that is to be estimated, from this one on.
    Estimated(PowerCurve),
    /// By a curve that is to be estimated but does not quite describe it, as after JPEG: its edges
    /// lie off by a little, as those of [`Shifted`](Self::Shifted) do.
    Approximated(
        PowerCurve,
        #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::stored::positive"))] f64,
    ),
    /// By something that no curve describes: with this one its edges lie off, all by the same
    /// distance towards the dark, which is zero up to the given standard deviation, pixels.
    Shifted(
        PowerCurve,
        #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::stored::positive"))] f64,
    ),
}

impl PictureTone {
    /// The curve to begin with.
    #[must_use]
    pub fn tone(&self) -> Tone {
        match *self {
            Self::Known(tone) => tone,
            Self::Estimated(curve) | Self::Approximated(curve, _) | Self::Shifted(curve, _) => {
                Tone::Power(curve)
            }
        }
    }

    /// Whether the curve is usable, and the deviation positive.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let positive = |std: f64| std > 0.0 && std.is_finite();
        self.tone().is_valid() && self.shift_std().is_none_or(positive)
    }

    /// Standard deviation of the distance by which all edges may lie off, pixels.
    fn shift_std(&self) -> Option<f64> {
        match *self {
            Self::Known(_) | Self::Estimated(_) => None,
            Self::Approximated(_, std) | Self::Shifted(_, std) => Some(std),
        }
    }
}

/// Parameters that the pixels of a picture share: those of its tone curve, the shift, and the
/// kurtosis of its lens's blur.
pub(crate) const PICTURE_PARAMETERS: usize = TONE_PARAMETERS + 2;
pub(crate) const SHIFT: usize = TONE_PARAMETERS;
pub(crate) const KURTOSIS: usize = TONE_PARAMETERS + 1;

/// How far the kurtosis of a lens's blur, over 24, may be from none: a lens out of focus spreads light
/// over a disc (-0.04 of its share's square), one with wings over more.
const KURTOSIS_STD: f64 = 0.004;
/// That as information.
pub(crate) const USUAL_KURTOSIS: f64 = 1.0 / (KURTOSIS_STD * KURTOSIS_STD);

/// What a fit believes of the coding of a picture.
#[derive(Clone)]
pub(crate) struct PictureState {
    given: PictureTone,
    pub curve: ToneCurve,
    /// How far all edges appear moved towards the dark, px.
    pub shift: f64,
    /// What the lens adds to the kurtosis of the pixel's box, over 24.
    pub kurtosis: f64,
    pub kurtosis_role: KurtosisRole,
}

/// What the kurtosis of a lens's blur is to a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum KurtosisRole {
    /// A parameter.
    Estimated,
    /// Held at none, and what one would change is uncertain: the profiles do not quite fit any curve,
    /// as after JPEG, which may be all that is seen of a kurtosis.
    Doubted,
    /// Held at none: only an estimated tone curve, which is not nearly linear, takes the shape of a
    /// symmetric blur for its own.
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

/// Information on a picture's parameters from elsewhere than its pixels, and that times the way to
/// where it points.
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

    /// The same, its kurtosis held where it is estimated: as if all blurs were normal.
    pub fn with_held_kurtosis(mut self) -> Self {
        if self.has_free_kurtosis() {
            self.kurtosis_role = KurtosisRole::Doubted;
        }
        self
    }

    /// The same, its kurtosis estimated where that is doubted.
    pub fn with_free_kurtosis(mut self) -> Self {
        if self.kurtosis_role == KurtosisRole::Doubted {
            self.kurtosis_role = KurtosisRole::Estimated;
        }
        self
    }

    pub fn has_free_kurtosis(&self) -> bool {
        self.kurtosis_role == KurtosisRole::Estimated
    }

    /// By how much the edges may lie off beside an estimated curve (standard deviation, px), where
    /// they may and the curve is one that cameras write: they are likely not to.
    pub fn unlikely_shift(&self) -> Option<f64> {
        let is_usual = |_: &f64| match self.given.tone() {
            Tone::Power(given) => self.has_free_curve() && !given.is_like_linear(),
            _ => false,
        };
        self.given.shift_std().filter(is_usual)
    }

    /// The estimated curve.
    pub fn power(&self) -> Option<PowerCurve> {
        match self.curve.tone() {
            Tone::Power(power) => Some(power),
            _ => None,
        }
    }

    /// What keeps the parameters: usual curves, a small shift, and any at all for what is held and
    /// has no derivatives.
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

/// What a fit found out of the coding of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ToneFit {
    /// The tone curve.
    pub curve: PowerCurve,
    /// Covariance of the logarithm of its gamma, and its toe, where it was estimated.
    pub covariance: Option<Matrix2<f64>>,
    /// How far all edges appeared moved towards the dark, and a standard deviation of that, pixels,
    /// where no curve described them.
    pub shift: Option<(f64, f64)>,
}

impl ToneFit {
    /// Standard deviation of the curve's effective gamma, where it was estimated.
    #[must_use]
    pub fn effective_gamma_std(&self) -> Option<f64> {
        let covariance = self.covariance?;
        Some(self.curve.effective_gamma_std(&covariance))
    }
}
