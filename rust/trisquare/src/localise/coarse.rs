//! Refines a coarse path to a curve that is accurate to a fraction of a pixel, by the steepest
//! rises of profiles across it.

use nalgebra::Vector2;

use super::curve::ChordCurve;
use super::span::{EdgeSpan, NoEdge};
use crate::image::GreyReader;

/// Settings for sampling profiles across a path and finding the edge in them.
struct ProfileSettings {
    /// Distance between profiles, pixels.
    spacing: f64,
    /// Number of lines of pixels within the spacing whose mean is a profile.
    lines: usize,
    /// Half the length of the step filter, samples.
    filter: i32,
    /// Distance from the edge at which the plateaus on both sides are read, pixels.
    plateau: i32,
    /// Maximum distance of the edge from the path, pixels.
    reach: i32,
}

/// Settings of the first attempt: few lines, and a filter long enough to average noise and short
/// enough to keep the two sides of a thin frame apart.
const SHARP: ProfileSettings = ProfileSettings {
    spacing: 6.0,
    lines: 1,
    filter: 2,
    plateau: 3,
    reach: REACH,
};
/// Settings of the second attempt, for an edge that is blurred by several pixels or lost in noise:
/// all pixels are used. A blur of 4 pixels rises 1.9 times as much over 5 pixels as over 2.
const BLUNT: ProfileSettings = ProfileSettings {
    spacing: 12.0,
    lines: 8,
    filter: 5,
    plateau: 7,
    reach: REACH,
};
/// Minimum and maximum number of profiles.
const PROFILES: std::ops::RangeInclusive<usize> = 5..=100;
/// Maximum distance of the edge from the path, pixels: the 4 that are promised, and some slack.
const REACH: i32 = 6;
/// Same for an edge that was found before.
const NEAR_REACH: i32 = 2;
/// Half length of the longest filter, and the number of samples that it needs.
const LONGEST_FILTER: i32 = BLUNT.filter;
const MAX_SAMPLES: usize = (2 * (REACH + LONGEST_FILTER) + 1) as usize;
/// Length of the pieces into which legs of a coarse path are cut, pixels.
const PATH_PIECE: f64 = 6.0;
/// Distance (px) of the profiles from the path's ends, where the corners are; at most a fraction of
/// its length.
const END_MARGIN: f64 = 5.0;
const END_MARGIN_SHARE: f64 = 0.15;
/// Half width of the band around a line in which profiles support it at first, pixels: wide enough
/// for curvature.
const CONSENSUS_WIDTH: f64 = 2.5;
/// Maximum number of early profiles, and of late ones; lines through all pairs of them are tried.
const ANCHORS: usize = 8;
/// Decreasing widths of the robust weights, pixels, while the polynomial's degree increases to its
/// final value.
const ROBUST_WIDTHS: [f64; 5] = [3.0, 2.5, 2.0, 1.5, 1.5];
/// Same for edge samples, which are more exact than the rise of a profile.
const SAMPLE_WIDTHS: [f64; 7] = [3.0, 2.0, 1.2, 0.7, 0.4, 0.25, 0.25];
/// Maximum distance from the final curve of a rise that supports the edge, pixels.
const SUPPORT_WIDTH: f64 = 1.0;
/// Minimum fraction of the profiles that support the edge; by chance about a third do.
const MIN_SUPPORT: f64 = 0.6;
/// Same where objects beside the edge are as light as the figure that it bounds, or lighter: fewer
/// profiles support it there.
const MIN_SUPPORT_BESIDE_OTHERS: f64 = 0.4;
const MIN_PROFILES: usize = 3;
/// Departure of the light beside the edge from the side's median, as a fraction of the step, above
/// which it belongs to another object. Shading changes a side by less, and noise seldom exceeds it
/// twice in a row.
const MAX_DEPARTURE: f64 = 0.25;
/// That threshold is at least this multiple of the readings' median departure, three standard
/// deviations of a normal variable, so that noise does not exceed it.
const MAX_NOISE_DEPARTURE: f64 = 4.5;
/// Minimum number of consecutive profiles with another edge, or none, that show an object over the
/// edge ...
const MIN_HIDDEN: usize = 2;
/// ... and the same at the end of a side, as at an acute corner the neighbouring side comes near.
const MIN_HIDDEN_AT_END: usize = 4;

/// An edge known to a fraction of a pixel, and initial values of the light beside it.
pub(super) struct CoarseEdge {
    pub curve: ChordCurve,
    /// Coded values on the side of negative distances, and on the other.
    pub plateaus: [f64; 2],
    pub blur: f64,
    /// Ranges of `s` where another object covers the edge.
    pub hidden: Vec<[f64; 2]>,
}

/// Position at which an edge was seen, and the strength of the evidence.
#[derive(Clone, Copy)]
struct SeenEdge {
    s: f64,
    y: f64,
    strength: f64,
}

/// The steepest rise of one profile.
struct Rise {
    point: SeenEdge,
    plateaus: [f64; 2],
    slope: f64,
}

/// Degree of the polynomial for a side of the given length (px): as high as the length can resolve,
/// and as a lens can bend it.
pub(super) fn degree_for(length: f64) -> usize {
    match length {
        _ if length < 30.0 => 1,
        _ if length < 80.0 => 2,
        _ if length < 150.0 => 3,
        _ => 4,
    }
}

/// Finds the edge near a span's path.
pub(super) fn find(reader: &GreyReader<'_>, span: &EdgeSpan) -> Result<CoarseEdge, NoEdge> {
    find_within(reader, span, REACH)
}

/// Finds the edge in a piece of a span that was found before.
pub(super) fn find_near(reader: &GreyReader<'_>, piece: &EdgeSpan) -> Result<CoarseEdge, NoEdge> {
    find_within(reader, piece, NEAR_REACH)
}

/// The curve near a span's path that most of its samples agree on.
pub(super) fn consensus_curve(span: &EdgeSpan, points: &[Vector2<f64>]) -> Option<ChordCurve> {
    let path = path_curve(&span.path)?;
    let point = |point: &Vector2<f64>| {
        let (s, y) = path.local(*point);
        SeenEdge {
            s,
            y,
            strength: 1.0,
        }
    };
    let points: Vec<SeenEdge> = points.iter().map(point).collect();
    consensus(&path, &points, &SAMPLE_WIDTHS)
}

/// Finds the edge within `reach` pixels of a span's path.
fn find_within(reader: &GreyReader<'_>, span: &EdgeSpan, reach: i32) -> Result<CoarseEdge, NoEdge> {
    let path = path_curve(&span.path).ok_or(NoEdge::NoPath)?;
    match find_with_settings(reader, &path, span, &ProfileSettings { reach, ..SHARP }) {
        Err(NoEdge::Inconsistent) => {
            find_with_settings(reader, &path, span, &ProfileSettings { reach, ..BLUNT })
        }
        found => found,
    }
}

/// Finds the edge near a path with profiles of the given settings.
fn find_with_settings(
    reader: &GreyReader<'_>,
    path: &ChordCurve,
    span: &EdgeSpan,
    settings: &ProfileSettings,
) -> Result<CoarseEdge, NoEdge> {
    let count =
        ((path.length() / settings.spacing) as usize).clamp(*PROFILES.start(), *PROFILES.end());
    let end = 1.0 - (END_MARGIN / path.half_length).min(2.0 * END_MARGIN_SHARE);
    let mut stations = Vec::with_capacity(count);
    let mut rises = Vec::with_capacity(count);
    for index in 0..count {
        let s = end * (2.0 * index as f64 / (count - 1) as f64 - 1.0);
        if let Some(profile) = settings.profile(reader, path, s) {
            stations.push(s);
            rises.extend(settings.steepest(&profile, path, s, span));
        }
    }
    let inside = stations.len();
    if inside < MIN_PROFILES {
        return Err(NoEdge::OutsidePicture);
    }
    let points: Vec<SeenEdge> = rises.iter().map(|rise| rise.point).collect();
    let curve = consensus(path, &points, &ROBUST_WIDTHS).ok_or(NoEdge::Inconsistent)?;
    let supports = |SeenEdge { s, y, .. }| (y - curve.height_and_slope(s).0).abs() < SUPPORT_WIDTH;
    rises.retain(|rise| supports(rise.point));
    let min_support = match span.is_beside_others {
        true => MIN_SUPPORT_BESIDE_OTHERS,
        false => MIN_SUPPORT,
    };
    if rises.len() < MIN_PROFILES || (rises.len() as f64) < min_support * inside as f64 {
        return Err(NoEdge::Inconsistent);
    }
    let plateaus = [0, 1].map(|side| median(&mut rises, |rise| rise.plateaus[side]));
    let slope = median(&mut rises, |rise| rise.slope);
    // At the edge itself the slope is the contrast times the normal density over the blur.
    let blur = crate::numeric::pdf(0.0) * (plateaus[1] - plateaus[0]) / slope;
    let max_departure = MAX_DEPARTURE * (plateaus[1] - plateaus[0]).abs();
    let departure = |rise: &Rise, i: usize| (rise.plateaus[i] - plateaus[i]).abs();
    let max_departures = [0, 1]
        .map(|i| max_departure.max(MAX_NOISE_DEPARTURE * median(&mut rises, |r| departure(r, i))));
    rises.retain(|rise| (0..2).all(|i| departure(rise, i) < max_departures[i]));
    let hidden = hidden_runs(&stations, &rises);
    Ok(CoarseEdge {
        curve,
        plateaus,
        blur,
        hidden,
    })
}

/// Ranges of consecutive stations without a supporting rise, each extended at both ends by the
/// distance between stations.
fn hidden_runs(stations: &[f64], supporting: &[Rise]) -> Vec<[f64; 2]> {
    let supports = |s: &f64| supporting.iter().any(|rise| rise.point.s == *s);
    let step = (stations[stations.len() - 1] - stations[0]) / (stations.len() - 1) as f64;
    let mut runs = Vec::new();
    let mut first = 0;
    while first < stations.len() {
        let length = stations[first..]
            .iter()
            .take_while(|s| !supports(s))
            .count();
        let end = first + length;
        let min_length = match first == 0 || end == stations.len() {
            true => MIN_HIDDEN_AT_END,
            false => MIN_HIDDEN,
        };
        if length >= min_length {
            runs.push([stations[first] - step, stations[end - 1] + step]);
        }
        first = end + 1;
    }
    runs
}

/// A smooth curve along the coarse path, which may be a polygon or follow pixel steps.
fn path_curve(path: &[Vector2<f64>]) -> Option<ChordCurve> {
    let (&start, &end) = (path.first()?, path.last()?);
    let mut curve = ChordCurve::chord(start, end)?;
    let mut samples = Vec::new();
    for leg in path.windows(2) {
        let length = (leg[1] - leg[0]).norm();
        if !length.is_finite() {
            return None;
        }
        let steps = (length / PATH_PIECE)
            .ceil()
            .clamp(1.0, *PROFILES.end() as f64);
        for step in 0..steps as usize {
            let middle = leg[0].lerp(&leg[1], (step as f64 + 0.5) / steps);
            let (s, y) = curve.local(middle);
            samples.push((s, y, length / steps));
        }
    }
    let degree = degree_for(curve.length())
        .min(path.len() - 1)
        .min(samples.len() - 1);
    // If the legs have no length, or are all at one point, the chord remains.
    let _ = curve.fit(samples.iter().copied(), degree);
    Some(curve)
}

impl ProfileSettings {
    /// Grey values one pixel apart along the normal at `s`; `None` if they leave the picture.
    fn profile(&self, reader: &GreyReader<'_>, path: &ChordCurve, s: f64) -> Option<GreyProfile> {
        let mut values = [0.0; MAX_SAMPLES];
        for line in 0..self.lines {
            let along = (line as f64 + 0.5) / self.lines as f64 - 0.5;
            let s = s + along * self.spacing / path.half_length;
            let middle = path.point(s, 0.0);
            let normal = path.point(s, 1.0) - middle;
            for t in -self.max_offset()..=self.max_offset() {
                let point = middle + normal * f64::from(t);
                values[sample_index(t)] += reader.bilinear(point.x, point.y)? / self.lines as f64;
            }
        }
        Some(values)
    }

    fn max_offset(&self) -> i32 {
        self.reach + self.filter
    }

    /// The steepest rise of a profile in the direction of the polarity, interpolated between
    /// samples.
    fn steepest(
        &self,
        values: &GreyProfile,
        path: &ChordCurve,
        s: f64,
        span: &EdgeSpan,
    ) -> Option<Rise> {
        let value_at = |t: i32| values[sample_index(t)];
        let strength = |t: i32| {
            let difference: f64 = (1..=self.filter)
                .map(|step| value_at(t + step) - value_at(t - step))
                .sum();
            span.polarity.signum() * difference
        };
        let best =
            (-self.reach..=self.reach).max_by(|&a, &b| strength(a).total_cmp(&strength(b)))?;
        let peak = strength(best);
        if peak <= 0.0 {
            return None;
        }
        let mut offset = f64::from(best);
        if best.abs() < self.reach {
            let (before, after) = (strength(best - 1), strength(best + 1));
            let curvature = before + after - 2.0 * peak;
            if curvature < 0.0 {
                offset += 0.5 * (before - after) / curvature;
            }
        }
        let (_, y) = path.local(path.point(s, offset));
        let plateau = |t: i32| value_at(t.clamp(-self.max_offset(), self.max_offset()));
        let [before, after] = span
            .margin
            .map(|margin| f64::from(self.plateau).min(margin).max(1.0) as i32);
        Some(Rise {
            point: SeenEdge {
                s,
                y,
                strength: peak,
            },
            plateaus: [plateau(best - before), plateau(best + after)],
            slope: 0.5 * (value_at(best + 1) - value_at(best - 1)),
        })
    }
}

/// Grey values along the normal of a path.
type GreyProfile = [f64; MAX_SAMPLES];

/// Index in a profile of the value `t` pixels from the path.
fn sample_index(t: i32) -> usize {
    (t + REACH + LONGEST_FILTER) as usize
}

/// The curve that most points agree on: a line by consensus, then a polynomial by iterative
/// reweighting.
fn consensus(path: &ChordCurve, points: &[SeenEdge], widths: &[f64]) -> Option<ChordCurve> {
    let degree = degree_for(path.length()).min(points.len().checked_sub(2)?);
    let mut curve = path.clone();
    let heights: Vec<f64> = points
        .iter()
        .map(|point| point.y - path.height_and_slope(point.s).0)
        .collect();
    let (height, slope) = consensus_line(points, &heights)?;
    curve.coefficients[0] += height;
    curve.coefficients[1] += slope;
    for (round, width) in widths.iter().enumerate() {
        let previous = curve.clone();
        let weighted = points.iter().map(|point| {
            let departure = (point.y - previous.height_and_slope(point.s).0) / width;
            let weight = (1.0 - departure * departure).max(0.0);
            (point.s, point.y, point.strength * weight * weight)
        });
        let round_degree = degree.min(path.degree.max(round + 1));
        if !curve.fit(weighted, round_degree) {
            return None;
        }
    }
    Some(curve)
}

/// The line `height + slope s`, through one early and one late point, with the most support.
fn consensus_line(points: &[SeenEdge], heights: &[f64]) -> Option<(f64, f64)> {
    let third = points.len().div_ceil(3);
    let stride = third.div_ceil(ANCHORS);
    let mut best = None;
    let mut best_support = 0.0;
    for early in (0..third).step_by(stride) {
        for late in (points.len() - third..points.len()).step_by(stride) {
            let run = points[late].s - points[early].s;
            if run <= 0.0 {
                continue;
            }
            let slope = (heights[late] - heights[early]) / run;
            let height = heights[early] - slope * points[early].s;
            let support: f64 = points
                .iter()
                .zip(heights)
                .map(|(point, y)| {
                    let departure = (y - height - slope * point.s) / CONSENSUS_WIDTH;
                    point.strength * (1.0 - departure * departure).max(0.0)
                })
                .sum();
            if support > best_support {
                (best, best_support) = (Some((height, slope)), support);
            }
        }
    }
    best
}

fn median(rises: &mut [Rise], key: impl Fn(&Rise) -> f64) -> f64 {
    let middle = rises.len() / 2;
    let (_, rise, _) = rises.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    key(rise)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hidden(bad: &[usize]) -> Vec<[f64; 2]> {
        let stations: Vec<f64> = (0..11).map(|i| f64::from(i) / 5.0 - 1.0).collect();
        let good = (0..11).filter(|i| !bad.contains(i)).map(|i| Rise {
            point: SeenEdge {
                s: stations[i],
                y: 0.0,
                strength: 1.0,
            },
            plateaus: [0.0, 1.0],
            slope: 1.0,
        });
        hidden_runs(&stations, &good.collect::<Vec<_>>())
    }

    #[test]
    fn runs_without_an_edge_are_hidden_and_single_misses_are_not() {
        assert!(hidden(&[]).is_empty());
        assert!(hidden(&[2, 5, 9]).is_empty());
        let runs = hidden(&[3, 4, 5]);
        assert_eq!(runs.len(), 1);
        assert!((runs[0][0] + 0.6).abs() < 1e-12 && (runs[0][1] - 0.2).abs() < 1e-12);
    }

    #[test]
    fn an_end_is_hidden_only_beyond_a_corner_s_reach() {
        assert!(hidden(&[0, 1, 2, 10]).is_empty());
        let runs = hidden(&[0, 1, 2, 3, 9, 10]);
        assert_eq!(runs.len(), 1);
        assert!(runs[0][0] < -1.0);
    }
}
