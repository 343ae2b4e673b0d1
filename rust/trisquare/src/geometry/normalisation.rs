//! The similarity that makes linear estimates well-conditioned.

use nalgebra::{Matrix3, Vector2};

use super::line::Line;

/// The similarity `p -> scale (p - centre)` that brings points to zero mean and rms sqrt(2).
///
/// Line and point estimates are ill-conditioned in raw pixels (Zeng, Deng & Hu, Pattern
/// Recognition Letters 29 (2008) 1236-1244).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normalisation {
    /// The points' mean.
    pub centre: Vector2<f64>,
    /// `sqrt(2)` over the points' rms distance from their mean.
    pub scale: f64,
}

impl Normalisation {
    /// Measures the similarity on points; `None` if they all coincide.
    pub fn of_points<'a>(points: impl Iterator<Item = &'a Vector2<f64>> + Clone) -> Option<Self> {
        let count = points.clone().count() as f64;
        let centre = points.clone().sum::<Vector2<f64>>() / count;
        let square: f64 = points.map(|p| (p - centre).norm_squared()).sum::<f64>() / count;
        let scale = (2.0 / square).sqrt();
        scale.is_finite().then_some(Self { centre, scale })
    }

    /// Measures the similarity on lines: the centre is the point nearest to all of them, the scale
    /// `sqrt(2)` over their rms distance from it.
    pub fn of_lines(lines: &[Line]) -> Option<Self> {
        let mut scatter = nalgebra::Matrix2::zeros();
        let mut moment = Vector2::zeros();
        for line in lines {
            let normal = line.normal();
            scatter += normal * normal.transpose();
            moment -= normal * line.coefficients().z;
        }
        let centre = scatter.try_inverse()? * moment;
        let square: f64 = lines
            .iter()
            .map(|l| l.distance(&centre).powi(2))
            .sum::<f64>();
        let scale = (2.0 * lines.len() as f64 / square).sqrt();
        (scale.is_finite() && scale > 0.0).then_some(Self { centre, scale })
    }

    /// The matrix that maps homogeneous points.
    pub fn matrix(&self) -> Matrix3<f64> {
        let (s, c) = (self.scale, self.centre);
        Matrix3::new(s, 0.0, -s * c.x, 0.0, s, -s * c.y, 0.0, 0.0, 1.0)
    }

    /// The matrix that maps homogeneous points back.
    pub fn inverse(&self) -> Matrix3<f64> {
        let (s, c) = (1.0 / self.scale, self.centre);
        Matrix3::new(s, 0.0, c.x, 0.0, s, c.y, 0.0, 0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalisation_has_zero_mean_and_rms_sqrt_2() {
        let points = [(3.0, 4.0), (10.0, -2.0), (5.0, 5.0)].map(|(x, y)| Vector2::new(x, y));
        let normalisation = Normalisation::of_points(points.iter()).unwrap();
        let moved = points.map(|p| (normalisation.matrix() * p.push(1.0)).xy());
        let mean: Vector2<f64> = moved.iter().sum();
        let square: f64 = moved.iter().map(|p| p.norm_squared()).sum::<f64>() / 3.0;
        assert!(mean.norm() < 1e-14 && (square - 2.0).abs() < 1e-14);
        let identity = normalisation.matrix() * normalisation.inverse();
        assert!((identity - Matrix3::identity()).norm() < 1e-12);
    }
}
