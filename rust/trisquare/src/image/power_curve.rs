//! A family of tone curves that includes the common ones, for pictures whose own curve is unknown.

use nalgebra::{Matrix2, Vector2};

#[cfg(feature = "serde")]
use crate::error::Error;

/// Light below which a pure gamma curve is continued along its tangent, as its slope has no limit
/// at black; with gamma 2.2 that affects only the lowest 3 of 255 levels.
pub(crate) const GAMMA_FLOOR: f64 = 1.0 / (1 << FLOOR_OCTAVES) as f64;

pub(crate) const FLOOR_OCTAVES: u32 = 14;

/// Derivatives of a coded value with respect to a [`PowerCurve`]'s parameters: the logarithm of its
/// gamma, and its toe.
pub type Sensitivity = [f64; TONE_PARAMETERS];

/// Number of parameters of a [`PowerCurve`].
pub(crate) const TONE_PARAMETERS: usize = 2;

/// Light of a mid-grey, for comparing curves: 18 %, the photographers' grey card.
const MID_GREY: f64 = 0.18;

/// Mean of the prior on curves: cameras write gammas of about 2 within a factor of 1.6, and toes
/// between zero and twice sRGB's. The prior moves no estimate from a picture with three large
/// squares by as much as a fifth of its standard deviation; it decides where the edges do not
/// determine the curve.
pub(crate) const USUAL: PowerCurve = PowerCurve {
    gamma: 2.1,
    toe: 0.02,
};
const USUAL_STD: Sensitivity = [0.5, 0.02];

/// sRGB, to within 5e-5 of white.
pub(crate) const SRGB: PowerCurve = PowerCurve {
    gamma: 2.4,
    toe: 0.055 / 1.4,
};

/// Effective gamma below which an estimated curve is that of linear light, or of a picture that was
/// blurred or enlarged after it was coded.
const LINEAR_GAMMA: f64 = 1.3;

/// Range of an estimated gamma: no camera writes others, though noise may lead to them.
const GAMMA_RANGE: [f64; 2] = [0.5, 3.5];

/// The prior on curves, at a given curve.
pub(crate) struct TonePrior {
    /// Information on the logarithm of gamma, and on the toe.
    pub information: Sensitivity,
    /// Information times the difference from the curve to [`USUAL`].
    pub gradient: Sensitivity,
}

impl TonePrior {
    pub fn at(curve: &PowerCurve) -> Self {
        let difference = [(USUAL.gamma / curve.gamma).ln(), USUAL.toe - curve.toe];
        let information = USUAL_STD.map(|std| 1.0 / (std * std));
        Self {
            information,
            gradient: std::array::from_fn(|i| information[i] * difference[i]),
        }
    }
}

/// `coded = (1 + o) linear^(1 / gamma) - o` with the offset `o = toe (gamma - 1)`, and a straight
/// line through black that is tangent to it.
///
/// sRGB is (2.4, 0.039), BT.709 (2.22, 0.081); a pure gamma has no toe, and with gamma 1 the toe
/// has no effect. A pure gamma does not suffice for sRGB: fitted to blurred edges between levels 40
/// and 215 it misplaces them by 0.02 to 0.04 px, although it misses no pixel by more than 0.15
/// levels. With the wrong kind of curve among these two, the error of an edge is as large as the
/// uncertainty from the noise of a whole picture.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PowerCurve {
    /// The exponent's inverse; positive.
    pub gamma: f64,
    /// The offset per unit of gamma above 1.
    pub toe: f64,
}

#[cfg(feature = "serde")]
crate::stored::read_checked!(PowerCurve {
    gamma: f64,
    toe: f64,
});

/// The point of the power part where a tangent touches it.
#[derive(Clone, Copy)]
struct Tangent {
    /// Light.
    at: f64,
    /// `at^(1 / gamma)`.
    power: f64,
    /// Whether this is the knee, which moves with the parameters.
    is_knee: bool,
}

impl PowerCurve {
    /// Checks that the curve is usable.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if it is not.
    #[cfg(feature = "serde")]
    fn check(&self) -> Result<(), Error> {
        match self.is_valid() {
            true => Ok(()),
            false => Err(Error::InvalidArgument(format!(
                "a power curve has a positive, finite gamma and a finite toe above -1 / (gamma - 1): \
                 not gamma {}, toe {}",
                self.gamma, self.toe
            ))),
        }
    }

    pub(crate) fn is_valid(&self) -> bool {
        self.gamma > 0.0 && self.gamma.is_finite() && self.toe.is_finite() && self.offset() > -1.0
    }

    /// The pure gamma that gives mid-grey the same coded value: 2.2 for sRGB.
    #[must_use]
    pub fn effective_gamma(&self) -> f64 {
        MID_GREY.ln() / self.encode_with_slope(MID_GREY).0.ln()
    }

    /// Whether the curve is closer to linear light than any usual one.
    pub(crate) fn is_like_linear(&self) -> bool {
        self.effective_gamma() < LINEAR_GAMMA
    }

    /// Derivatives of the effective gamma's logarithm with respect to the parameters.
    pub(crate) fn effective_gamma_sensitivity(&self) -> Sensitivity {
        let coded = self.encode_with_slope(MID_GREY).0;
        self.sensitivity(MID_GREY)
            .map(|derivative| -derivative / (coded * coded.ln()))
    }

    /// Standard deviation of the effective gamma, given the covariance of the parameters.
    pub(crate) fn effective_gamma_std(&self, covariance: &Matrix2<f64>) -> f64 {
        let sensitivity = Vector2::from(self.effective_gamma_sensitivity());
        self.effective_gamma() * sensitivity.dot(&(covariance * sensitivity)).sqrt()
    }

    /// The curve with its parameters, the logarithm of gamma and the toe, moved by a step.
    pub(crate) fn moved(&self, step: &Sensitivity) -> Self {
        Self {
            gamma: (self.gamma * step[0].exp()).clamp(GAMMA_RANGE[0], GAMMA_RANGE[1]),
            toe: self.toe + step[1],
        }
    }

    fn offset(&self) -> f64 {
        self.toe * (self.gamma - 1.0)
    }

    /// The light below which the curve is straight: its tangent at the knee passes through black.
    pub(crate) fn knee(&self) -> f64 {
        self.tangent_at(0.0).at
    }

    /// The tangent that passes through black.
    fn knee_tangent(&self) -> Tangent {
        // At the knee the value is the slope times the light: gamma (1 + o) power - gamma o = (1 +
        // o) power.
        let power = (self.toe * self.gamma / (1.0 + self.offset())).clamp(0.0, 1.0);
        Tangent {
            at: power.powf(self.gamma),
            power,
            is_knee: power < 1.0,
        }
    }

    /// The point of the power part whose tangent is used at a light: the light itself, except on
    /// the straight pieces below the knee and beyond 1.
    fn tangent_at(&self, linear: f64) -> Tangent {
        self.tangent_with_knee(self.knee_tangent(), linear)
    }

    fn tangent_with_knee(&self, knee: Tangent, linear: f64) -> Tangent {
        if linear <= knee.at && knee.at > GAMMA_FLOOR {
            return knee;
        }
        let at = linear.clamp(GAMMA_FLOOR, 1.0);
        Tangent {
            at,
            power: at.powf(1.0 / self.gamma),
            is_knee: false,
        }
    }

    pub(crate) fn encode_with_slope(&self, linear: f64) -> (f64, f64) {
        self.encode_from(self.tangent_at(linear), linear)
    }

    /// Values and derivatives of the curve at some lights, and the derivatives of the values with
    /// respect to the parameters.
    pub(crate) fn tabulated(
        &self,
        lights: impl Iterator<Item = f64>,
    ) -> (Vec<(f64, f64)>, Vec<Sensitivity>) {
        let knee = self.knee_tangent();
        let value_and_sensitivity = |light: f64| {
            let tangent = self.tangent_with_knee(knee, light);
            (
                self.encode_from(tangent, light),
                self.sensitivity_from(tangent, light),
            )
        };
        lights.map(value_and_sensitivity).unzip()
    }

    fn encode_from(&self, tangent: Tangent, linear: f64) -> (f64, f64) {
        let scaled = (1.0 + self.offset()) * tangent.power;
        let slope = scaled / (self.gamma * tangent.at);
        let value = scaled - self.offset() + slope * (linear - tangent.at);
        (value, slope)
    }

    /// The light of a coded value between the knee's value and 1.
    pub(crate) fn decode_power(&self, coded: f64) -> f64 {
        ((coded + self.offset()) / (1.0 + self.offset())).powf(self.gamma)
    }

    /// Derivatives of the coded value with respect to the parameters.
    pub(crate) fn sensitivity(&self, linear: f64) -> Sensitivity {
        self.sensitivity_from(self.tangent_at(linear), linear)
    }

    fn sensitivity_from(&self, tangent: Tangent, linear: f64) -> Sensitivity {
        let Tangent { at, power, is_knee } = tangent;
        let (gamma, scale) = (self.gamma, 1.0 + self.offset());
        let slope = scale * power / (gamma * at);
        let excess = linear - at;
        // Derivatives of the offset, and of the logarithms of the power at constant light and of
        // the slope.
        let offset = [self.toe * gamma, gamma - 1.0];
        let log_power = [-power.ln(), 0.0];
        let log_slope = [offset[0] / scale + log_power[0] - 1.0, offset[1] / scale];
        // A change of the knee changes the slope of its tangent.
        let by_log_knee = slope * (1.0 / gamma - 1.0) * excess;
        let log_knee = [
            gamma * (power.ln() + 1.0 - power),
            gamma * (1.0 / self.toe - offset[1] / scale),
        ];
        std::array::from_fn(|i| {
            let fixed = offset[i] * (power - 1.0)
                + scale * power * log_power[i]
                + slope * log_slope[i] * excess;
            if is_knee {
                fixed + by_log_knee * log_knee[i]
            } else {
                fixed
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tone::Tone;
    use super::*;

    #[test]
    fn the_standard_curves_belong_to_the_family() {
        for step in 0..1000 {
            let light = f64::from(step) / 900.0;
            let srgb = SRGB.encode_with_slope(light).0;
            // The standard rounds its knee, which changes its toe by up to 4e-5.
            assert!((srgb - Tone::Srgb.encode(light)).abs() < 5e-5, "{light}");
            let pure = PowerCurve {
                gamma: 1.8,
                toe: 0.0,
            };
            let gamma = pure.encode_with_slope(light).0;
            assert!((gamma - Tone::Gamma(1.8).encode(light)).abs() < 1e-12);
            let linear = PowerCurve {
                gamma: 1.0,
                toe: 0.05,
            };
            assert!((linear.encode_with_slope(light).0 - light).abs() < 1e-12);
        }
        assert!((SRGB.effective_gamma() - 2.2).abs() < 0.03);
    }

    #[test]
    fn sensitivities_agree_with_central_differences() {
        let curves = [
            SRGB,
            PowerCurve {
                gamma: 2.2,
                toe: 0.0,
            },
            PowerCurve {
                gamma: 1.3,
                toe: 0.05,
            },
            PowerCurve {
                gamma: 1.0,
                toe: 0.02,
            },
            PowerCurve {
                gamma: 0.8,
                toe: -0.03,
            },
        ];
        for curve in curves {
            // Near black, on the toe, on the power part, and beyond white.
            for light in [-0.01, 0.0011, 0.0023, 0.01, 0.18, 0.7, 1.2] {
                let sensitivity = curve.sensitivity(light);
                for i in 0..TONE_PARAMETERS {
                    let h = 1e-6;
                    let mut step = [0.0; TONE_PARAMETERS];
                    step[i] = h;
                    let up = curve.moved(&step).encode_with_slope(light).0;
                    step[i] = -h;
                    let down = curve.moved(&step).encode_with_slope(light).0;
                    let expected = (up - down) / (2.0 * h);
                    assert!(
                        (sensitivity[i] - expected).abs() < 1e-5 * expected.abs().max(1.0),
                        "{curve:?} {light} {i}: {} {expected}",
                        sensitivity[i]
                    );
                    let table = Tone::Power(curve).curve().sensitivity(light)[i];
                    assert!(
                        (table - sensitivity[i]).abs() < 2e-3,
                        "{curve:?} {light} {i}"
                    );
                }
            }
        }
        let sensitivity = SRGB.effective_gamma_sensitivity();
        for i in 0..TONE_PARAMETERS {
            let mut step = [0.0; TONE_PARAMETERS];
            step[i] = 1e-6;
            let up = SRGB.moved(&step).effective_gamma().ln();
            step[i] = -1e-6;
            let expected = (up - SRGB.moved(&step).effective_gamma().ln()) / 2e-6;
            assert!((sensitivity[i] - expected).abs() < 1e-6);
        }
    }
}
