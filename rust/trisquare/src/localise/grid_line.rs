//! An initial estimate of a grid line, from its crossings.

use nalgebra::Vector2;

use super::coarse::{CoarseEdge, degree_for};
use super::curve::ChordCurve;
use super::lines_beside;
use super::span::{EdgeSpan, NoEdge};
use crate::image::GreyReader;
use crate::numeric::pdf;

/// Positions between two crossings at which a line is sampled, as fractions of the distance.
const STATIONS: [f64; 3] = [0.35, 0.5, 0.65];
/// Distance from the line at which its shades are read, as a fraction of the distance to the next
/// line, and its maximum in pixels: clear of the blur, and short of a marker within the cell. If
/// the width of the white around markers is known, shades are read at most half way to the marker.
const SHADE_SHARE: f64 = 0.4;
const SHADE_REACH: f64 = 3.0;
/// Distance from the path within which the steepest rise is sought, in half pixels.
const RISE_STEPS: i32 = 4;
/// Minimum fraction of the stretches between crossings with the light on the expected side.
const MIN_SUPPORT: f64 = 0.6;
/// Contrast of a stretch, over the median, below which another object covers it.
const MIN_CONTRAST: f64 = 0.3;

/// Measurements between two crossings.
struct Stretch {
    ends: [f64; 2],
    /// Shades on the negative side and on the other, exchanged if the polarity differs from that
    /// after the first crossing.
    shades: [f64; 2],
    slope: f64,
}

/// Finds a grid line from the points where others cross it.
pub(super) fn find(
    reader: &GreyReader<'_>,
    spans: &[EdgeSpan],
    index: usize,
) -> Result<CoarseEdge, NoEdge> {
    let span = &spans[index];
    let curve = crossings_curve(span).ok_or(NoEdge::NoPath)?;
    let spacing = lines_beside::spacing(spans, index, curve.along);
    let rims = span.rims.iter().copied().filter(|rim| *rim > 0.0);
    let reach_share = rims.map(|rim| 0.5 * rim).fold(SHADE_SHARE, f64::min);
    let reach = SHADE_REACH.min(reach_share * spacing);
    let mut stretches: Vec<Stretch> = Vec::new();
    let mut hidden = span.gaps(&curve);
    let mut stretch_count = 0.0;
    for (ends, numbers) in span.path.windows(2).zip(span.crossings.windows(2)) {
        if numbers[1].1.abs_diff(numbers[0].1) != 1 {
            continue;
        }
        stretch_count += 1.0;
        let ends = [ends[0], ends[1]].map(|end| curve.local(end).0);
        match measure_stretch(reader, &curve, ends, reach) {
            Some((shades, slope)) => stretches.push(Stretch {
                ends,
                shades: span.unflipped(numbers[0].1, shades),
                slope,
            }),
            None => hidden.push(ends),
        }
    }
    if stretches.is_empty() {
        return Err(NoEdge::OutsidePicture);
    }
    let contrast =
        |stretch: &Stretch| span.polarity.signum() * (stretch.shades[1] - stretch.shades[0]);
    let supporting = stretches.iter().filter(|stretch| contrast(stretch) > 0.0);
    if (supporting.count() as f64) < MIN_SUPPORT * stretch_count {
        return Err(NoEdge::Inconsistent);
    }
    let median_contrast = median(stretches.iter().map(contrast));
    hidden.extend(
        stretches
            .iter()
            .filter(|stretch| contrast(stretch) < MIN_CONTRAST * median_contrast)
            .map(|stretch| stretch.ends),
    );
    let slope = median(stretches.iter().map(|stretch| stretch.slope));
    Ok(CoarseEdge {
        curve,
        plateaus: [0, 1].map(|side| median(stretches.iter().map(|stretch| stretch.shades[side]))),
        // At the edge itself the slope is the contrast times the normal density over the blur.
        blur: pdf(0.0) * median_contrast / slope,
        hidden,
    })
}

/// A smooth curve through a line's crossings, each of which has an error of a pixel or so.
fn crossings_curve(span: &EdgeSpan) -> Option<ChordCurve> {
    let (&start, &end) = (span.path.first()?, span.path.last()?);
    if span.crossings.len() != span.path.len() || span.path.len() < 2 {
        return None;
    }
    let mut curve = ChordCurve::chord(start, end)?;
    let places: Vec<(f64, f64)> = span.path.iter().map(|point| curve.local(*point)).collect();
    let in_order = places.windows(2).all(|pair| pair[0].0 < pair[1].0);
    if !in_order || places.iter().any(|(_, y)| !y.is_finite()) {
        return None;
    }
    let degree = degree_for(curve.length());
    // The degree is at most half the number of crossings, so that the curve does not follow the
    // error of each.
    let fitted_degree = degree.min((places.len() - 1).div_ceil(2));
    if !curve.fit(places.iter().map(|(s, y)| (*s, *y, 1.0)), fitted_degree) {
        return None;
    }
    curve.degree = degree;
    Some(curve)
}

/// The median shades on both sides between two crossings, and the median steepest slope; `None`
/// outside the picture.
fn measure_stretch(
    reader: &GreyReader<'_>,
    curve: &ChordCurve,
    ends: [f64; 2],
    reach: f64,
) -> Option<([f64; 2], f64)> {
    let mut shades = [[0.0; STATIONS.len()]; 2];
    let mut slopes = [0.0; STATIONS.len()];
    for (index, share) in STATIONS.iter().enumerate() {
        let s = ends[0] + share * (ends[1] - ends[0]);
        let middle = curve.point(s, 0.0);
        let normal = curve.point(s, 1.0) - middle;
        let read = |offset: f64| {
            let point: Vector2<f64> = middle + normal * offset;
            reader.bilinear(point.x, point.y)
        };
        shades[0][index] = read(-reach)?;
        shades[1][index] = read(reach)?;
        let mut before = read(-0.5 * f64::from(RISE_STEPS) - 0.5)?;
        let mut between = read(-0.5 * f64::from(RISE_STEPS))?;
        for step in 1 - RISE_STEPS..=RISE_STEPS {
            let after = read(0.5 * f64::from(step))?;
            slopes[index] = f64::max(slopes[index], (after - before).abs());
            (before, between) = (between, after);
        }
    }
    let shades = shades.map(|side| median(side.into_iter()));
    let slope = median(slopes.into_iter());
    (shades[0] + shades[1] + slope)
        .is_finite()
        .then_some((shades, slope))
}

impl EdgeSpan {
    /// The shades after a crossing of the given number, exchanged if the polarity is the opposite
    /// there.
    fn unflipped(&self, number: usize, [before, after]: [f64; 2]) -> [f64; 2] {
        if self.contrast_sign(number) > 0.0 {
            [before, after]
        } else {
            [after, before]
        }
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
