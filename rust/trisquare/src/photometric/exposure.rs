//! How light or dark a figure and its ground are, and how blurred.

use nalgebra::Vector2;

use super::band_pixels::PixelFigure;
use crate::image::{PictureState, TONE_PARAMETERS, Tone};

/// Parameters of an exposure: the light's, the blur, and its [differences](BlurDifferences).
pub(crate) const EXPOSURE_PARAMETERS: usize = DIFFERENCES + BLUR_DIFFERENCES;
/// The first of the blur's differences among them.
pub(super) const DIFFERENCES: usize = LIGHT_PARAMETERS + 1;
/// Ground, contrast, and the light's [`Variation`].
pub(super) const LIGHT_PARAMETERS: usize = 2 + VARIATION_PARAMETERS;
/// The sides' own, and the blur's variation.
pub(super) const BLUR_DIFFERENCES: usize = SIDES + VARIATION_PARAMETERS;
pub(super) const SIDES: usize = 4;
pub(super) const VARIATION_PARAMETERS: usize = 3;

/// The square of the distance from the middle along an outline, in the mean: 1/3 where it fills its
/// box, and less where it is turned.
const SQUARE_OF_OUTLINE: f64 = 0.25;

/// Blur (px) from which the fit starts: that of a sharp lens with its pixels' own box.
const FIRST_BLUR: f64 = 0.8;

/// A blur (px) below a pixel's own box is none.
const MIN_BLUR: f64 = 0.2;

/// Contrast (coded, 1 being white) below which there is no figure.
const MIN_CONTRAST: f64 = 0.02;

/// How something changes over a figure, in parts of its mean along the outline.
///
/// One curvature serves all directions: a lens darkens and blurs its picture by the square of the
/// distance from the middle.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Variation {
    /// Over the figure's size, in x and y.
    pub gradient: [f64; 2],
    /// With the square of the distance from the middle, less what it is along an outline.
    pub curvature: f64,
}

impl Variation {
    /// By what the mean is multiplied at a place of the figure.
    #[inline]
    pub fn factor(&self, place: &Vector2<f64>) -> f64 {
        let [x, y, square] = Self::wrt_parameters(place);
        1.0 + self.gradient[0] * x + self.gradient[1] * y + self.curvature * square
    }

    /// Derivatives of the factor.
    #[inline]
    pub fn wrt_parameters(place: &Vector2<f64>) -> [f64; VARIATION_PARAMETERS] {
        [place.x, place.y, place.norm_squared() - SQUARE_OF_OUTLINE]
    }

    fn moved(&self, step: &[f64]) -> Self {
        Self {
            gradient: [self.gradient[0] + step[0], self.gradient[1] + step[1]],
            curvature: self.curvature + step[2],
        }
    }

    /// The least and the greatest factor, nearly: at the corners of all places and in the middle.
    fn range(&self) -> [f64; 2] {
        let places = [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5], [0.0; 2]];
        let factors = places.map(|place| self.factor(&Vector2::from(place)));
        [f64::min, f64::max].map(|extreme| factors.into_iter().reduce(extreme).unwrap_or(1.0))
    }
}

/// Ground and figure under light that changes over them, and the blur.
///
/// The light has one variation, since what falls on the paper falls on the ink: two gradients cost
/// some 5 % of the accuracy.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exposure {
    /// `b`, in the mean along the outline.
    pub ground: f64,
    /// `A`, likewise.
    pub contrast: f64,
    /// Of the light.
    pub light: Variation,
    /// `w`, the pixel's own box included, px: what it would be without differences.
    pub blur: f64,
    pub differences: BlurDifferences,
}

/// By what parts of a figure's blur it differs from side to side and over the figure.
///
/// Off the middle of a picture a lens blurs edges along a radius and across it differently, as does a
/// motion of the camera.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct BlurDifferences {
    pub sides: [f64; 4],
    pub variation: Variation,
}

impl BlurDifferences {
    /// The differences, the sides' first.
    pub fn all(&self) -> [f64; BLUR_DIFFERENCES] {
        let [a, b, c, d] = self.sides;
        let Variation {
            gradient: [x, y],
            curvature,
        } = self.variation;
        [a, b, c, d, x, y, curvature]
    }

    fn moved(&self, step: &[f64]) -> Self {
        Self {
            sides: std::array::from_fn(|i| self.sides[i] + step[i]),
            variation: self.variation.moved(&step[SIDES..]),
        }
    }

    /// What the blur is multiplied by along a side, nearly the least and the greatest.
    fn range(&self) -> [f64; 2] {
        let [least, greatest] = self.variation.range();
        let [low, high] = [f64::min, f64::max]
            .map(|extreme| self.sides.into_iter().reduce(extreme).unwrap_or(0.0));
        [least + low, greatest + high]
    }
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
            light: Variation::default(),
            blur: FIRST_BLUR,
            differences: BlurDifferences::default(),
        })
    }

    /// The blur across each side at a place of the figure, px.
    #[inline]
    pub fn blurs(&self, place: &Vector2<f64>) -> [f64; 4] {
        let varied = self.differences.variation.factor(place);
        self.differences.sides.map(|own| self.blur * (varied + own))
    }

    /// Derivatives by blur and differences, by those of a side's own blur times `1` and the
    /// derivatives of a [`Variation`].
    pub fn blur_jacobian(
        &self,
        side: usize,
    ) -> [[f64; 1 + VARIATION_PARAMETERS]; 1 + BLUR_DIFFERENCES] {
        let BlurDifferences { sides, variation } = self.differences;
        let [x, y] = variation.gradient;
        let mut jacobian = [[0.0; 1 + VARIATION_PARAMETERS]; 1 + BLUR_DIFFERENCES];
        jacobian[0] = [1.0 + sides[side], x, y, variation.curvature];
        jacobian[1 + side][0] = self.blur;
        for (k, row) in jacobian[1 + SIDES..].iter_mut().enumerate() {
            row[1 + k] = self.blur;
        }
        jacobian
    }

    /// The widest blur over the figure, px.
    pub fn widest_blur(&self) -> f64 {
        self.blur * self.differences.range()[1]
    }

    /// The exposure after a step.
    pub fn moved(&self, step: &[f64]) -> Self {
        Self {
            ground: self.ground + step[0],
            contrast: self.contrast + step[1],
            light: self.light.moved(&step[2..]),
            blur: self.blur + step[LIGHT_PARAMETERS],
            differences: self.differences.moved(&step[DIFFERENCES..]),
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
        let valid = MIN_BLUR..=figure.width.widest_blur();
        let mut range = self.differences.range().into_iter();
        range.all(|factor| valid.contains(&(self.blur * factor)))
    }
}
