//! Division of chains of edge points into arcs of circles.
//!
//! The image of a straight line under the division model is such an arc (A. Fitzgibbon,
//! "Simultaneous linear estimation of multiple view geometry and lens distortion", CVPR 2001).

use nalgebra::{Matrix3, Vector2, Vector3};

/// Number of points on either side of a corner from which the two directions are computed.
const CORNER_REACH: usize = 7;
/// Minimum turn between them at a corner, radians: an arc as long as the picture turns by less than
/// a tenth of a radian.
const MIN_CORNER_TURN: f64 = 0.25;
/// Number of points next to a corner, and at a chain's ends, that the other edge has displaced.
const CORNER_MARGIN: usize = 3;

/// Number of points whose mean deviation is compared with the tolerance, as single points scatter.
const MEAN_POINTS: usize = 5;

/// Minimum ratio of the chord of an arc to its length.
const MIN_CHORD: f64 = 0.5;

/// Requirements on an arc; lengths in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcLimits {
    /// Maximum deviation from the circle, as the mean of a few points.
    pub tolerance: f64,
    /// Minimum number of points.
    pub shortest: usize,
    /// Minimum radius.
    pub smallest_radius: f64,
}

/// The arcs of a chain, in its order, as parts that do not overlap.
#[must_use]
pub fn circular_arcs<'a>(chain: &'a [Vector2<f64>], limits: &ArcLimits) -> Vec<&'a [Vector2<f64>]> {
    let mut arcs = Vec::new();
    let shortest = limits.shortest.max(MEAN_POINTS + 1);
    for (start, end) in corner_free_stretches(chain) {
        let mut parts: Vec<(usize, usize)> = Vec::new();
        let mut pending = vec![(start, end)];
        while let Some((start, end)) = pending.pop() {
            if end - start < shortest {
                continue;
            }
            let place = match deviation(&chain[start..end]) {
                Some((worst, _)) if worst <= limits.tolerance => {
                    append(&mut parts, (start, end), chain, limits);
                    continue;
                }
                // A cut near an end would leave too short a part.
                Some((_, place)) if (shortest..=end - start - shortest).contains(&place) => place,
                _ => (end - start) / 2,
            };
            pending.push((start + place, end));
            pending.push((start, start + place));
        }
        arcs.extend(
            parts
                .into_iter()
                .map(|(start, end)| &chain[start..end])
                .filter(|arc| is_wide(arc, limits)),
        );
    }
    arcs
}

/// Adds a part, joined to the last one if both are on one arc.
fn append(
    parts: &mut Vec<(usize, usize)>,
    part: (usize, usize),
    chain: &[Vector2<f64>],
    limits: &ArcLimits,
) {
    if let Some(last) = parts.last_mut()
        && last.1 == part.0
        && deviation(&chain[last.0..part.1]).is_some_and(|(worst, _)| worst <= limits.tolerance)
    {
        last.1 = part.1;
        return;
    }
    parts.push(part);
}

/// The stretches of a chain between its corners, without the points next to them.
fn corner_free_stretches(chain: &[Vector2<f64>]) -> Vec<(usize, usize)> {
    let mut turns = vec![0.0; chain.len()];
    for i in CORNER_REACH..chain.len().saturating_sub(CORNER_REACH) {
        let before = chain[i - 1] - chain[i - CORNER_REACH];
        let after = chain[i + CORNER_REACH] - chain[i + 1];
        turns[i] = before.perp(&after).atan2(before.dot(&after)).abs();
    }
    let is_corner = |i: usize| {
        let around = i.saturating_sub(CORNER_REACH)..(i + CORNER_REACH + 1).min(chain.len());
        turns[i] > MIN_CORNER_TURN && turns[around].iter().all(|turn| *turn <= turns[i])
    };
    let corners = (0..chain.len()).filter(|&i| is_corner(i));
    let mut stretches = Vec::new();
    let mut start = 0;
    for corner in corners.chain(std::iter::once(chain.len())) {
        let (first, last) = (start + CORNER_MARGIN, corner.saturating_sub(CORNER_MARGIN));
        if first < last {
            stretches.push((first, last));
        }
        start = corner;
    }
    stretches
}

/// A circle `v = a + b u + c (u^2 + v^2)` fitted to points, with `u` along their chord.
struct Circle {
    middle: Vector2<f64>,
    along: Vector2<f64>,
    coefficients: Vector3<f64>,
    half_chord: f64,
}

impl Circle {
    /// The circle by linear least squares; `None` for points that turn too far to be an arc.
    fn through(points: &[Vector2<f64>]) -> Option<Self> {
        let (first, last) = (points.first()?, points.last()?);
        let half_chord = 0.5 * (last - first).norm();
        let length: f64 = points.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
        if 2.0 * half_chord < MIN_CHORD * length || half_chord <= 0.0 {
            return None;
        }
        let mut circle = Self {
            middle: first.lerp(last, 0.5),
            along: (last - first) / (2.0 * half_chord),
            coefficients: Vector3::zeros(),
            half_chord,
        };
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for point in points {
            let (row, v) = circle.row(point);
            normal += row * row.transpose();
            right += row * v;
        }
        circle.coefficients = normal.cholesky()?.solve(&right);
        Some(circle)
    }

    /// `(1, u, u^2 + v^2)` and `v` of a point, in units of half the chord.
    fn row(&self, point: &Vector2<f64>) -> (Vector3<f64>, f64) {
        let off = (point - self.middle) / self.half_chord;
        let (u, v) = (off.dot(&self.along), self.along.perp(&off));
        (Vector3::new(1.0, u, off.norm_squared()), v)
    }

    /// Signed distance of a point, to first order, pixels.
    fn distance(&self, point: &Vector2<f64>) -> f64 {
        let (row, v) = self.row(point);
        let [b, c] = [self.coefficients.y, self.coefficients.z];
        let slope = Vector2::new(2.0 * c * row.y + b, 2.0 * c * v - 1.0);
        self.half_chord * (self.coefficients.dot(&row) - v) / slope.norm()
    }

    /// Height of the arc over its chord, pixels.
    fn height(&self) -> f64 {
        self.coefficients.z.abs() * self.half_chord
    }
}

/// The largest deviation of a few points' mean from the circle through all, and its index.
fn deviation(points: &[Vector2<f64>]) -> Option<(f64, usize)> {
    let circle = Circle::through(points)?;
    let distances: Vec<f64> = points.iter().map(|p| circle.distance(p)).collect();
    let means = distances
        .windows(MEAN_POINTS)
        .map(|few| few.iter().sum::<f64>().abs() / MEAN_POINTS as f64);
    means
        .zip(MEAN_POINTS / 2..)
        .max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Whether an arc's radius is large enough, within the tolerance.
fn is_wide(points: &[Vector2<f64>], limits: &ArcLimits) -> bool {
    Circle::through(points).is_some_and(|circle| {
        let max_height = 0.5 * circle.half_chord.powi(2) / limits.smallest_radius;
        circle.height() <= max_height + limits.tolerance
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: ArcLimits = ArcLimits {
        tolerance: 0.5,
        shortest: 20,
        smallest_radius: 150.0,
    };

    fn segment(from: [f64; 2], to: [f64; 2]) -> Vec<Vector2<f64>> {
        let (from, to) = (Vector2::from(from), Vector2::from(to));
        let count = (to - from).norm() as usize;
        (0..count)
            .map(|i| from.lerp(&to, i as f64 / count as f64))
            .collect()
    }

    fn arc(radius: f64, length: f64) -> Vec<Vector2<f64>> {
        (0..length as usize)
            .map(|i| {
                let angle = i as f64 / radius;
                Vector2::new(radius * angle.cos(), radius * angle.sin())
            })
            .collect()
    }

    #[test]
    fn an_arc_stays_whole_but_for_its_ends() {
        for chain in [arc(400.0, 300.0), segment([5.0, 9.0], [200.0, 70.0])] {
            let arcs = circular_arcs(&chain, &LIMITS);
            assert_eq!(arcs.len(), 1);
            assert_eq!(arcs[0].len(), chain.len() - 2 * CORNER_MARGIN);
        }
    }

    #[test]
    fn a_chain_is_cut_at_its_corners_and_where_its_curvature_changes() {
        let mut corner = segment([0.0, 0.0], [100.0, 0.0]);
        corner.extend(segment([100.0, 0.0], [100.0, 80.0]));
        let arcs = circular_arcs(&corner, &LIMITS);
        assert_eq!(arcs.len(), 2);
        assert!(arcs[0].iter().all(|p| p.y == 0.0) && arcs[1].iter().all(|p| p.x == 100.0));

        // An arc continued by a tangent.
        let mut bent = segment([200.0, -300.0], [200.0, 0.0]);
        bent.extend(arc(200.0, 250.0));
        let arcs = circular_arcs(&bent, &LIMITS);
        let longest = arcs.iter().map(|arc| arc.len()).max().unwrap();
        assert!(arcs.len() > 1 && longest < 420, "{longest}");
    }

    #[test]
    fn small_circles_and_short_chains_are_left_out() {
        assert!(circular_arcs(&arc(60.0, 360.0), &LIMITS).is_empty());
        assert!(circular_arcs(&arc(400.0, 20.0), &LIMITS).is_empty());
        assert!(circular_arcs(&[], &LIMITS).is_empty());
    }
}
