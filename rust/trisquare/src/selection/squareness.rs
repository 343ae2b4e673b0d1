//! Deviation of a figure from a square under a given camera: two numbers, and their covariance by
//! the figure's edges.
//!
//! A square's homography has columns that the camera turns into perpendicular vectors of equal
//! length (Hartley & Zisserman, 2nd ed., section 8.5). The deviations, the cosine between them and
//! the logarithm of their ratio, are what remains of the eight parameters of four lines after the
//! six of a pose.

use nalgebra::{Matrix2, Matrix2x4, SMatrix, SVector, Vector2, Vector3, Vector4};

use crate::error::Error;
use crate::geometry::Line;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::linear::{Undistortion, homography_of_figure};
use crate::observations::ObservedPlane;

/// Standard deviation of a displacement of a whole side (px): the error of a distortion estimated
/// from straightness alone, about an uncertain centre.
const SIDE_ERROR: f64 = 0.1;

/// Standard deviation of the deviation itself: accuracy with which paper is cut and squares are
/// printed.
const MIN_DEVIATION: f64 = 0.003;

/// Standard deviation of the assumed centre of distortion, over half the diagonal: the scatter of
/// ordinary cameras' principal points about the image centre.
const CENTRE_ERROR: f64 = 0.03;

/// Step of a numerical derivative, over half the diagonal.
const STEP: f64 = 1e-3;

/// A pinhole camera, in units of half the image diagonal about the image centre: logarithms of
/// the focal length and of the aspect `fy / fx`, and the principal point.
pub(crate) type Pinhole = Vector4<f64>;

/// A plane's first figure, undistorted.
#[derive(Clone)]
pub(crate) struct CandidatePlane {
    /// The first two columns of its homography.
    columns: [Vector3<f64>; 2],
    /// Their covariance.
    covariance: SMatrix<f64, 6, 6>,
    /// Standard deviation of the deviation from causes other than its edges.
    floor: f64,
    /// Whether a rectangle of any aspect is expected: only the cosine is a deviation then.
    has_any_aspect: bool,
}

/// Deviation of a candidate under a camera.
pub(crate) struct Deviation {
    /// Cosine between the sides, and logarithm of their ratio.
    pub value: Vector2<f64>,
    pub covariance: Matrix2<f64>,
    pub wrt_camera: Matrix2x4<f64>,
    /// Whether the ratio of the sides is uninformative.
    pub has_any_aspect: bool,
    /// Directions of the sides in the camera's frame, not quite perpendicular.
    pub directions: [Vector3<f64>; 2],
}

impl CandidatePlane {
    /// The undistorted first figure of a plane.
    ///
    /// # Errors
    /// If the figure has no homography.
    pub fn of<L: Lens>(
        plane: &ObservedPlane,
        undistortion: &Undistortion<L>,
        size: ImageSize,
    ) -> Result<Self, Error> {
        let figure = &plane.figures[0];
        let degenerate = |reason| Error::DegenerateHomography {
            figure: figure.index,
            reason,
        };
        let (homography, _) = homography_of_figure(figure, None, undistortion)?;
        let (centre, unit) = (size.centre(), size.half_diagonal());
        let mut normalised = homography;
        for column in 0..3 {
            let z = homography[(2, column)];
            normalised[(0, column)] = (homography[(0, column)] - centre.x * z) / unit;
            normalised[(1, column)] = (homography[(1, column)] - centre.y * z) / unit;
        }
        normalised /= normalised.norm();
        let inverse = normalised
            .try_inverse()
            .ok_or_else(|| degenerate("it is singular"))?;

        let mut information = SMatrix::<f64, 9, 9>::zeros();
        let mut middle = Vector2::zeros();
        for side in &figure.sides {
            let line = side
                .line()
                .ok_or_else(|| degenerate("it has no straight sides"))?;
            let image = inverse.transpose() * line.coefficients();
            let image = image / image.xy().norm();
            let mut ideal = Vec::with_capacity(side.samples.len());
            for sample in &side.samples {
                let pixel = undistortion.undistort(&sample.pixel);
                let pixel = pixel.ok_or_else(|| degenerate("a sample cannot be undistorted"))?;
                ideal.push((pixel - centre) / unit);
            }
            let line = Line::fit(ideal.iter().map(|p| (*p, 1.0)));
            let line = line.ok_or_else(|| degenerate("all samples of a line coincide"))?;
            let count = ideal.len() as f64;
            let residual_variance =
                ideal.iter().map(|p| line.distance(p).powi(2)).sum::<f64>() / count;
            let variance = residual_variance + (SIDE_ERROR / unit).powi(2);
            for pixel in &ideal {
                // A change of the homography changes the line's image by -H^-T dH^T l.
                let point = inverse * pixel.push(1.0);
                let gradient = SVector::<f64, 9>::from_fn(|i, _| image[i % 3] * point[i / 3]);
                information.ger(1.0 / (count * variance), &gradient, &gradient, 1.0);
            }
            middle += ideal.iter().sum::<Vector2<f64>>() / count;
        }
        middle /= figure.sides.len() as f64;
        // The homography's scale is undetermined, and changes no deviation.
        let scale = SVector::<f64, 9>::from_iterator(normalised.iter().copied());
        information.ger(information.trace(), &scale, &scale, 1.0);
        let covariance = information
            .cholesky()
            .ok_or_else(|| degenerate("its lines leave it open"))?
            .inverse();
        let anisotropy_at = |rho: f64| anisotropy(undistortion, size, rho);
        let radius = middle.norm();
        let slope =
            (anisotropy_at(radius + STEP) - anisotropy_at((radius - STEP).abs())) / (2.0 * STEP);
        Ok(Self {
            columns: [0, 1].map(|i| normalised.column(i).into_owned()),
            covariance: covariance.fixed_view::<6, 6>(0, 0).into_owned(),
            floor: MIN_DEVIATION + CENTRE_ERROR * slope.abs(),
            has_any_aspect: plane.has_any_aspect(),
        })
    }

    /// The deviation from a square under a camera; `None` if it is not finite.
    pub fn deviation(&self, camera: &Pinhole) -> Option<Deviation> {
        let fx = camera[0].exp();
        let fy = fx * camera[1].exp();
        let (cx, cy) = (camera[2], camera[3]);
        let ray =
            |h: &Vector3<f64>| Vector3::new((h.x - cx * h.z) / fx, (h.y - cy * h.z) / fy, h.z);
        let [first, second] = [ray(&self.columns[0]), ray(&self.columns[1])];
        let (first_norm, second_norm) = (first.norm(), second.norm());
        let cosine = first.dot(&second) / (first_norm * second_norm);
        let mut value = Vector2::new(cosine, (first_norm / second_norm).ln());
        let wrt_rays = [
            [
                second / (first_norm * second_norm) - first * (cosine / (first_norm * first_norm)),
                first / (first_norm * second_norm)
                    - second * (cosine / (second_norm * second_norm)),
            ],
            [
                first / (first_norm * first_norm),
                -second / (second_norm * second_norm),
            ],
        ];
        let mut wrt_columns = SMatrix::<f64, 2, 6>::zeros();
        let mut wrt_camera = Matrix2x4::<f64>::zeros();
        for (row, gradients) in wrt_rays.iter().enumerate() {
            for (which, gradient) in gradients.iter().enumerate() {
                let ray = [first, second][which];
                let depth = self.columns[which].z;
                let (x, y) = (gradient.x / fx, gradient.y / fy);
                let wrt_column = Vector3::new(x, y, gradient.z - cx * x - cy * y);
                wrt_columns
                    .fixed_view_mut::<1, 3>(row, 3 * which)
                    .copy_from(&wrt_column.transpose());
                wrt_camera[(row, 0)] -= gradient.x * ray.x + gradient.y * ray.y;
                wrt_camera[(row, 1)] -= gradient.y * ray.y;
                wrt_camera[(row, 2)] -= x * depth;
                wrt_camera[(row, 3)] -= y * depth;
            }
        }
        let mut covariance = wrt_columns * self.covariance * wrt_columns.transpose();
        covariance[(0, 0)] += self.floor * self.floor;
        covariance[(1, 1)] += self.floor * self.floor;
        if self.has_any_aspect {
            value.y = 0.0;
            wrt_camera.row_mut(1).fill(0.0);
            covariance = Matrix2::from_diagonal(&Vector2::new(covariance.m11, 1.0));
        }
        let is_finite = value.iter().chain(covariance.iter()).all(|v| v.is_finite());
        (is_finite && wrt_camera.iter().all(|v| v.is_finite())).then(|| Deviation {
            value,
            covariance,
            wrt_camera,
            has_any_aspect: self.has_any_aspect,
            directions: [first / first_norm, second / second_norm],
        })
    }
}

/// Excess of the distortion's radial stretch of a small figure over its tangential stretch.
fn anisotropy<L: Lens>(undistortion: &Undistortion<L>, size: ImageSize, rho: f64) -> f64 {
    let Undistortion::Straightened(straightening) = undistortion else {
        return 0.0;
    };
    let unit = size.half_diagonal();
    let radius = rho.max(STEP) * unit;
    let step = STEP * unit;
    let ideal = |r: f64| straightening.ideal_radius(r);
    let radial_stretch = (ideal(radius + step) - ideal(radius - step)) / (2.0 * step);
    radial_stretch - ideal(radius) / radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::DefaultLens;
    use crate::linear::Straightening;
    use crate::observations::sort_by_plane;
    use crate::synthetic::{Scene, SceneOptions};

    fn candidates(noise: f64) -> (Vec<CandidatePlane>, Pinhole) {
        let options = SceneOptions {
            distortion: false,
            ..SceneOptions::default()
        };
        let scene = Scene::random(3, options);
        let planes = sort_by_plane(&scene.edges(1, noise, 10.0)).unwrap();
        let known = Undistortion::<DefaultLens>::Straightened(Straightening::identity(scene.size));
        let all = planes
            .iter()
            .map(|p| CandidatePlane::of(p, &known, scene.size).unwrap());
        let unit = scene.size.half_diagonal();
        let focal = scene.camera.focal();
        let offset = (scene.camera.principal_point() - scene.size.centre()) / unit;
        let camera = Pinhole::new(
            (focal.x / unit).ln(),
            (focal.y / focal.x).ln(),
            offset.x,
            offset.y,
        );
        (all.collect(), camera)
    }

    #[test]
    fn a_square_does_not_deviate_for_its_own_camera() {
        let (all, camera) = candidates(0.0);
        for candidate in &all {
            assert!(candidate.deviation(&camera).unwrap().value.norm() < 1e-9);
            let other = camera + Pinhole::new(0.1, 0.0, 0.0, 0.0);
            assert!(candidate.deviation(&other).unwrap().value.norm() > 1e-3);
        }
    }

    #[test]
    fn its_derivative_agrees_with_central_differences() {
        let (all, camera) = candidates(0.0);
        let camera = camera + Pinhole::new(0.2, 0.1, -0.05, 0.08);
        for candidate in &all {
            let found = candidate.deviation(&camera).unwrap();
            for i in 0..4 {
                let step = Pinhole::ith(i, 1e-6);
                let ahead = candidate.deviation(&(camera + step)).unwrap().value;
                let behind = candidate.deviation(&(camera - step)).unwrap().value;
                let numerical = (ahead - behind) / 2e-6;
                assert!((numerical - found.wrt_camera.column(i)).norm() < 1e-7);
            }
        }
    }
}
