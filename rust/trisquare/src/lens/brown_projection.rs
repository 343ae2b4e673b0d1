//! How the projection of a direction follows Brown's parameters.

use nalgebra::Vector2;

use super::brown::Brown;
use super::distortion::DistortionTerm;
use super::{INTRINSICS, Lens, ProjectionJacobian};

/// What the coefficients `k1, k2, k3, p1, p2` multiply.
const TERMS: [DistortionTerm; 5] = [
    DistortionTerm::Radial(2),
    DistortionTerm::Radial(4),
    DistortionTerm::Radial(6),
    DistortionTerm::TangentialY,
    DistortionTerm::TangentialX,
];

impl Brown {
    /// The derivative of the pixel by `fx, fy, cx, cy, k1, k2, k3, p1, p2`, at an ideal point.
    ///
    /// The pixel is `f u_d + c`, with `u_d = u + sum c_i s_i(u)` the observed point.
    pub(super) fn jacobian_of_projection(&self, ideal: &Vector2<f64>) -> ProjectionJacobian {
        let distorted = self.distort(ideal);
        let focal = self.focal();
        let mut jacobian = ProjectionJacobian::zeros();
        jacobian[(0, 0)] = distorted.x;
        jacobian[(1, 1)] = distorted.y;
        jacobian[(0, 2)] = 1.0;
        jacobian[(1, 3)] = 1.0;
        for (i, term) in TERMS.iter().enumerate() {
            jacobian.set_column(INTRINSICS + i, &term.shift(ideal).component_mul(&focal));
        }
        jacobian
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: [f64; 9] = [
        1000.0, 1010.0, 640.0, 470.0, -0.25, 0.12, -0.03, 0.002, -0.001,
    ];

    #[test]
    fn jacobian_agrees_with_central_differences() {
        let lens = Brown::new(PARAMETERS);
        for ideal in [Vector2::new(0.3, -0.4), Vector2::new(-0.5, 0.1)] {
            let jacobian = lens.jacobian_of_projection(&ideal);
            for i in 0..9 {
                // A change that moves the pixel by about a tenth of one.
                let step = if i < 4 { 0.1 } else { 1e-3 };
                let moved = |sign: f64| {
                    let mut parameters = PARAMETERS;
                    parameters[i] += sign * step;
                    let moved = Brown::new(parameters);
                    moved.project(&ideal.push(1.0)).unwrap()
                };
                let numeric = (moved(1.0) - moved(-1.0)) / (2.0 * step);
                let error = (numeric - jacobian.column(i)).norm();
                assert!(error < 1e-8 * (1.0 + numeric.norm()), "column {i}: {error}");
            }
        }
    }
}
