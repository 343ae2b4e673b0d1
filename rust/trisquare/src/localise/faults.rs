//! Faults of a picture as a whole, found from the profiles of its edges.

use nalgebra::Vector2;

use super::motion::{self, MotionBlur};
use super::parts::{self, ColourDisplacements, PartDisplacement};
use super::pattern::pattern;
use super::preview::Preview;
use super::span::NoEdge;
use crate::image::{GreyReader, Picture};
use crate::numeric::median;

/// Number of standard deviations above which a displacement is significant.
const MIN_DEVIATIONS: f64 = 6.0;
/// Displacement (px) above which it matters: of odd rows, and of a colour in the picture's corners.
const MIN_ROW_SHIFT: f64 = 0.1;
const MIN_COLOUR_SHIFT: f64 = 0.1;
/// Contrast in green, as a fraction of the largest, below which green is not measured by itself.
const MIN_GREEN: f64 = 0.5;

/// Fraction of a side's light pixels above which it is clipped if they are.
const CLIPPED_SHARE: f64 = 0.1;
/// Errors from extrapolating a clipped step, of each side and common to all, in blurs, for a rise
/// that is half clipped: from rendered scenes, with and without blooming.
const CLIPPED_ERROR: f64 = 0.04;
const CLIPPED_COMMON_ERROR: f64 = 0.1;
/// Error of each side in a picture of two levels, px: half a pixel, averaged over the steps of its
/// staircase.
const TWO_LEVEL_ERROR: f64 = 0.03;
/// Light, as a fraction of white, below which a level does not show how much light falls there.
const MIN_LIGHT: f64 = 1e-3;
/// Error of a side from the unknown shape of the motion blur, as a fraction of the motion's length.
const MOTION_ERROR: f64 = 0.001;

/// Faults of a picture, as found from the profiles of its edges.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct PictureFaults {
    /// Fraction of the sides whose light is clipped.
    pub clipped: f64,
    /// Whether all pixels are black or white.
    pub has_two_levels: bool,
    /// Displacement of the odd rows against the even ones.
    pub rows: Option<PartDisplacement>,
    /// Displacements of the colours, for a picture in colour.
    pub colours: Option<ColourDisplacements>,
    /// The camera's motion while the shutter was open.
    pub motion: Option<MotionBlur>,
    /// Median of the sides' blurs, one standard deviation, px.
    pub blur: f64,
    /// Amplitude of a fine pattern over the picture, as a fraction of the sides' contrast.
    pub pattern: Option<f64>,
    /// Standard deviation of the light over the sides, as a fraction of its mean.
    pub light_spread: f64,
    /// Standard deviation of each side's position due to these faults, px.
    pub side_error: f64,
    /// Same for a board's lines, along which light and dark alternate: no tone curve shifts them.
    pub line_error: f64,
    /// Standard deviation of the error common to all sides, towards the dark, px.
    pub common_error: f64,
}

impl PictureFaults {
    pub(super) fn of(reader: &GreyReader<'_>, previews: &[Result<Preview, NoEdge>]) -> Self {
        let found = || previews.iter().flatten();
        let clipped = found().filter(|preview| is_clipped(preview)).count();
        let has_two_levels = reader.picture().has_two_levels();
        let motion = motion::blur(found());
        let clipping = mean_square(found().map(|preview| clipped_blurs(reader, preview))).sqrt();
        let level_error = if has_two_levels {
            TWO_LEVEL_ERROR
        } else {
            CLIPPED_ERROR * clipping
        };
        let motion_error = motion.map_or(0.0, |motion| MOTION_ERROR * motion.length);
        let side_error = level_error.hypot(motion_error);
        Self {
            motion,
            blur: median(found().map(|preview| preview.side.mean_blur()).collect()).unwrap_or(0.0),
            pattern: pattern(reader, found()),
            light_spread: light_spread(found().map(|preview| preview.side.plateaus())),
            side_error,
            line_error: side_error,
            common_error: CLIPPED_COMMON_ERROR * clipping,
            clipped: clipped as f64 / found().count().max(1) as f64,
            has_two_levels,
            rows: parts::rows(reader, found()),
            colours: parts::colours(reader, found()),
        }
    }

    /// Displacement of the odd rows against the even ones, pixels, if it matters.
    #[must_use]
    pub fn row_shift(&self) -> Option<Vector2<f64>> {
        // In a picture of two levels the staircases may differ from row to row.
        let rows = self.rows.filter(|_| !self.has_two_levels)?;
        let matters = rows.shift_deviations > MIN_DEVIATIONS && rows.shift.norm() > MIN_ROW_SHIFT;
        matters.then_some(rows.shift)
    }

    /// Outward displacement of blue and of red in the corners of the measured picture, pixels, if
    /// it matters.
    #[must_use]
    pub fn colour_shift(&self, picture: &Picture) -> Option<[f64; 2]> {
        let colours = self.colours?;
        let corner = 0.5 * (picture.width() as f64).hypot(picture.height() as f64);
        let parts = [colours.blue, colours.red];
        let is_certain = |part: &PartDisplacement| {
            part.magnification.abs() > MIN_DEVIATIONS * part.magnification_std
        };
        let shift = parts.map(|part| corner * part.magnification);
        let matters = shift.iter().any(|shift| shift.abs() > MIN_COLOUR_SHIFT);
        (parts.iter().any(is_certain) && matters).then_some(shift)
    }

    /// The picture to measure instead of this one: its even rows if the odd ones are displaced, its
    /// green light if the lens magnifies the colours differently, unless the targets hardly show in
    /// green. `None` if this picture itself is to be measured, as it has been.
    #[must_use]
    pub fn mended(&self, picture: &Picture) -> Option<Picture> {
        let green = match self.is_of_green(picture) {
            true => picture.of_green(),
            false => None,
        };
        match self.row_shift() {
            Some(_) => Some(green.as_ref().unwrap_or(picture).of_even_rows()),
            None => green,
        }
    }

    /// Whether [`mended`](Self::mended) returns green light.
    #[must_use]
    pub fn is_of_green(&self, picture: &Picture) -> bool {
        let is_visible = self
            .colours
            .is_some_and(|colours| colours.green_contrast > MIN_GREEN);
        is_visible && self.colour_shift(picture).is_some()
    }
}

fn is_clipped(preview: &Preview) -> bool {
    let (mut clipped, mut light) = (0.0, 0.0);
    for (pixel, p) in preview.pixels.iter().zip(&preview.predictions) {
        if p.blurs * preview.side.contrast[0] * pixel.flip.slope > 0.0 {
            light += pixel.count;
            clipped += pixel.count * f64::from(u8::from(pixel.is_clipped));
        }
    }
    clipped > CLIPPED_SHARE * light
}

/// The blur of a side times the ratio of the clipped part of its rise to the rest.
fn clipped_blurs(reader: &GreyReader<'_>, preview: &Preview) -> f64 {
    let side = &preview.side;
    let [before, after] = side.plateaus();
    let (dark, light) = (before.min(after), before.max(after));
    let white = reader.tone().decode(1.0);
    match is_clipped(preview) && dark < white {
        true => side.mean_blur() * (light - white).max(0.0) / (white - dark),
        false => 0.0,
    }
}

/// Standard deviation of the light over the sides, as a fraction of it. Figures and grounds may be
/// of any darkness, but light changes both alike: a side's difference is the smaller of the two,
/// and zero if one is lighter than the median and the other darker.
fn light_spread(plateaus: impl Iterator<Item = [f64; 2]>) -> f64 {
    let levels = plateaus.map(|[before, after]| {
        [before.min(after), before.max(after)].map(|level| level.max(MIN_LIGHT).ln())
    });
    let levels: Vec<[f64; 2]> = levels.collect();
    let medians = [0, 1].map(|k| median(levels.iter().map(|level| level[k]).collect()));
    let [Some(dark), Some(light)] = medians else {
        return 0.0;
    };
    let light_changes = levels.iter().map(|level| {
        let [dark, light] = [level[0] - dark, level[1] - light];
        match dark * light > 0.0 {
            true if dark.abs() < light.abs() => dark,
            true => light,
            false => 0.0,
        }
    });
    let light_changes: Vec<f64> = light_changes.collect();
    let mean = light_changes.iter().sum::<f64>() / light_changes.len() as f64;
    mean_square(light_changes.iter().map(|value| value - mean)).sqrt()
}

fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn magnified(by: f64) -> PartDisplacement {
        PartDisplacement {
            shift: Vector2::zeros(),
            shift_deviations: 0.0,
            magnification: by,
            magnification_std: 1e-5,
        }
    }

    fn faults(green_contrast: f64) -> PictureFaults {
        PictureFaults {
            colours: Some(ColourDisplacements {
                blue: magnified(1e-3),
                red: magnified(-1e-3),
                green_contrast,
            }),
            ..PictureFaults::default()
        }
    }

    #[test]
    fn a_target_that_hardly_shows_in_green_is_measured_in_all_colours() {
        let picture = Picture::from_u8(1200, 500, 3, vec![0; 1_800_000]).unwrap();
        let dim = faults(0.2);
        assert_eq!(dim.colour_shift(&picture), Some([0.65, -0.65]));
        assert!(dim.mended(&picture).is_none());
        let green = faults(0.9).mended(&picture).unwrap();
        assert_eq!((green.channels(), green.width()), (1, 1200));
    }

    #[test]
    fn light_that_differs_changes_dark_and_light_alike() {
        let [dark, light] = [0.04, 0.8];
        let halved = |part: usize| 0.5_f64.powi((part % 2) as i32);
        let under = |part| [dark, light].map(|level| level * halved(part));
        let expected = 0.5 * 2.0_f64.ln();
        assert!((light_spread((0..8).map(under)) - expected).abs() < 1e-12);
        // A grey square on a grey ground, and a white one on a grey ground.
        let others = [[0.3, 0.5], [0.3, 0.85]];
        let sides = (0..8).map(|_| [dark, light]).chain(others);
        let spread = light_spread(sides);
        assert!(spread < 0.02, "{spread}");
        assert_eq!(light_spread(std::iter::empty()), 0.0);
    }

    #[test]
    fn displaced_rows_are_left_out_unless_the_picture_has_two_levels() {
        let picture = Picture::from_u8(4, 4, 1, vec![0; 16]).unwrap();
        assert!(picture.of_green().is_none());
        let mut faults = PictureFaults::default();
        assert!(faults.mended(&picture).is_none());
        faults.rows = Some(PartDisplacement {
            shift: Vector2::new(0.2, 0.0),
            shift_deviations: 20.0,
            ..magnified(0.0)
        });
        assert_eq!(faults.row_shift(), Some(Vector2::new(0.2, 0.0)));
        assert!(faults.mended(&picture).is_some());
        faults.has_two_levels = true;
        assert!(faults.mended(&picture).is_none());
    }
}
