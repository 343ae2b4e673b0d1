//! Convex outlines of lattices: crossings within one have been found already.

use nalgebra::Vector2;

use super::lattice::{Lattice, STEPS};

/// Tolerance, square pixels, for points on an edge of the outline to be inside despite rounding.
const ROUNDING: f64 = 1e-6;

/// A convex polygon, clockwise on the screen.
///
/// Its corners have single precision, so that some of the lattice's own outermost crossings are
/// outside by 1e-5 pixels: crossings at a fold may belong to the neighbour, too.
#[derive(Debug, Clone)]
pub(super) struct Outline(Vec<Vector2<f64>>);

impl Outline {
    /// The outline of a lattice's crossings.
    pub fn of(lattice: &Lattice) -> Self {
        Self::around(lattice.points().collect())
    }

    /// The outline of a lattice with a rim of one cell.
    pub fn with_rim(lattice: &Lattice) -> Self {
        let mut points: Vec<_> = lattice.points().collect();
        for step in [STEPS[0], STEPS[1]] {
            for (_, [start, end]) in lattice.links(step) {
                points.extend([end * 2.0 - start, start * 2.0 - end]);
            }
        }
        Self::around(points)
    }

    /// The convex hull, in single precision, by Andrew's monotone chain (Information Processing
    /// Letters 9 (1979) 216).
    fn around(mut points: Vec<Vector2<f64>>) -> Self {
        points
            .iter_mut()
            .for_each(|p| *p = p.map(|x| f64::from(x as f32)));
        points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        let forth = half_hull(points.iter());
        let back = half_hull(points.iter().rev());
        Self([forth, back].concat())
    }

    /// Whether a point is within or on the outline.
    pub fn covers(&self, point: Vector2<f64>) -> bool {
        self.0.len() > 2
            && self
                .edges()
                .all(|[start, end]| (end - start).perp(&(point - start)) > -ROUNDING)
    }

    /// Whether a point is within the outline, or nearer to it than some distance.
    pub fn is_near(&self, point: Vector2<f64>, distance: f64) -> bool {
        self.covers(point)
            || self
                .edges()
                .any(|edge| distance_to_segment(point, edge) < distance)
    }

    fn edges(&self) -> impl Iterator<Item = [Vector2<f64>; 2]> {
        let next = self.0.iter().cycle().skip(1);
        self.0.iter().zip(next).map(|(start, end)| [*start, *end])
    }
}

/// The hull from the first point to the last one, which is left out, with the other points on the
/// right-hand side.
fn half_hull<'a>(points: impl Iterator<Item = &'a Vector2<f64>>) -> Vec<Vector2<f64>> {
    let mut hull: Vec<Vector2<f64>> = Vec::new();
    for point in points {
        while let [.., before, last] = hull[..]
            && !((last - before).perp(&(point - last)) > 0.0)
        {
            hull.pop();
        }
        hull.push(*point);
    }
    hull.pop();
    hull
}

fn distance_to_segment(point: Vector2<f64>, [start, end]: [Vector2<f64>; 2]) -> f64 {
    let segment = end - start;
    let fraction = (point - start).dot(&segment) / segment.norm_squared();
    (start + segment * fraction.clamp(0.0, 1.0) - point).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Lattice {
        let sites = (0..3).flat_map(|row| (0..3).map(move |column| (row, column)));
        let found: Vec<_> = sites
            .map(|(r, c)| ((r, c), Vector2::new(c as f64, r as f64) * 10.0))
            .collect();
        Lattice::of(&found, true)
    }

    #[test]
    fn an_outline_covers_its_crossings_and_what_is_between_them() {
        let outline = Outline::of(&square());
        assert!(square().points().all(|point| outline.covers(point)));
        assert!(outline.covers(Vector2::new(3.0, 17.0)));
        assert!(!outline.covers(Vector2::new(20.1, 10.0)));
        assert!(outline.is_near(Vector2::new(20.9, 20.9), 1.3));
        assert!(!outline.is_near(Vector2::new(20.9, 20.9), 1.2));
    }

    #[test]
    fn the_rim_is_a_cell_wide() {
        let outline = Outline::with_rim(&square());
        assert!(outline.covers(Vector2::new(-9.9, 10.0)));
        assert!(outline.covers(Vector2::new(10.0, 29.9)));
        assert!(!outline.covers(Vector2::new(29.0, 29.0)));
    }

    #[test]
    fn fewer_than_three_points_cover_nothing() {
        for count in 0..3 {
            let line: Vec<_> = (0..count).map(|c| ((0, c), Vector2::repeat(5.0))).collect();
            let outline = Outline::of(&Lattice::of(&line, true));
            assert!(!outline.covers(Vector2::repeat(5.0)));
            assert!(!outline.is_near(Vector2::repeat(50.0), 10.0));
        }
    }
}
