//! How light or dark a figure and its ground are, and how blurred.

use nalgebra::Vector2;

use super::band_pixels::PixelFigure;
use crate::image::{PictureState, TONE_PARAMETERS, Tone};

/// Parameters of an exposure: ground, contrast, the light's gradient in x and y and its curvature,
/// blur.
pub(crate) const EXPOSURE_PARAMETERS: usize = 6;

/// Blur (px) from which the fit starts: that of a sharp lens with its pixels' own box.
const FIRST_BLUR: f64 = 0.8;

/// A blur (px) below a pixel's own box is none.
const LEAST_BLUR: f64 = 0.2;

/// Contrast (coded, 1 being white) below which there is no figure.
const MIN_CONTRAST: f64 = 0.02;

/// Ground and figure under light that changes over them, and the blur.
///
/// One gradient serves both, since what falls on the paper falls on the ink: two of them cost some
/// 5 % of the accuracy. So does one curvature: a lens darkens its picture by the square of the
/// distance from the middle, alike in all directions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exposure {
    /// `b` at the figure's middle.
    pub ground: f64,
    /// `A` at the figure's middle.
    pub contrast: f64,
    /// Relative change of the light over the figure's size, in x and y.
    pub gradient: [f64; 2],
    /// The same with the square of the distance from the figure's middle.
    pub curvature: f64,
    /// `w`, the pixel's own box included, px.
    pub blur: f64,
}

impl Exposure {
    /// From low and high quantiles of the band's pixels; `None` where they do not differ
    /// the right way round.
    pub fn guess(figure: &PixelFigure, tone: Tone) -> Option<Self> {
        let mut all: Vec<f64> = figure.pixels.iter().map(|p| p.value).collect();
        // About half of the band lies on either side.
        let mut quantile = |part: f64| {
            let index = (all.len() as f64 * part) as usize;
            (!all.is_empty()).then(|| *all.select_nth_unstable_by(index, f64::total_cmp).1)
        };
        let (low, high) = (quantile(0.2)?, quantile(0.8)?);
        if high - low < MIN_CONTRAST {
            return None;
        }
        let (within, ground) = if figure.dark_inside {
            (low, high)
        } else {
            (high, low)
        };
        let (within, ground) = (tone.decode(within), tone.decode(ground));
        Some(Self {
            ground,
            contrast: within - ground,
            gradient: [0.0; 2],
            curvature: 0.0,
            blur: FIRST_BLUR,
        })
    }

    /// How much light falls on a place of the figure, 1 at its middle.
    pub fn light(&self, place: &Vector2<f64>) -> f64 {
        let linear = self.gradient[0] * place.x + self.gradient[1] * place.y;
        1.0 + linear + self.curvature * place.norm_squared()
    }

    /// The exposure after a step.
    pub fn moved(&self, step: &[f64]) -> Self {
        Self {
            ground: self.ground + step[0],
            contrast: self.contrast + step[1],
            gradient: [self.gradient[0] + step[2], self.gradient[1] + step[3]],
            curvature: self.curvature + step[4],
            blur: self.blur + step[5],
        }
    }

    /// Derivatives of ground and contrast by the parameters of a free tone curve, while ground and
    /// figure stay coded as they are.
    ///
    /// What a change of the curve does to them is far from linear where there is little light;
    /// how they are coded hardly changes.
    pub fn translation(&self, picture: &PictureState) -> [[f64; 2]; TONE_PARAMETERS] {
        if !picture.has_free_curve() {
            return [[0.0; 2]; TONE_PARAMETERS];
        }
        let [ground, within] = [self.ground, self.ground + self.contrast].map(|light| {
            let (_, slope) = picture.curve.encode_with_slope(light);
            picture.curve.sensitivity(light).map(|by| -by / slope)
        });
        std::array::from_fn(|i| [ground[i], within[i] - ground[i]])
    }

    /// The exposure that another tone codes alike.
    pub fn translated(&self, from: Tone, to: Tone) -> Self {
        let [ground, within] =
            [self.ground, self.ground + self.contrast].map(|light| to.decode(from.encode(light)));
        Self {
            ground,
            contrast: within - ground,
            ..*self
        }
    }

    /// Whether the blur is one that can be fitted to a figure's pixels.
    pub fn is_valid(&self, figure: &PixelFigure) -> bool {
        (LEAST_BLUR..=figure.width.widest_blur()).contains(&self.blur)
    }
}
