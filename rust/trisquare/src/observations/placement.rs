//! Placement of a figure on its plane.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::curve::{ModelLine, Radius};
use crate::geometry::Line;

/// A parameter of a placement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PlacementParameter {
    Stretch,
    Scale,
    Angle,
    ShiftX,
    ShiftY,
}

use PlacementParameter::{Angle, Scale, ShiftX, ShiftY, Stretch};

/// A figure's placement on its plane: `P_plane = scale R(angle) diag(stretch, 1) P_figure + shift`.
///
/// Circles about the figure's origin may have radii of their own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Placement {
    pub stretch: f64,
    pub scale: f64,
    pub angle: f64,
    pub shift: Vector2<f64>,
    /// Whether the figure consists of circles about its origin, which rotations about it do not
    /// change.
    pub is_round: bool,
    /// The estimated radii.
    pub radii: Vec<f64>,
    /// The other free parameters.
    pub free: &'static [PlacementParameter],
}

impl Placement {
    /// The plane's own coordinates.
    pub const IDENTITY: Self = Self {
        stretch: 1.0,
        scale: 1.0,
        angle: 0.0,
        shift: Vector2::new(0.0, 0.0),
        is_round: false,
        radii: Vec::new(),
        free: &[],
    };

    /// Free parameters of a figure of unknown size.
    pub const SIZE: &'static [PlacementParameter] = &[Scale];

    /// Free parameters of a figure of which only the shape is known.
    pub const SIMILARITY: &'static [PlacementParameter] = &[Scale, Angle, ShiftX, ShiftY];

    /// Free parameters of circles of which only the ratios are known.
    pub const SIZE_AND_CENTRE: &'static [PlacementParameter] = &[Scale, ShiftX, ShiftY];

    /// Free parameters of a rectangle of unknown aspect.
    pub const ASPECT: &'static [PlacementParameter] = &[Stretch];

    /// Free parameters of a line along X or along Y whose offset is unknown.
    pub fn offset(line: &Line) -> &'static [PlacementParameter] {
        match line.normal().y == 0.0 {
            true => &[ShiftX],
            false => &[ShiftY],
        }
    }

    /// Returns the line `(a, b, c)` in the plane's coordinates: with `(n, d)` the unit line
    /// `(a, stretch b, stretch c)`, it has the normal `R n` and the offset
    /// `scale d - (R n) . shift`.
    pub fn line(&self, line: &Line) -> Vector3<f64> {
        self.placed(&self.stretched(line).0)
    }

    /// Derivatives of [`Self::line`] with respect to the free parameters, in their order, and to
    /// the radii.
    pub fn line_derivatives(&self, model: &ModelLine) -> impl Iterator<Item = Vector3<f64>> {
        let placement = self;
        let radius_index = model.radius;
        let (stretched, wrt_stretch) = self.stretched(&model.line);
        let normal = self.rotate(stretched.xy());
        let tangent = Vector2::new(-normal.y, normal.x);
        let radius_derivative = move |k: usize| match radius_index == Some(k) {
            true => Vector3::new(0.0, 0.0, -placement.scale),
            false => Vector3::zeros(),
        };
        let parameter_derivative = move |parameter: &PlacementParameter| match parameter {
            Stretch => placement.placed(&wrt_stretch),
            Scale => Vector3::new(0.0, 0.0, stretched.z),
            Angle => tangent.push(-tangent.dot(&placement.shift)),
            ShiftX => Vector3::new(0.0, 0.0, -normal.x),
            ShiftY => Vector3::new(0.0, 0.0, -normal.y),
        };
        let radii = (0..self.radii.len()).map(radius_derivative);
        self.free.iter().map(parameter_derivative).chain(radii)
    }

    /// Number of free parameters, radii included.
    pub fn parameter_count(&self) -> usize {
        self.free.len() + self.radii.len()
    }

    /// Returns a radius, and its index if it is estimated.
    pub fn radius(&self, radius: Radius) -> (f64, Option<usize>) {
        match radius {
            Radius::Known(value) => (value, None),
            Radius::Free(index) => (self.radii[index], Some(index)),
        }
    }

    /// Returns the map of lines for a placement without stretch.
    pub fn line_map(&self) -> Matrix3<f64> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        Matrix3::from_columns(&axes.map(|axis| self.placed(&axis)))
    }

    /// Maps a point of the figure to the plane.
    pub fn point(&self, point: Vector2<f64>) -> Vector2<f64> {
        let stretched = Vector2::new(self.stretch * point.x, point.y);
        self.rotate(stretched) * self.scale + self.shift
    }

    /// Returns the placement after a step of its free parameters.
    pub fn moved(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        let (shape_step, radii) = step.split_at(self.free.len());
        for (parameter, change) in self.free.iter().zip(shape_step) {
            let value = match parameter {
                Stretch => &mut next.stretch,
                Scale => &mut next.scale,
                Angle => &mut next.angle,
                ShiftX => &mut next.shift.x,
                ShiftY => &mut next.shift.y,
            };
            *value += change;
        }
        for (radius, change) in next.radii.iter_mut().zip(radii) {
            *radius += change;
        }
        next
    }

    /// Returns a line of the stretched figure with a normal of unit length, and its derivative with
    /// respect to the stretch.
    fn stretched(&self, line: &Line) -> (Vector3<f64>, Vector3<f64>) {
        let line = line.coefficients();
        let image = Vector3::new(line.x, self.stretch * line.y, self.stretch * line.z);
        let derivative = Vector3::new(0.0, line.y, line.z);
        let norm = image.xy().norm();
        let unit = image / norm;
        let along = unit.xy().dot(&derivative.xy());
        (unit, (derivative - unit * along) / norm)
    }

    /// Rotates, scales and shifts a line or a change of one.
    fn placed(&self, line: &Vector3<f64>) -> Vector3<f64> {
        let normal = self.rotate(line.xy());
        normal.push(self.scale * line.z - normal.dot(&self.shift))
    }

    fn rotate(&self, v: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.angle.sin_cos();
        Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placement_moves_lines_with_their_points() {
        let placement = Placement {
            stretch: 1.3,
            scale: 0.6,
            angle: 0.7,
            shift: Vector2::new(0.1, -0.3),
            free: &[Stretch, Scale, Angle, ShiftX, ShiftY],
            ..Placement::IDENTITY
        };
        let line = Line::new(0.6, -0.8, 0.2).unwrap();
        let on_line = Vector2::new(0.4, 0.55);
        assert!(line.distance(&on_line).abs() < 1e-15);
        let moved = placement.line(&line);
        assert!(moved.dot(&placement.point(on_line).push(1.0)).abs() < 1e-15);

        for (i, derivative) in placement.line_derivatives(&line.into()).enumerate() {
            let mut step = [0.0; 5];
            step[i] = 1e-6;
            let forward = placement.moved(&step).line(&line);
            step[i] = -1e-6;
            let backward = placement.moved(&step).line(&line);
            assert!(((forward - backward) / 2e-6 - derivative).norm() < 1e-9);
        }
    }

    #[test]
    fn a_tangent_follows_its_own_radius_alone() {
        let placement = Placement {
            scale: 0.6,
            radii: vec![0.8, 1.7],
            free: Placement::SIZE_AND_CENTRE,
            ..Placement::IDENTITY
        };
        let tangent = |placement: &Placement| {
            let (radius, index) = placement.radius(Radius::Free(1));
            ModelLine::tangent(Vector2::new(0.6, -0.8), radius, index)
        };
        let derivatives: Vec<_> = placement.line_derivatives(&tangent(&placement)).collect();
        assert_eq!(derivatives.len(), placement.parameter_count());
        for (i, derivative) in derivatives.iter().enumerate() {
            let mut step = [0.0; 5];
            step[i] = 1e-6;
            let ahead = placement.moved(&step);
            step[i] = -1e-6;
            let behind = placement.moved(&step);
            let difference =
                ahead.line(&tangent(&ahead).line) - behind.line(&tangent(&behind).line);
            assert!((difference / 2e-6 - derivative).norm() < 1e-9);
        }
        let map = placement.line_map();
        let line = tangent(&placement).line;
        assert!((map * line.coefficients() - placement.line(&line)).norm() < 1e-15);
    }
}
