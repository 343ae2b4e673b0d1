//! Edges of a grey picture, located to a fraction of a pixel and linked into chains.
//!
//! An edge point is a maximum of the gradient along the axis nearest to the gradient's direction; a
//! parabola through three magnitudes gives its position (F. Devernay, INRIA report 2724 (1995); R.
//! Grompone von Gioi & G. Randall, Image Processing On Line 7 (2017) 347-372, whose linking is
//! used).

use nalgebra::Vector2;

/// Distance (px) from an edge point within which the next one of its chain is sought.
const REACH: usize = 2;

/// Index for "no edge point".
const NO_POINT: u32 = u32::MAX;

/// Grey levels in any unit, in row order.
#[derive(Debug, Clone, Copy)]
pub struct GreyFloats<'a> {
    size: [usize; 2],
    values: &'a [f32],
}

impl<'a> GreyFloats<'a> {
    /// Wraps the values; `None` unless there are `width * height`.
    #[must_use]
    pub fn new(width: usize, height: usize, values: &'a [f32]) -> Option<Self> {
        (width.checked_mul(height)? == values.len()).then_some(Self {
            size: [width, height],
            values,
        })
    }

    /// Gradient at a pixel that is not on the rim, by Scharr's filters, in levels per pixel.
    fn gradient(&self, x: usize, y: usize) -> Vector2<f32> {
        let width = self.size[0];
        let at = |x: usize, y: usize| self.values[y * width + x];
        let across = |y: usize| at(x + 1, y) - at(x - 1, y);
        let down = |x: usize| at(x, y + 1) - at(x, y - 1);
        Vector2::new(
            3.0 * (across(y - 1) + across(y + 1)) + 10.0 * across(y),
            3.0 * (down(x - 1) + down(x + 1)) + 10.0 * down(x),
        ) / 32.0
    }
}

/// A point of an edge, and the gradient at its pixel.
struct EdgePoint {
    place: Vector2<f64>,
    gradient: Vector2<f32>,
}

/// Finds the chains of edge points whose gradient is at least `weak`, and `strong` somewhere.
///
/// The points, in pixels, are about a pixel apart, in order along the edge, with the darker side
/// always on the same hand; a chain has at least two points. `weak` and `strong` are in levels per
/// pixel.
#[must_use]
pub fn edge_chains(picture: &GreyFloats<'_>, weak: f32, strong: f32) -> Vec<Vec<Vector2<f64>>> {
    let (points, grid) = edge_points(picture, weak);
    let (next, previous) = links(picture.size, &points, &grid);
    let mut is_used = vec![false; points.len()];
    let mut chains = Vec::new();
    // Open chains first, from their first points; the remaining chains are rings.
    let first = (0..points.len()).filter(|&i| previous[i] == NO_POINT);
    for start in first.chain(0..points.len()) {
        let mut chain = Vec::new();
        let mut is_strong = false;
        let mut index = start;
        while !is_used[index] {
            is_used[index] = true;
            chain.push(points[index].place);
            is_strong |= points[index].gradient.norm() >= strong;
            if next[index] == NO_POINT {
                break;
            }
            index = next[index] as usize;
        }
        if is_strong && chain.len() > 1 {
            chains.push(chain);
        }
    }
    chains
}

/// The edge points of a picture, and for each pixel the index of its point.
fn edge_points(picture: &GreyFloats<'_>, weak: f32) -> (Vec<EdgePoint>, Vec<u32>) {
    let [width, height] = picture.size;
    let mut points = Vec::new();
    let mut grid = vec![NO_POINT; width * height];
    if width < 2 * REACH + 1 || height < 2 * REACH + 1 {
        return (points, grid);
    }
    let mut gradients = vec![Vector2::zeros(); width * height];
    let mut magnitudes = vec![0.0_f32; width * height];
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let gradient = picture.gradient(x, y);
            gradients[y * width + x] = gradient;
            magnitudes[y * width + x] = gradient.norm();
        }
    }
    for y in REACH..height - REACH {
        for x in REACH..width - REACH {
            let index = y * width + x;
            let (gradient, middle) = (gradients[index], magnitudes[index]);
            if middle < weak || middle <= 0.0 {
                continue;
            }
            let along_x = gradient.x.abs() >= gradient.y.abs();
            let step = if along_x { 1 } else { width };
            let (before, after) = (magnitudes[index - step], magnitudes[index + step]);
            if !(middle > before && middle >= after) {
                continue;
            }
            let offset = f64::from(0.5 * (before - after) / (before - 2.0 * middle + after));
            let shift = if along_x {
                Vector2::new(offset, 0.0)
            } else {
                Vector2::new(0.0, offset)
            };
            grid[index] = points.len() as u32;
            points.push(EdgePoint {
                place: Vector2::new(x as f64, y as f64) + shift,
                gradient,
            });
        }
    }
    (points, grid)
}

/// The next and the previous point of each point.
fn links(size: [usize; 2], points: &[EdgePoint], grid: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut next = vec![NO_POINT; points.len()];
    let mut previous = vec![NO_POINT; points.len()];
    for (here, point) in points.iter().enumerate() {
        let (forward, backward) = neighbours(size, points, grid, point);
        if forward != NO_POINT {
            connect(&mut next, &mut previous, points, here as u32, forward);
        }
        if backward != NO_POINT {
            connect(&mut next, &mut previous, points, backward, here as u32);
        }
    }
    (next, previous)
}

/// The nearest points ahead of a point and behind it, along the edge.
fn neighbours(
    size: [usize; 2],
    points: &[EdgePoint],
    grid: &[u32],
    point: &EdgePoint,
) -> (u32, u32) {
    let (x, y) = (
        point.place.x.round() as usize,
        point.place.y.round() as usize,
    );
    let mut nearest = [(NO_POINT, f64::INFINITY); 2];
    for row in y.saturating_sub(REACH)..=(y + REACH).min(size[1] - 1) {
        for column in x.saturating_sub(REACH)..=(x + REACH).min(size[0] - 1) {
            let other = grid[row * size[0] + column];
            if other == NO_POINT {
                continue;
            }
            let to = &points[other as usize];
            let step = to.place - point.place;
            let distance = step.norm();
            if distance == 0.0 || point.gradient.dot(&to.gradient) <= 0.0 {
                continue;
            }
            let gradient = point.gradient.cast::<f64>();
            let side = usize::from(gradient.y * step.x - gradient.x * step.y < 0.0);
            if distance < nearest[side].1 {
                nearest[side] = (other, distance);
            }
        }
    }
    (nearest[0].0, nearest[1].0)
}

/// Links two points unless one of them has a nearer partner; links to farther partners are removed.
fn connect(next: &mut [u32], previous: &mut [u32], points: &[EdgePoint], from: u32, to: u32) {
    let distance = |a: u32, b: u32| (points[a as usize].place - points[b as usize].place).norm();
    let length = distance(from, to);
    let (old_next, old_previous) = (next[from as usize], previous[to as usize]);
    if old_next == to
        || (old_next != NO_POINT && distance(from, old_next) <= length)
        || (old_previous != NO_POINT && distance(old_previous, to) <= length)
    {
        return;
    }
    if old_next != NO_POINT {
        previous[old_next as usize] = NO_POINT;
    }
    if old_previous != NO_POINT {
        next[old_previous as usize] = NO_POINT;
    }
    next[from as usize] = to;
    previous[to as usize] = from;
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 80;

    /// A bright disc on dark ground, with a soft edge.
    fn disc(centre: Vector2<f64>, radius: f64) -> Vec<f32> {
        (0..SIZE * SIZE)
            .map(|i| {
                let pixel = Vector2::new((i % SIZE) as f64, (i / SIZE) as f64);
                (100.0 / (1.0 + ((pixel - centre).norm() - radius).exp())) as f32
            })
            .collect()
    }

    #[test]
    fn the_edge_of_a_disc_is_one_ring_on_its_circle() {
        let centre = Vector2::new(39.3, 40.8);
        let values = disc(centre, 25.4);
        let picture = GreyFloats::new(SIZE, SIZE, &values).unwrap();
        let chains = edge_chains(&picture, 5.0, 10.0);
        assert_eq!(chains.len(), 1);
        assert!(chains[0].len() > 140, "{}", chains[0].len());
        for point in &chains[0] {
            let off = (point - centre).norm() - 25.4;
            assert!(off.abs() < 0.05, "{off}");
        }
    }

    #[test]
    fn weak_edges_and_tiny_pictures_have_no_chains() {
        let values = disc(Vector2::new(40.0, 40.0), 25.0);
        let picture = GreyFloats::new(SIZE, SIZE, &values).unwrap();
        assert!(edge_chains(&picture, 5.0, 50.0).is_empty());
        for (width, height) in [(1, 1), (3, 5), (0, 0)] {
            let picture = GreyFloats::new(width, height, &values[..width * height]).unwrap();
            assert!(edge_chains(&picture, 5.0, 10.0).is_empty());
        }
        assert!(GreyFloats::new(3, 3, &values).is_none());
    }
}
