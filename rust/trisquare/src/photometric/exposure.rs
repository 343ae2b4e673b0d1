//! How light or dark a figure and its ground are, and how blurred.

use nalgebra::Vector2;

use crate::Tone;
use crate::photometric::band::PixelFigure;

/// Parameters of an exposure: three of the ground, three of the contrast, the blur.
pub(crate) const EXPOSURE_PARAMETERS: usize = 7;

/// Blur (px) from which the fit starts: that of a sharp lens with its pixels' own box.
const FIRST_BLUR: f64 = 0.8;

/// Blurs that the pixels' reach can hold.
const BLUR_RANGE: std::ops::RangeInclusive<f64> = 0.2..=2.5;

/// Contrast (coded, 1 being white) below which there is no figure.
const MIN_CONTRAST: f64 = 0.02;

/// Light of the ground and the figure's contrast to it, both linear over the figure, and blur.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exposure {
    /// `b`: constant, and change over the figure's width and height.
    pub ground: [f64; 3],
    /// `A`: the same.
    pub contrast: [f64; 3],
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
            ground: [ground, 0.0, 0.0],
            contrast: [within - ground, 0.0, 0.0],
            blur: FIRST_BLUR,
        })
    }

    /// Ground and contrast at a place of the figure.
    pub fn at(&self, place: &Vector2<f64>) -> (f64, f64) {
        let value = |[constant, x, y]: [f64; 3]| constant + x * place.x + y * place.y;
        (value(self.ground), value(self.contrast))
    }

    /// The exposure after a step.
    pub fn moved(&self, step: &[f64]) -> Self {
        let mut next = *self;
        for i in 0..3 {
            next.ground[i] += step[i];
            next.contrast[i] += step[3 + i];
        }
        next.blur += step[6];
        next
    }

    /// Whether the blur is one that can be fitted.
    pub fn is_valid(&self) -> bool {
        BLUR_RANGE.contains(&self.blur)
    }
}
