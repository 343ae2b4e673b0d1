//! The shape of a blur.

use crate::numeric::cdf_and_pdf;

/// Largest square of the box's share: above it, nothing is left for the lens and the pixel.
pub(super) const MAX_BOX_SQUARE: f64 = 0.97;

/// A symmetric density of variance 1: a box with normal blur.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlurShape {
    /// Square of the box's share of the variance.
    pub square: f64,
    /// Half the width of the box, and the standard deviation of the normal part.
    half_width: f64,
    spread: f64,
}

impl BlurShape {
    pub const NORMAL: Self = Self {
        square: 0.0,
        half_width: 0.0,
        spread: 1.0,
    };

    pub fn with_square(square: f64) -> Self {
        let share = square.clamp(0.0, MAX_BOX_SQUARE).sqrt();
        Self {
            square: share * share,
            half_width: (3.0 * share).sqrt(),
            spread: (1.0 - share).sqrt(),
        }
    }

    /// Integral of the density up to `z`, and the density.
    #[inline]
    pub fn step_and_density(&self, z: f64) -> (f64, f64) {
        match self.square {
            0.0 => cdf_and_pdf(z),
            _ => self.box_step_and_density(z),
        }
    }

    #[cold]
    fn box_step_and_density(&self, z: f64) -> (f64, f64) {
        let [upper, lower] = [z + self.half_width, z - self.half_width].map(|z| z / self.spread);
        let ((upper_cdf, upper_pdf), (lower_cdf, lower_pdf)) =
            (cdf_and_pdf(upper), cdf_and_pdf(lower));
        // x Phi(x) + phi(x) is the integral of Phi.
        let area = upper * upper_cdf + upper_pdf - lower * lower_cdf - lower_pdf;
        let inverse_width = 0.5 / self.half_width;
        (
            self.spread * inverse_width * area,
            inverse_width * (upper_cdf - lower_cdf),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_has_variance_one_and_the_fourth_cumulant_of_its_box() {
        for square in [0.0, 0.1, 0.5, 0.9, MAX_BOX_SQUARE] {
            let shape = BlurShape::with_square(square);
            let mut moments = [0.0; 3];
            let mut step = 0.0;
            const WIDTH: f64 = 1e-3;
            for index in -8000..8000 {
                let z = (f64::from(index) + 0.5) * WIDTH;
                let (value, density) = shape.step_and_density(z);
                step += density * WIDTH;
                assert!((step - value - 0.5 * density * WIDTH).abs() < 1e-5);
                for (k, moment) in moments.iter_mut().enumerate() {
                    *moment += density * z.powi(2 * k as i32) * WIDTH;
                }
            }
            let [mass, variance, fourth] = moments;
            assert!((mass - 1.0).abs() < 1e-6 && (variance - 1.0).abs() < 1e-5);
            assert!((fourth - 3.0 + 1.2 * square).abs() < 1e-4, "{square}");
        }
    }
}
