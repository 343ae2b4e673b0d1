//! The light cells of a tag's code beside the tag's side.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::flip::COMPLETE_BLURS;
use crate::numeric::cdf_and_pdf;

/// Distance from a light cell, in blurs, below which pixels are not used: they would require its
/// position too exactly.
const CLEARANCE: f64 = 1.0;

/// A tag, relative to one of its sides.
#[derive(Debug, Clone)]
pub(super) struct TagCells {
    /// Map from the picture to the position along the side, and to the depth beyond it, as
    /// fractions of the tag's.
    square_from_picture: Matrix3<f64>,
    /// Length of the side, and distance from it to the opposite one, pixels.
    size: [f64; 2],
    /// The side's unit normal, pointing into the tag.
    inwards: Vector2<f64>,
    /// Width of the dark border over the tag's side.
    border: f64,
    /// Whether each cell within the border is light, in rows from the side on.
    cells: Vec<Vec<bool>>,
}

impl TagCells {
    /// The tag between the ends of its side and, in the same order, of the opposite one.
    ///
    /// `None` if no homography maps a square to them.
    pub fn new(
        near: [Vector2<f64>; 2],
        far: [Vector2<f64>; 2],
        border: f64,
        cells: &[Vec<bool>],
    ) -> Option<Self> {
        let [along, beyond] = [near[1] - near[0], far[0] - near[0]];
        let length = along.norm();
        let area = along.perp(&beyond);
        let square_from_picture = picture_from_square(near, far).try_inverse()?;
        let is_finite = square_from_picture.iter().all(|entry| entry.is_finite());
        is_finite.then_some(Self {
            square_from_picture,
            size: [length, area.abs() / length],
            inwards: Vector2::new(-along.y, along.x) * (area.signum() / length),
            border,
            cells: cells.to_vec(),
        })
    }

    /// Position of a point, as fractions of the side and of the depth.
    fn place(&self, point: Vector2<f64>) -> [f64; 2] {
        let place = self.square_from_picture * Vector3::new(point.x, point.y, 1.0);
        [place.x / place.z, place.y / place.z]
    }

    /// Distance in blurs from a point to the first row of cells; positive before it.
    fn clearance(&self, point: Vector2<f64>, inverse_blur: f64) -> f64 {
        (self.border - self.place(point)[1]) * self.size[1] * inverse_blur
    }

    /// Whether the cells have no effect at a point.
    pub fn is_far(&self, point: Vector2<f64>, inverse_blur: f64) -> bool {
        self.clearance(point, inverse_blur) > COMPLETE_BLURS
    }

    /// Whether a point is too near to the cells.
    pub fn is_near(&self, point: Vector2<f64>, inverse_blur: f64) -> bool {
        self.clearance(point, inverse_blur) < CLEARANCE
    }

    /// Blurred coverage of a point by light cells: 1 inside a large light area, 0 far from any.
    pub fn light(&self, point: Vector2<f64>, inverse_blur: f64) -> f64 {
        let depth = self.place(point)[1];
        // Light that is blurred from the cells to here comes from straight across.
        let cell_distance = (self.border - depth).max(0.0) * self.size[1];
        let along = self.place(point + self.inwards * cell_distance)[0];
        let count = self.cells.len();
        let width = (1.0 - 2.0 * self.border) / count as f64;
        let step = |place: f64, cell: usize, axis: usize| {
            let edge = self.border + width * cell as f64;
            cdf_and_pdf((place - edge) * self.size[axis] * inverse_blur).0
        };
        let columns: Vec<f64> = (0..=count).map(|cell| step(along, cell, 0)).collect();
        let mut light = 0.0;
        let mut before = step(depth, 0, 1);
        for (row, cells) in self.cells.iter().enumerate() {
            let after = step(depth, row + 1, 1);
            let light_cells = cells.iter().zip(columns.windows(2));
            let light_cells = light_cells.filter(|(is_light, _)| **is_light);
            light += (before - after) * light_cells.map(|(_, ends)| ends[0] - ends[1]).sum::<f64>();
            if after < 1e-6 {
                break;
            }
            before = after;
        }
        light
    }
}

/// The homography that maps the unit square's corners to those of a quadrilateral (P. Heckbert,
/// Fundamentals of Texture Mapping and Image Warping, 1989, section 2.2.3).
fn picture_from_square(near: [Vector2<f64>; 2], far: [Vector2<f64>; 2]) -> Matrix3<f64> {
    let [start, end] = near;
    let (right, left) = (end - far[1], far[0] - far[1]);
    let sum = start - end + far[1] - far[0];
    let area = right.perp(&left);
    let (g, h) = (sum.perp(&left) / area, right.perp(&sum) / area);
    let (across, down) = (end - start + end * g, far[0] - start + far[0] * h);
    Matrix3::new(
        across.x, down.x, start.x, across.y, down.y, start.y, g, h, 1.0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tag of 3 x 3 cells within a border of .2, drawn as a square of 20 pixels.
    fn tag() -> TagCells {
        let corner = |x: f64, y: f64| Vector2::new(10.0 + 20.0 * x, 30.0 + 20.0 * y);
        let cells = [
            [true, false, false],
            [false, false, true],
            [true, true, true],
        ];
        TagCells::new(
            [corner(0.0, 0.0), corner(1.0, 0.0)],
            [corner(0.0, 1.0), corner(1.0, 1.0)],
            0.2,
            &cells.map(Vec::from),
        )
        .unwrap()
    }

    #[test]
    fn light_comes_from_the_light_cells() {
        let sharp = 1.0 / 0.05;
        let light = |x: f64, y: f64| {
            let point = Vector2::new(10.0 + 20.0 * x, 30.0 + 20.0 * y);
            tag().light(point, sharp)
        };
        assert!((light(0.3, 0.3) - 1.0).abs() < 1e-6);
        assert!(light(0.5, 0.3) < 1e-6 && light(0.5, 0.1) < 1e-6);
        assert!((light(0.7, 0.5) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn blur_brings_half_of_the_light_to_a_cells_edge() {
        let edge = Vector2::new(10.0 + 20.0 * 0.3, 30.0 + 20.0 * 0.2);
        assert!((tag().light(edge, 2.0) - 0.5).abs() < 1e-3);
        assert!(tag().is_near(edge, 2.0) && tag().is_far(edge - Vector2::y() * 2.5, 2.0));
    }

    #[test]
    fn corners_on_one_line_are_no_tag() {
        let at = |x: f64| Vector2::new(x, 0.0);
        assert!(TagCells::new([at(0.0), at(1.0)], [at(2.0), at(3.0)], 0.2, &[]).is_none());
    }
}
