//! Tone curves: the mapping from light to the values of a file.
//!
//! All values are normalised: 0 is black and 1 is the largest value the file can hold.

use super::power_curve::{FLOOR_OCTAVES, GAMMA_FLOOR, PowerCurve, SRGB, Sensitivity};

/// The curve `g` from light to the value written in the picture, `coded = g(linear)`.
///
/// Every curve continues along its tangent below a small floor and beyond 1, so that noise never
/// leaves its domain and its slope is always positive and finite.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Tone {
    /// Values proportional to light.
    Linear,
    /// The piecewise curve of IEC 61966-2-1.
    Srgb,
    /// `coded = linear^(1 / gamma)`, `gamma` positive.
    Gamma(#[cfg_attr(feature = "serde", serde(deserialize_with = "crate::stored::positive"))] f64),
    /// An offset power curve, which may be only approximately known: see [`PowerCurve`].
    Power(PowerCurve),
}

/// Light below which the sRGB curve is a straight line.
const SRGB_KNEE: f64 = 0.003_130_8;
const SRGB_SLOPE: f64 = 12.92;
const SRGB_EXPONENT: f64 = 1.0 / 2.4;
const SRGB_SCALE: f64 = 1.055;

impl Tone {
    /// Whether the curve is usable: a gamma must be positive and finite.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match *self {
            Self::Gamma(gamma) => gamma > 0.0 && gamma.is_finite(),
            Self::Power(power) => power.is_valid(),
            _ => true,
        }
    }

    /// The coded value for an amount of light.
    #[must_use]
    pub fn encode(&self, linear: f64) -> f64 {
        self.encode_with_slope(linear).0
    }

    /// [`encode`](Self::encode) together with its derivative.
    #[must_use]
    pub fn encode_with_slope(&self, linear: f64) -> (f64, f64) {
        match *self {
            Self::Linear => (linear, 1.0),
            Self::Srgb if linear <= SRGB_KNEE => (SRGB_SLOPE * linear, SRGB_SLOPE),
            Self::Srgb => {
                let clamped = linear.min(1.0);
                let power = SRGB_SCALE * clamped.powf(SRGB_EXPONENT);
                let slope = SRGB_EXPONENT * power / clamped;
                let coded = power - (SRGB_SCALE - 1.0) + slope * (linear - clamped);
                (coded, slope)
            }
            Self::Gamma(gamma) => {
                let clamped = linear.clamp(GAMMA_FLOOR, 1.0);
                let power = clamped.powf(1.0 / gamma);
                let slope = power / (gamma * clamped);
                (power + slope * (linear - clamped), slope)
            }
            Self::Power(power) => power.encode_with_slope(linear),
        }
    }

    /// The light of a coded value, the inverse of [`encode`](Self::encode).
    #[must_use]
    pub fn decode(&self, coded: f64) -> f64 {
        let knee = match *self {
            Self::Linear => return coded,
            Self::Srgb => SRGB_KNEE,
            Self::Gamma(_) => GAMMA_FLOOR,
            Self::Power(power) => power.knee(),
        };
        let (dark_coded, dark_slope) = self.encode_with_slope(knee);
        if coded <= dark_coded {
            return knee + (coded - dark_coded) / dark_slope;
        }
        if coded >= 1.0 {
            return 1.0 + (coded - 1.0) / self.encode_with_slope(1.0).1;
        }
        match *self {
            Self::Gamma(gamma) => coded.powf(gamma),
            Self::Power(power) => power.decode_power(coded),
            _ => ((coded + SRGB_SCALE - 1.0) / SRGB_SCALE).powf(1.0 / SRGB_EXPONENT),
        }
    }

    /// The equivalent curve of the two-parameter family; for sRGB, to within 5e-5 of white.
    pub(crate) fn power(&self) -> PowerCurve {
        match *self {
            Self::Linear => PowerCurve {
                gamma: 1.0,
                toe: 0.0,
            },
            Self::Srgb => SRGB,
            Self::Gamma(gamma) => PowerCurve { gamma, toe: 0.0 },
            Self::Power(power) => power,
        }
    }

    /// The curve, tabulated for fast evaluation in loops over pixels.
    #[must_use]
    pub fn curve(&self) -> ToneCurve {
        ToneCurve::new(*self)
    }
}

/// A [`Tone`] tabulated for loops over pixels: value and slope take some nanoseconds.
///
/// Cubic Hermite cells, 16 per octave, so that the error is relative: below 1e-7 of the value (at
/// the knee of sRGB, where the slope jumps, an absolute 5e-6, a thousandth of an 8-bit level).
#[derive(Debug, Clone)]
pub struct ToneCurve {
    tone: Tone,
    cells: Vec<Cell>,
    /// Derivatives with respect to the curve's parameters at the cells' ends; only for a
    /// [`PowerCurve`].
    sensitivities: Vec<Sensitivity>,
}

/// A cubic in the fraction of a cell, and the number of cells of its width per unit of light.
#[derive(Debug, Clone, Copy)]
struct Cell {
    cubic: [f64; 4],
    per_unit: f64,
}

const CELLS_PER_OCTAVE_LOG2: u32 = 4;
/// Number of bits of an f64 below those that give the cell's index.
const FRACTION_BITS: u32 = f64::MANTISSA_DIGITS - 1 - CELLS_PER_OCTAVE_LOG2;
const FRACTION_MASK: u64 = (1 << FRACTION_BITS) - 1;
const FRACTION_STEP: f64 = 1.0 / (1_u64 << FRACTION_BITS) as f64;
const FIRST_CELL: u64 = GAMMA_FLOOR.to_bits() >> FRACTION_BITS;
const CELL_COUNT: u64 = (FLOOR_OCTAVES << CELLS_PER_OCTAVE_LOG2) as u64;

impl ToneCurve {
    fn new(tone: Tone) -> Self {
        let count = if tone == Tone::Linear { 0 } else { CELL_COUNT };
        let lights = (0..=count).map(|index| f64::from_bits((FIRST_CELL + index) << FRACTION_BITS));
        let (values, sensitivities) = match tone {
            Tone::Power(power) => power.tabulated(lights.clone()),
            _ => {
                let values = lights.clone().map(|light| tone.encode_with_slope(light));
                (values.collect(), Vec::new())
            }
        };
        let ends = lights.clone().zip(lights.skip(1));
        let cells = ends
            .zip(values.windows(2))
            .map(|((start, end), values)| Cell::hermite(end - start, [values[0], values[1]]));
        Self {
            tone,
            cells: cells.collect(),
            sensitivities,
        }
    }

    /// The tabulated curve.
    #[must_use]
    pub fn tone(&self) -> Tone {
        self.tone
    }

    /// Value and derivative of the curve.
    #[inline]
    #[must_use]
    pub fn encode_with_slope(&self, linear: f64) -> (f64, f64) {
        if self.cells.is_empty() {
            return (linear, 1.0);
        }
        // The bits of a negative number are larger than those of any cell, so that it takes the
        // exact path.
        let bits = linear.to_bits();
        let index = (bits >> FRACTION_BITS).wrapping_sub(FIRST_CELL) as usize;
        match self.cells.get(index) {
            Some(cell) => cell.value_and_slope((bits & FRACTION_MASK) as f64 * FRACTION_STEP),
            None => self.tone.encode_with_slope(linear),
        }
    }

    /// Derivatives of the coded value with respect to the parameters of a [`PowerCurve`], zero for
    /// other curves; accurate to a thousandth, which suffices for a Jacobian.
    #[inline]
    #[must_use]
    pub fn sensitivity(&self, linear: f64) -> Sensitivity {
        let Tone::Power(power) = self.tone else {
            return Sensitivity::default();
        };
        let bits = linear.to_bits();
        let index = (bits >> FRACTION_BITS).wrapping_sub(FIRST_CELL) as usize;
        match self.sensitivities.get(index..index.saturating_add(2)) {
            Some([start, end]) => {
                let fraction = (bits & FRACTION_MASK) as f64 * FRACTION_STEP;
                std::array::from_fn(|i| start[i] + fraction * (end[i] - start[i]))
            }
            _ => power.sensitivity(linear),
        }
    }
}

impl Cell {
    /// A cell of the given width, from the value and slope at both ends.
    fn hermite(width: f64, [(value, slope), (end_value, end_slope)]: [(f64, f64); 2]) -> Self {
        let (change, slope, end_slope) = (end_value - value, slope * width, end_slope * width);
        Self {
            cubic: [
                value,
                slope,
                3.0 * change - 2.0 * slope - end_slope,
                slope + end_slope - 2.0 * change,
            ],
            per_unit: 1.0 / width,
        }
    }

    #[inline]
    fn value_and_slope(&self, fraction: f64) -> (f64, f64) {
        let [c0, c1, c2, c3] = self.cubic;
        let value = c0 + fraction * (c1 + fraction * (c2 + fraction * c3));
        let slope = c1 + fraction * (2.0 * c2 + fraction * 3.0 * c3);
        (value, slope * self.per_unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TONES: [Tone; 6] = [
        Tone::Linear,
        Tone::Srgb,
        Tone::Gamma(2.2),
        Tone::Gamma(0.8),
        Tone::Power(PowerCurve {
            gamma: 2.3,
            toe: 0.03,
        }),
        Tone::Power(PowerCurve {
            gamma: 1.1,
            toe: -0.01,
        }),
    ];

    fn lights() -> impl Iterator<Item = f64> {
        (-200..1400).map(|step| f64::from(step) * 1e-3 + 1.3e-5)
    }

    #[test]
    fn srgb_has_the_standard_values() {
        // Values of the standard's formula, computed by hand.
        assert!((Tone::Srgb.encode(0.5) - 0.735_356_983_052_449_4).abs() < 1e-12);
        assert!((Tone::Srgb.encode(0.002) - 0.025_84).abs() < 1e-12);
        assert!((Tone::Srgb.encode(1.0) - 1.0).abs() < 1e-12);
        assert!((Tone::Gamma(2.0).encode(0.25) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn decoding_undoes_encoding_everywhere() {
        for tone in TONES {
            for light in lights() {
                let back = tone.decode(tone.encode(light));
                // The two branches of the standard differ by 3e-8 at the knee.
                assert!((back - light).abs() < 1e-8, "{tone:?} at {light}: {back}");
            }
        }
    }

    #[test]
    fn slopes_are_derivatives_positive_and_finite() {
        let step = 1e-7;
        for tone in TONES {
            for light in lights() {
                let (_, slope) = tone.encode_with_slope(light);
                let difference = tone.encode(light + step) - tone.encode(light - step);
                assert!(slope > 0.0 && slope.is_finite());
                assert!((slope - difference / (2.0 * step)).abs() < 2e-3 * slope);
            }
        }
    }

    #[test]
    fn the_table_follows_the_curve() {
        for tone in TONES {
            let curve = tone.curve();
            for light in lights().chain((1..2000).map(|step| f64::from(step) * 1e-5)) {
                let (value, slope) = tone.encode_with_slope(light);
                let (fast, fast_slope) = curve.encode_with_slope(light);
                let knee = match tone {
                    Tone::Srgb => (light - SRGB_KNEE).abs() < 2e-4,
                    Tone::Power(power) => (light / power.knee() - 1.0).abs() < 0.1,
                    _ => false,
                };
                let tolerance = if knee { 5e-6 } else { 1e-7 };
                assert!((fast - value).abs() < tolerance, "{tone:?} at {light}");
                assert!(knee || (fast_slope - slope).abs() < 1e-4 * slope);
            }
        }
    }

    #[test]
    fn only_a_positive_gamma_is_valid() {
        assert!(Tone::Srgb.is_valid() && Tone::Gamma(2.2).is_valid());
        assert!(!Tone::Gamma(0.0).is_valid() && !Tone::Gamma(f64::NAN).is_valid());
    }
}
