//! Light of a figure and its ground, and their blur.

use nalgebra::Vector2;

use super::band_pixels::PixelFigure;
use crate::image::{PictureState, TONE_PARAMETERS, Tone};

/// Number of parameters of an exposure: the light's, the blur, and its
/// [differences](BlurDifferences).
pub(crate) const EXPOSURE_PARAMETERS: usize = DIFFERENCES + BLUR_DIFFERENCES;
/// Index of the first of the blur's differences among them.
pub(super) const DIFFERENCES: usize = LIGHT_PARAMETERS + 1;
/// Ground, contrast, and the light's [`Variation`].
pub(super) const LIGHT_PARAMETERS: usize = 2 + VARIATION_PARAMETERS;
/// The four sides' own differences, and the blur's variation.
pub(super) const BLUR_DIFFERENCES: usize = SIDES + VARIATION_PARAMETERS;
pub(super) const SIDES: usize = 4;
pub(super) const VARIATION_PARAMETERS: usize = 3;

/// Approximate mean along an outline of the squared distance from the centre, relative to the
/// square of its box: 1/3 if it fills the box, and less if it is turned.
const SQUARE_OF_OUTLINE: f64 = 0.25;

/// Initial blur (px) of the fit: that of a sharp lens, the pixel's own box included.
const FIRST_BLUR: f64 = 0.8;

/// Minimum blur (px): less is impossible, as it is below that of a pixel's own box.
const MIN_BLUR: f64 = 0.2;

/// Contrast (coded, 1 being white) below which no figure is visible.
const MIN_CONTRAST: f64 = 0.02;

/// Relative variation of a quantity over a figure, as a fraction of its mean along the outline.
///
/// One curvature applies to all directions: a lens darkens and blurs its picture with the square of
/// the distance from the centre.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Variation {
    /// Linear term over the figure's size, in x and y.
    pub gradient: [f64; 2],
    /// Coefficient of the squared distance from the centre, less its mean along an outline.
    pub curvature: f64,
}

impl Variation {
    /// Factor by which the mean is multiplied at a place of the figure.
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

    /// Approximate minimum and maximum of the factor: over the four corners and the centre.
    fn range(&self) -> [f64; 2] {
        let places = [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5], [0.0; 2]];
        let factors = places.map(|place| self.factor(&Vector2::from(place)));
        [f64::min, f64::max].map(|extreme| factors.into_iter().reduce(extreme).unwrap_or(1.0))
    }
}

/// Light of ground and figure, varying over them, and the blur.
///
/// Both share one variation of the light, since the same light falls on paper and ink: two
/// gradients cost some 5 % of the accuracy.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exposure {
    /// `b`, mean along the outline.
    pub ground: f64,
    /// `A`, mean along the outline.
    pub contrast: f64,
    /// Variation of the light.
    pub light: Variation,
    /// `w`, including the pixel's own box, px: the blur without differences.
    pub blur: f64,
    pub differences: BlurDifferences,
}

/// Relative differences of a figure's blur from side to side and over the figure, as fractions of
/// it.
///
/// Away from the centre of a picture a lens blurs radial and tangential edges differently, as does
/// motion of the camera.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct BlurDifferences {
    pub sides: [f64; 4],
    pub variation: Variation,
}

impl BlurDifferences {
    /// All differences, those of the sides first.
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

    /// Approximate minimum and maximum of the factor by which the blur is multiplied along a side.
    fn range(&self) -> [f64; 2] {
        let [lowest, highest] = self.variation.range();
        let [low, high] = [f64::min, f64::max]
            .map(|extreme| self.sides.into_iter().reduce(extreme).unwrap_or(0.0));
        [lowest + low, highest + high]
    }
}

impl Exposure {
    /// Initial exposure from low and high quantiles of the band's pixels; `None` if they differ by
    /// less than `MIN_CONTRAST`.
    pub fn guess(figure: &PixelFigure, tone: Tone) -> Option<Self> {
        let mut all: Vec<f64> = figure.pixels.iter().map(|p| p.value).collect();
        // About half of the band lies on each side.
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
        self.differences
            .sides
            .map(|difference| self.blur * (varied + difference))
    }

    /// Matrix that maps derivatives by a side's own blur, times `1` and the derivatives of a
    /// [`Variation`], to derivatives by blur and differences (a row each).
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

    /// Derivatives of ground and contrast by the parameters of a free tone curve, at constant coded
    /// values of ground and figure.
    ///
    /// Where there is little light, light depends on the curve in a far from linear way, whereas
    /// the coded values hardly change.
    pub fn translation(&self, picture: &PictureState) -> [[f64; 2]; TONE_PARAMETERS] {
        if !picture.has_free_curve() {
            return [[0.0; 2]; TONE_PARAMETERS];
        }
        let [ground, within] = [self.ground, self.ground + self.contrast].map(|light| {
            let (_, slope) = picture.curve.encode_with_slope(light);
            picture
                .curve
                .sensitivity(light)
                .map(|derivative| -derivative / slope)
        });
        std::array::from_fn(|i| [ground[i], within[i] - ground[i]])
    }

    /// The exposure with the same coded values under another tone.
    pub fn translated(&self, from: Tone, to: Tone) -> Self {
        let [ground, within] =
            [self.ground, self.ground + self.contrast].map(|light| to.decode(from.encode(light)));
        Self {
            ground,
            contrast: within - ground,
            ..*self
        }
    }

    /// Whether the blur is large enough, and small enough for the figure's band, to be fitted.
    pub fn is_valid(&self, figure: &PixelFigure) -> bool {
        let valid = MIN_BLUR..=figure.width.widest_blur();
        let mut range = self.differences.range().into_iter();
        range.all(|factor| valid.contains(&(self.blur * factor)))
    }
}
