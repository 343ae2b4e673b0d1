//! Where a figure lies on its plane.

use nalgebra::{Vector2, Vector3};

use crate::geometry::Line;

/// A figure's place on its plane: `P_plane = scale R(angle) P_figure + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    pub scale: f64,
    pub angle: f64,
    pub shift: Vector2<f64>,
    /// How many of scale, angle, shift x, shift y are estimated: 0, 1 or 4.
    pub free: usize,
}

impl Placement {
    /// The plane's own coordinates.
    pub const IDENTITY: Self = Self {
        scale: 1.0,
        angle: 0.0,
        shift: Vector2::new(0.0, 0.0),
        free: 0,
    };

    /// The line `(a, b, c)` in the plane's coordinates: normal `R n`, offset
    /// `scale c - (R n) . shift`.
    pub fn line(&self, line: &Line) -> Vector3<f64> {
        let normal = self.rotate(line.normal());
        let offset = self.scale * line.coefficients().z - normal.dot(&self.shift);
        Vector3::new(normal.x, normal.y, offset)
    }

    /// Derivatives of [`Self::line`] with respect to scale, angle, shift x, shift y.
    pub fn line_derivatives(&self, line: &Line) -> [Vector3<f64>; 4] {
        let normal = self.rotate(line.normal());
        let turned = Vector2::new(-normal.y, normal.x);
        [
            Vector3::new(0.0, 0.0, line.coefficients().z),
            Vector3::new(turned.x, turned.y, -turned.dot(&self.shift)),
            Vector3::new(0.0, 0.0, -normal.x),
            Vector3::new(0.0, 0.0, -normal.y),
        ]
    }

    /// A point of the figure on the plane.
    pub fn point(&self, point: Vector2<f64>) -> Vector2<f64> {
        self.rotate(point) * self.scale + self.shift
    }

    /// The placement after a step of its free parameters.
    pub fn moved(&self, step: &[f64]) -> Self {
        let mut next = *self;
        if let [scale, rest @ ..] = step {
            next.scale += scale;
            if let [angle, x, y] = rest {
                next.angle += angle;
                next.shift += Vector2::new(*x, *y);
            }
        }
        next
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
            scale: 0.6,
            angle: 0.7,
            shift: Vector2::new(0.1, -0.3),
            free: 4,
        };
        let line = Line::new(0.6, -0.8, 0.2).unwrap();
        let on_line = Vector2::new(0.4, 0.55);
        assert!(line.distance(&on_line).abs() < 1e-15);
        let moved = placement.line(&line);
        assert!(moved.dot(&placement.point(on_line).push(1.0)).abs() < 1e-15);

        for (i, derivative) in placement.line_derivatives(&line).iter().enumerate() {
            let mut step = [0.0; 4];
            step[i] = 1e-6;
            let forward = placement.moved(&step).line(&line);
            step[i] = -1e-6;
            let backward = placement.moved(&step).line(&line);
            assert!(((forward - backward) / 2e-6 - derivative).norm() < 1e-9);
        }
    }
}
