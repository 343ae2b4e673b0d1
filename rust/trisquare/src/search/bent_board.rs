//! Test data: crossings of a board of 10 x 8, seen by a camera with distortion.

use std::ops::Range;

use nalgebra::{Rotation3, Unit, Vector2, Vector3};

use super::lattice::{Lattice, Site};

/// Width and height of the picture.
pub(super) const SIZE: [usize; 2] = [1280, 960];

/// A board with cells of side 1.
pub(super) struct BentBoard {
    rotation: Rotation3<f64>,
    centre: Vector3<f64>,
}

impl BentBoard {
    /// A board rotated by some degrees about an oblique axis.
    pub fn turned(degrees: f64, centre: [f64; 3]) -> Self {
        let axis = Unit::new_normalize(Vector3::new(0.6, 0.8, 0.0));
        Self {
            rotation: Rotation3::from_axis_angle(&axis, degrees.to_radians()),
            centre: centre.into(),
        }
    }

    pub fn at(&self, row: f64, column: f64) -> Vector2<f64> {
        let place = self.rotation * Vector3::new(column - 4.5, row - 3.5, 0.0) + self.centre;
        let ideal = place.xy() / place.z;
        let square = ideal.norm_squared();
        let observed = ideal * (1.0 - 0.25 * square + 0.06 * square * square);
        observed * 1100.0 + Vector2::new(640.0, 480.0)
    }

    /// Crossings of some rows and columns, with errors of up to a fifth of a pixel.
    pub fn crossings(&self, rows: Range<isize>, columns: Range<isize>) -> Lattice {
        let sites = rows.flat_map(|row| columns.clone().map(move |column| (row, column)));
        let found = sites.map(|site| (site, self.at(site.0 as f64, site.1 as f64) + noise(site)));
        Lattice::of(&found.collect::<Vec<_>>(), true)
    }
}

fn noise((row, column): Site) -> Vector2<f64> {
    let part = |k: isize| ((row * 37 + column * 59 + k * 13) % 41) as f64 / 41.0 - 0.5;
    Vector2::new(part(1), part(2)) * 0.35
}

/// The same crossings with the last column as the first row.
pub(super) fn quarter_turned(lattice: &Lattice) -> Lattice {
    let last = lattice.size()[1] as isize - 1;
    let found = lattice
        .found()
        .map(|((row, column), point)| ((last - column, row), point));
    Lattice::of(&found.collect::<Vec<_>>(), !lattice.is_dark((0, last)))
}
