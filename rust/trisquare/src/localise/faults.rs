//! What is wrong with a picture as a whole, told by the profiles of its edges.

use super::motion::{self, MotionBlur};
use super::parts::{self, ColourDisplacements, PartDisplacement};
use super::pattern::pattern;
use super::preview::Preview;
use super::span::NoEdge;
use crate::image::GreyReader;

/// A side is clipped where this share of its light pixels is.
const CLIPPED_SHARE: f64 = 0.1;
/// What extrapolating a clipped step leaves unknown of each side, and of all together, in blurs,
/// for a rise that is half clipped: over rendered scenes, with and without blooming.
const CLIPPED_ERROR: f64 = 0.03;
const CLIPPED_COMMON_ERROR: f64 = 0.1;
/// The same of a staircase of two levels, px: what is left of half a pixel over a side's steps.
const TWO_LEVEL_ERROR: f64 = 0.03;
/// What the shape of a motion's blur leaves unknown of a side, in parts of its length.
const MOTION_ERROR: f64 = 0.001;

/// What the edges' profiles tell of faults of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct PictureFaults {
    /// The share of the sides whose light is clipped.
    pub clipped: f64,
    /// Whether all pixels are black or white.
    pub has_two_levels: bool,
    /// The odd rows against the even ones.
    pub rows: Option<PartDisplacement>,
    /// The colours of a picture that has them.
    pub colours: Option<ColourDisplacements>,
    /// The camera's motion while the shutter was open.
    pub motion: Option<MotionBlur>,
    /// The amplitude of a fine pattern over the picture, as a part of the sides' contrast.
    pub pattern: Option<f64>,
    /// One standard deviation of what they leave unknown of each side's place, px.
    pub side_error: f64,
    /// The same of all sides together, towards the dark.
    pub common_error: f64,
}

impl PictureFaults {
    pub(super) fn of(reader: &GreyReader<'_>, previews: &[Result<Preview, NoEdge>]) -> Self {
        let found = || previews.iter().flatten();
        let clipped = found().filter(|preview| is_clipped(preview)).count();
        let has_two_levels = reader.picture().has_two_levels();
        let motion = motion::blur(found());
        let clipping = mean_square(found().map(|preview| clipped_blurs(reader, preview))).sqrt();
        let own = if has_two_levels {
            TWO_LEVEL_ERROR
        } else {
            CLIPPED_ERROR * clipping
        };
        let moved = motion.map_or(0.0, |motion| MOTION_ERROR * motion.length);
        Self {
            motion,
            pattern: pattern(reader, found()),
            side_error: own.hypot(moved),
            common_error: CLIPPED_COMMON_ERROR * clipping,
            clipped: clipped as f64 / found().count().max(1) as f64,
            has_two_levels,
            rows: parts::rows(reader, found()),
            colours: parts::colours(reader, found()),
        }
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

/// The blur of a side times the part of its rise that is clipped over the part that is not.
fn clipped_blurs(reader: &GreyReader<'_>, preview: &Preview) -> f64 {
    let side = &preview.side;
    let [before, after] = side.plateaus();
    let (dark, light) = (before.min(after), before.max(after));
    let white = reader.tone().decode(1.0);
    match is_clipped(preview) && dark < white {
        true => side.blur * (light - white).max(0.0) / (white - dark),
        false => 0.0,
    }
}

fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}
