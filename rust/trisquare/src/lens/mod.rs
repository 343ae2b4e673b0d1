//! Lenses: from rays to pixels and back, and the distance of a pixel to the image of a line.
//!
//! The residual of all refinements is the distance, in pixels of the photograph, of a sample to the
//! image of a straight line. A lens therefore only has to provide the ray of a pixel, and the
//! derivatives of that distance with respect to its parameters.

mod brown;
mod brown_model;
mod columns;
mod distortion;
mod families;
mod fisheye;
mod line_derivatives;
mod line_image;
mod picture_view;
mod plane_distortion;
mod plane_inverse;
mod point_maps;
mod radial;
mod rational;
mod rational_model;
mod rational_radius;
#[cfg(feature = "serde")]
pub mod stored;
mod turned_lenses;
mod undistorted_view;
mod undistortion_map;

pub use brown::Brown;
pub use brown_model::BrownModel;
pub use columns::Columns;
pub use distortion::{Distortion, DistortionTerm};
pub use families::{LensFamily, NearestLens};
pub use fisheye::{Fisheye, FisheyeModel, FisheyePixelRay};
pub(crate) use line_image::{LineImage, PixelLanes};
pub use picture_view::{PictureView, Surface};
pub use plane_distortion::PlanePixelRay;
pub use point_maps::PointMaps;
pub(crate) use point_maps::of_all;
pub(crate) use radial::{covering_coefficients, increases_up_to, sign_changes};
pub use radial::{invertible_radius, monotonic_radius};
pub use rational::{OpenCvLens, Rational, ThinPrism};
pub use rational_model::{OpenCvModel, RationalModel, ThinPrismModel};
pub use turned_lenses::{SeenAgain, TurnedLenses};
pub use undistorted_view::UndistortedView;
pub use undistortion_map::{UndistortionMap, largest_rectangle};

use std::fmt::Debug;
use std::ops::Range;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix3x2, SMatrix, Vector2, Vector3};

use crate::image_size::ImageSize;

/// The lens of most cameras, used by a calibration that does not specify one.
pub type DefaultLens = Brown;

/// Number of the first parameters of every lens, `fx, fy, cx, cy`. The distortion coefficients
/// follow, then [`SKEW`] if the lens has that parameter.
pub const INTRINSICS: usize = 4;

/// Maximum number of parameters of a lens, the two offsets of its centre of distortion included.
pub const MAX_LENS_COLUMNS: usize = 19;

/// Tolerance of the position of a lens's rim, pixels.
const RIM_TOLERANCE: f64 = 1e-6;

/// Maximum number of bisections to find the rim: floats have no more digits.
const MAX_HALVINGS: usize = 64;

/// Name of the skew parameter (pixels), the last one of a lens: it slants the columns of the sensor
/// against its rows.
pub const SKEW: &str = "skew";

/// Name of all distortion coefficients of a lens together, in lists of what is held fixed.
pub(crate) const DISTORTION: &str = "distortion";

/// Names of the parameters of the camera matrix.
pub(crate) const MATRIX: [&str; INTRINSICS + 1] = ["fx", "fy", "cx", "cy", SKEW];

/// Derivatives of a pixel with respect to the lens parameters; columns without a parameter are
/// zero.
pub type ProjectionJacobian = SMatrix<f64, 2, MAX_LENS_COLUMNS>;

/// Signed distance of a pixel to the image of a line, with its derivatives.
///
/// `value = l.x / |d(l.x)/dp|` (Sampson), in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineDistance {
    /// The distance, in pixels.
    pub value: f64,
    /// Derivative with respect to the line `l` (a plane through the camera centre).
    pub wrt_line: Vector3<f64>,
    /// Derivatives with respect to the lens parameters, then the two centre columns.
    pub wrt_lens: [f64; MAX_LENS_COLUMNS],
}

/// Lens model: the distortion coefficients of a lens that are estimated.
pub trait DistortionModel: Copy + Debug + Default + PartialEq + Send + Sync + 'static {
    /// All models of the lens, each nested in the next: it equals the next one with some
    /// coefficients at zero.
    const NESTED: &'static [Self];

    /// Columns of the model's coefficients, all of them from [`INTRINSICS`] on.
    fn columns(self) -> Columns;

    /// Number of radial coefficients (0 to 2) by which the linear steps straighten the picture; 0
    /// for a model that images straight lines as straight.
    fn straightening_coefficients(self) -> usize;

    /// Name by which the model is selected.
    fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Returns the next poorer model, from whose optimum the search for this one starts; `None`
    /// unless this model is richer than the default, because the others do not need that start.
    fn poorer(self) -> Option<Self> {
        let place = |model: Self| Self::NESTED.iter().position(|other| *other == model);
        let (index, default_index) = (place(self)?, place(Self::default())?);
        (index > default_index).then(|| Self::NESTED[index - 1])
    }

    /// Returns the models richer than this one, the poorest first.
    fn richer(self) -> &'static [Self] {
        let index = Self::NESTED.iter().position(|other| *other == self);
        index.map_or(&[], |index| &Self::NESTED[index + 1..])
    }

    /// Columns of the coefficients that the default model does not have: pictures seldom determine
    /// them, so that they need a prior.
    fn further_columns(self) -> Columns {
        self.columns().without(Self::default().columns())
    }
}

/// A lens, as the whole pipeline uses it.
///
/// Viewing directions are 3-vectors of any length: no code outside a lens assumes that their third
/// component is positive.
pub trait Lens: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// An unprojected pixel, with the quantities that its derivatives need.
    type PixelRay: Copy;

    /// Lens model: the coefficients that are estimated.
    type Model: DistortionModel;

    /// Names of the parameters, in the order of the Jacobian's columns: `fx, fy, cx, cy`, then the
    /// distortion coefficients, then [`SKEW`] if the lens has that parameter. At most
    /// [`MAX_LENS_COLUMNS`], the centre's columns included.
    fn parameter_names() -> &'static [&'static str];

    /// The two columns after those of the parameters, for an offset of the centre of distortion
    /// from the principal point. The offset is not a parameter; its columns show what the planes
    /// alone determine of the camera. Empty for a lens whose projection law itself determines the
    /// principal point, because no coefficients can cancel that law.
    ///
    /// With `d` the distortion of the normalised plane, they are the derivatives with respect to
    /// `e`, in units of that plane, at 0 of the lens that sees the point `u` at `e + d(u - e)`.
    /// [`line_distance_jacobian`](Self::line_distance_jacobian) returns them in its `wrt_lens`,
    /// like those of the parameters.
    fn centre_columns() -> Range<usize>;

    /// Creates the lens without distortion coefficients that projects the neighbourhood of its axis
    /// as a pinhole with this camera matrix does.
    fn from_camera_matrix(camera_matrix: &Matrix3<f64>) -> Self;

    /// Creates the lens with which the refinement starts.
    ///
    /// `ideal_radius` is the result of the linear steps: it maps an observed distance from the
    /// principal point, in pixels, to the distance at which the pinhole of the camera matrix would
    /// see the same point.
    fn from_straightening(
        camera_matrix: &Matrix3<f64>,
        ideal_radius: impl Fn(f64) -> f64,
        size: ImageSize,
        model: Self::Model,
    ) -> Self;

    /// `fx, fy, cx, cy`, in pixels.
    fn intrinsics(&self) -> [f64; INTRINSICS];

    /// The skew, in pixels; zero for a lens without that parameter.
    fn skew(&self) -> f64 {
        0.0
    }

    /// The column of the skew, if the lens has that parameter.
    fn skew_column() -> Option<usize> {
        Self::parameter_names()
            .iter()
            .position(|name| *name == SKEW)
    }

    /// The values of the parameters, in the order of their names.
    fn parameters(&self) -> Vec<f64>;

    /// Returns the lens with other parameter values, in the order of their names.
    ///
    /// # Panics
    /// If there are not as many values as [`Self::parameter_names`].
    #[must_use]
    fn with_parameters(&self, parameters: &[f64]) -> Self;

    /// The distortion coefficients in OpenCV's order, those that are not estimated included.
    fn distortion(&self) -> Vec<f64>;

    /// Prior standard deviations of the distortion coefficients, from their usual spread over
    /// lenses.
    fn coefficient_priors(&self, size: ImageSize) -> Vec<f64>;

    /// The pixel at which a point of camera coordinates is seen; `None` beyond the valid radius.
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>>;

    /// As [`Self::project`], but returns a pixel for points beyond the valid radius as well: each
    /// lens documents its extension.
    fn project_extended(&self, point: &Vector3<f64>) -> Vector2<f64>;

    /// Derivative, with respect to the parameters, of the projection of the direction seen at a
    /// pixel.
    fn projection_jacobian(&self, pixel_ray: &Self::PixelRay) -> ProjectionJacobian;

    /// Unprojects a pixel; `None` where the distortion is not invertible.
    fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Option<Self::PixelRay>;

    /// The direction along which a pixel looks, of any length.
    fn direction(&self, pixel_ray: &Self::PixelRay) -> Vector3<f64>;

    /// Derivative of [`Self::direction`] with respect to the pixel.
    fn direction_jacobian(&self, pixel_ray: &Self::PixelRay) -> Matrix3x2<f64>;

    /// The largest radius at which the lens is trusted, in its own measure: the tangent of the
    /// field angle for a distorted pinhole, the angle itself (radians) for a fisheye.
    fn valid_radius(&self) -> f64;

    /// Returns the same lens, trusted up to a smaller radius; a larger one has no effect.
    #[must_use]
    fn within(self, radius: f64) -> Self;

    /// The field angle, radians, up to which the lens is trusted.
    fn valid_angle(&self) -> f64;

    /// Distance from the principal point, in pixels, within which every pixel has a direction.
    fn valid_pixel_radius(&self) -> f64;

    /// Signed distance, in pixels, of a pixel to the image of the line `l`, and the unit normal of
    /// the image towards which it is positive.
    fn line_distance_and_normal(
        &self,
        pixel_ray: &Self::PixelRay,
        line: &Vector3<f64>,
    ) -> (f64, Vector2<f64>);

    /// Signed distance, in pixels, of a pixel with its ray to the image of the line `l`.
    fn line_distance(&self, pixel_ray: &Self::PixelRay, line: &Vector3<f64>) -> f64 {
        self.line_distance_and_normal(pixel_ray, line).0
    }

    /// The signed distance with its derivatives; columns that are not wanted may be left zero.
    fn line_distance_jacobian(
        &self,
        pixel_ray: &Self::PixelRay,
        line: &Vector3<f64>,
        wanted: Columns,
    ) -> LineDistance;

    /// Whether every pixel of a picture has a direction. Only the corners are checked: where the
    /// distortion folds back inside the picture, they have none.
    fn sees_all_of(&self, size: ImageSize) -> bool {
        let corners = size.corners();
        corners
            .iter()
            .all(|corner| self.unproject(corner).is_some())
    }

    /// Returns the last pixel with a direction on the way from the principal point to a pixel
    /// without one; `None` if that pixel has a direction.
    fn rim_towards(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let centre = self.principal_point();
        let offset = pixel - centre;
        let sees = |part: f64| self.unproject(&(centre + offset * part)).is_some();
        if sees(1.0) {
            return None;
        }
        let (mut seen, mut unseen) = (0.0, 1.0);
        for _ in 0..MAX_HALVINGS {
            if (unseen - seen) * offset.norm() <= RIM_TOLERANCE {
                break;
            }
            let middle = 0.5 * (seen + unseen);
            match sees(middle) {
                true => seen = middle,
                false => unseen = middle,
            }
        }
        Some(centre + offset * seen)
    }

    /// The unit ray along which a pixel looks; `None` where the distortion is not invertible.
    fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        let pixel_ray = self.unproject_with_jacobian(pixel)?;
        Some(self.direction(&pixel_ray).normalize())
    }

    /// Derivative of the projection with respect to the direction, at the direction of a pixel;
    /// `None` at the rim of the lens.
    ///
    /// The pixel does not depend on the length of the direction, and the direction's change with a
    /// pixel projects back to that change of the pixel: with `d` the direction and `D` its
    /// derivative with respect to the pixel, `J d = 0` and `J D = 1`.
    fn projection_by_direction(&self, pixel_ray: &Self::PixelRay) -> Option<Matrix2x3<f64>> {
        let by_pixel = self.direction_jacobian(pixel_ray);
        let (x, y) = (by_pixel.column(0), by_pixel.column(1));
        let direction = self.direction(pixel_ray);
        let all = Matrix3::from_columns(&[x.into(), y.into(), direction]);
        Some(all.try_inverse()?.fixed_rows::<2>(0).into_owned())
    }

    /// Focal lengths in pixels.
    fn focal(&self) -> Vector2<f64> {
        let [fx, fy, _, _] = self.intrinsics();
        Vector2::new(fx, fy)
    }

    /// Principal point in pixels.
    fn principal_point(&self) -> Vector2<f64> {
        let [_, _, cx, cy] = self.intrinsics();
        Vector2::new(cx, cy)
    }

    /// `A = [[fx, skew], [0, fy]]`: the pixel is `A u_d + c` of the observed point `u_d`.
    fn focal_matrix(&self) -> Matrix2<f64> {
        let [fx, fy, ..] = self.intrinsics();
        Matrix2::new(fx, self.skew(), 0.0, fy)
    }

    /// `A^-1`.
    fn inverse_focal_matrix(&self) -> Matrix2<f64> {
        let [fx, fy, ..] = self.intrinsics();
        Matrix2::new(1.0 / fx, -self.skew() / (fx * fy), 0.0, 1.0 / fy)
    }

    /// The smallest scale from observed points to pixels in any direction: the smaller singular
    /// value of `A`.
    fn least_focal(&self) -> f64 {
        let ([fx, fy, ..], skew) = (self.intrinsics(), self.skew());
        fx * fy / (0.5 * ((fx + fy).hypot(skew) + (fx - fy).hypot(skew)))
    }

    /// The camera matrix `[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`.
    fn camera_matrix(&self) -> Matrix3<f64> {
        let [fx, fy, cx, cy] = self.intrinsics();
        Matrix3::new(fx, self.skew(), cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    }

    /// Returns the lens with the same distortion and another camera matrix.
    #[must_use]
    fn with_camera_matrix(&self, camera_matrix: &Matrix3<f64>) -> Self {
        let k = camera_matrix;
        let mut parameters = self.parameters();
        parameters[..INTRINSICS].copy_from_slice(&[k.m11, k.m22, k.m13, k.m23]);
        if let Some(column) = Self::skew_column() {
            parameters[column] = k.m12;
        }
        self.with_parameters(&parameters)
    }

    /// Returns the same lens without the coefficients that a model does not have.
    #[must_use]
    fn of_model(&self, model: Self::Model) -> Self {
        let kept = model.columns();
        let coefficients = Self::parameter_names()[INTRINSICS..].iter();
        let mut parameters = self.parameters();
        for (name, column) in coefficients.zip(INTRINSICS..) {
            if *name != SKEW && !kept.contains(column) {
                parameters[column] = 0.0;
            }
        }
        self.with_parameters(&parameters)
    }

    /// Returns the same camera without distortion coefficients.
    #[must_use]
    fn without_distortion(&self) -> Self {
        Self::from_camera_matrix(&self.camera_matrix())
    }
}

/// # Panics
/// If the number of values is not the number of the lens's parameters.
fn assert_count<L: Lens>(values: &[f64]) {
    let (names, count) = (L::parameter_names(), values.len());
    assert!(
        count == names.len(),
        "the lens has {} parameters, {}, not {count}",
        names.len(),
        names.join(", ")
    );
}

#[cfg(test)]
mod tests {
    use super::brown::Brown;
    use super::*;

    /// Central differences of the distance with respect to a change made by `perturb`.
    fn numeric(perturb: impl Fn(f64) -> f64, step: f64) -> f64 {
        (perturb(step) - perturb(-step)) / (2.0 * step)
    }

    fn check_jacobians<L: Lens>(lens: &L) {
        let line = Vector3::new(0.4, -0.8, 0.1);
        for pixel in [
            Vector2::new(100.0, 80.0),
            Vector2::new(700.0, 650.0),
            Vector2::new(1200.0, 900.0),
        ] {
            let distance = |lens: &L, line: &Vector3<f64>| {
                lens.line_distance(&lens.unproject_with_jacobian(&pixel).unwrap(), line)
            };
            let ray = lens.unproject_with_jacobian(&pixel).unwrap();
            let jacobian = lens.line_distance_jacobian(&ray, &line, Columns::ALL);
            let projection = lens.projection_jacobian(&ray);
            let alone = distance(lens, &line);
            assert!((jacobian.value - alone).abs() < 1e-13 * alone.abs());
            for i in 0..3 {
                let expected = numeric(
                    |h| {
                        let mut moved = line;
                        moved[i] += h;
                        distance(lens, &moved)
                    },
                    1e-6,
                );
                let scale = jacobian.wrt_line.norm();
                assert!((jacobian.wrt_line[i] - expected).abs() < 1e-7 * scale);
            }
            for i in 0..L::parameter_names().len() {
                let in_pixels = i < INTRINSICS || L::skew_column() == Some(i);
                let scale = if in_pixels { 1.0 } else { 1000.0 };
                let moved = |h: f64| {
                    let mut parameters = lens.parameters();
                    parameters[i] += h / scale;
                    lens.with_parameters(&parameters)
                };
                let expected = numeric(|h| distance(&moved(h), &line), 1e-4);
                let found = jacobian.wrt_lens[i] / scale;
                assert!(
                    (found - expected).abs() < 1e-7 * expected.abs().max(1.0),
                    "column {i}: {found} against {expected}"
                );
                for axis in 0..2 {
                    let seen = |h: f64| moved(h).project(&lens.direction(&ray)).unwrap()[axis];
                    let expected = numeric(seen, 1e-3);
                    let found = projection[(axis, i)] / scale;
                    assert!((found - expected).abs() < 1e-7 * expected.abs().max(1.0));
                }
            }
            for axis in 0..2 {
                let step = Vector2::ith(axis, 1e-4);
                let ray_at = |pixel| lens.direction(&lens.unproject_with_jacobian(&pixel).unwrap());
                let expected = (ray_at(pixel + step) - ray_at(pixel - step)) / 2e-4;
                let found = lens.direction_jacobian(&ray).column(axis).into_owned();
                assert!((found - expected).norm() < 1e-6 * expected.norm());
            }
        }
    }

    #[test]
    fn the_rim_is_found_from_however_far() {
        let lens = Brown::new([1000.0, 1000.0, 640.0, 480.0, -0.4, 0.0, 0.0, 0.0, 0.0]);
        let near = lens.rim_towards(&Vector2::new(1640.0, 480.0)).unwrap();
        let far = lens.rim_towards(&Vector2::new(1e15, 480.0)).unwrap();
        assert!((near.x - far.x).abs() < 1.0);
    }

    #[test]
    fn jacobians_agree_with_central_differences() {
        let brown = Brown::new([
            1000.0, 1010.0, 640.0, 470.0, -0.25, 0.12, -0.03, 0.002, -0.001,
        ]);
        let intrinsics = [1000.0, 1010.0, 640.0, 470.0];
        let coefficients = [
            -0.1, 0.05, 0.01, 0.15, -0.03, 0.02, 0.02, -0.01, 3e-2, -2e-2, 1e-2, 4e-2,
        ];
        for skew in [0.0, 40.0] {
            check_jacobians(&brown.with_skew(skew));
            check_jacobians(&Rational::new(intrinsics, &coefficients[..8]).with_skew(skew));
            check_jacobians(&ThinPrism::new(intrinsics, &coefficients).with_skew(skew));
        }
    }

    fn check_skew<L: Lens>(lens: &L) {
        let camera_matrix = Matrix3::new(900.0, 40.0, 630.0, 0.0, 905.0, 480.0, 0.0, 0.0, 1.0);
        let skewed = lens.with_camera_matrix(&camera_matrix);
        assert_eq!(skewed.camera_matrix(), camera_matrix);
        assert_eq!(
            L::from_camera_matrix(&camera_matrix).camera_matrix(),
            camera_matrix
        );
        assert_eq!(skewed.with_parameters(&skewed.parameters()), skewed);
        let unskewed = lens.with_camera_matrix(&Matrix3::identity());
        let point = Vector3::new(0.3, -0.4, 1.0);
        let seen = camera_matrix * unskewed.project(&point).unwrap().push(1.0);
        assert!((skewed.project(&point).unwrap() - seen.xy()).norm() < 1e-9);
        let back = skewed.unproject(&seen.xy()).unwrap();
        assert!((back - point.normalize()).norm() < 1e-12);
    }

    #[test]
    fn the_pixel_is_the_camera_matrix_times_the_observed_point() {
        let intrinsics = [1000.0, 1010.0, 640.0, 470.0];
        check_skew(&Brown::new([
            1000.0, 1010.0, 640.0, 470.0, -0.25, 0.12, -0.03, 0.002, -0.001,
        ]));
        check_skew(&Rational::new(intrinsics, &[-0.1, 0.05, 0.0, 0.1]));
        check_skew(&ThinPrism::new(intrinsics, &[-0.1, 0.05]));
        check_skew(&Fisheye::new([
            1000.0, 1010.0, 640.0, 470.0, 0.03, -0.01, 0.0, 0.0,
        ]));
    }

    #[test]
    fn distance_vanishes_on_the_line_whatever_the_lens() {
        let lens = Brown::new([900.0, 905.0, 630.0, 480.0, 0.1, -0.05, 0.0, 1e-3, 2e-3]);
        let (a, b) = (Vector3::new(-0.3, 0.2, 1.0), Vector3::new(0.4, 0.35, 1.0));
        let line = a.cross(&b);
        for i in 0..=10 {
            let pixel = lens.project(&a.lerp(&b, f64::from(i) / 10.0)).unwrap();
            let distance =
                lens.line_distance(&lens.unproject_with_jacobian(&pixel).unwrap(), &line);
            assert!(distance.abs() < 1e-10, "{distance}");
        }
    }

    #[test]
    #[should_panic(
        expected = "the lens has 10 parameters, fx, fy, cx, cy, k1, k2, k3, p1, p2, skew"
    )]
    fn too_few_parameters_are_refused() {
        let _ = Brown::new([1.0; 9]).with_parameters(&[1.0; 9]);
    }

    #[test]
    #[should_panic(expected = "the lens has 8 coefficients, not 12")]
    fn more_coefficients_than_the_lens_has_are_refused() {
        let _ = Rational::new([1.0; 4], &[0.0; 12]);
    }
}
