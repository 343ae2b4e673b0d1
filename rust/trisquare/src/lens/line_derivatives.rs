//! Derivatives of the distance of a pixel to the image of a line, for lenses that distort the
//! normalised plane.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::INTRINSICS;
use super::plane_distortion::PlanePixelRay;

/// The distance of a pixel to the image of a line `l`, with the quantities that its derivatives
/// need.
///
/// With `u` the ideal point, `J = du_d/du`, `q = J^-T (l1, l2)` and `G = A^-T q`, the distance is
/// `n / |G|`, `n = l . (u, 1)`. At a fixed pixel, a parameter moves `u` by `-J^-1 du_d`, hence
/// `dn = -q . du_d`; and `J^T q = (l1, l2)` gives `dq = -J^-T (d(J^T) q)`, where the change of
/// `J^T q` at constant `q` is the gradient of `q . u_d`, differentiated with respect to the
/// parameter, plus its Hessian times `du`.
pub(super) struct LineDerivatives {
    /// The distance, in pixels.
    pub value: f64,
    u: Vector2<f64>,
    distorted: Vector2<f64>,
    square: f64,
    /// `A^-1`.
    inverse_focal: Matrix2<f64>,
    line: Vector2<f64>,
    q: Vector2<f64>,
    /// `q . u`.
    qu: f64,
    gradient: Vector2<f64>,
    /// `A^-1 G / |G|`.
    along: Vector2<f64>,
    inverse_norm: f64,
    /// `J^-1 A^-1 G / |G|`, so that `d|G| = -norm_gradient . (d(J^T) q)`.
    norm_gradient: Vector2<f64>,
    /// Derivative of `|G|` with respect to `u_d` through the change of `u`.
    norm_wrt_distorted: Vector2<f64>,
}

impl LineDerivatives {
    /// `hessian(q, v)` returns the Hessian of `q . u_d` with respect to `u`, times the vector `v`.
    #[inline]
    pub fn new(
        ray: &PlanePixelRay,
        line: &Vector3<f64>,
        inverse_focal: &Matrix2<f64>,
        hessian: impl Fn(Vector2<f64>, Vector2<f64>) -> Vector2<f64>,
    ) -> Self {
        let u = ray.ideal;
        let q = ray.inverse.tr_mul(&line.xy());
        let gradient = inverse_focal.tr_mul(&q);
        let inverse_norm = 1.0 / gradient.norm();
        let numerator = line.xy().dot(&u) + line.z;
        // d|G| = G . dG / |G| = (A^-1 G) . dq / |G| + ...
        let along = inverse_focal * (gradient * inverse_norm);
        let norm_gradient = ray.inverse * along;
        Self {
            value: numerator * inverse_norm,
            u,
            distorted: ray.distorted,
            square: ray.square,
            inverse_focal: *inverse_focal,
            line: line.xy(),
            q,
            qu: q.dot(&u),
            gradient,
            along,
            inverse_norm,
            norm_gradient,
            // -(H pull) . du with H symmetric and du = -J^-1 d(u_d).
            norm_wrt_distorted: ray.inverse.tr_mul(&hessian(q, norm_gradient)),
        }
    }

    /// Derivative with respect to a parameter that changes `u_d` by `shift` at a fixed pixel, and
    /// `J^T q` by `twist` at a fixed `u`.
    #[inline]
    fn column(&self, shift: Vector2<f64>, twist: Vector2<f64>) -> f64 {
        let dn = -self.q.dot(&shift);
        let dg = -self.norm_gradient.dot(&twist) + self.norm_wrt_distorted.dot(&shift);
        (dn - self.value * dg) * self.inverse_norm
    }

    /// Derivative with respect to the coefficient of `u g(s)`, given `g` and its derivative with
    /// respect to `s`.
    #[inline]
    pub fn radial(&self, factor: f64, slope: f64) -> f64 {
        let (u, q) = (self.u, self.q);
        self.column(u * factor, q * factor + u * (2.0 * slope * self.qu))
    }

    /// Derivative with respect to the tangential coefficient of the axis `axis`: `p2` for 0, `p1`
    /// for 1.
    #[inline]
    pub fn tangential(&self, axis: usize) -> f64 {
        let (u, q, across) = (self.u, self.q, 1 - axis);
        let (mut shift, mut twist) = (Vector2::zeros(), Vector2::zeros());
        shift[axis] = self.square + 2.0 * u[axis] * u[axis];
        shift[across] = 2.0 * u.x * u.y;
        twist[axis] = 6.0 * q[axis] * u[axis] + 2.0 * q[across] * u[across];
        twist[across] = 2.0 * (q.x * u.y + q.y * u.x);
        self.column(shift, twist)
    }

    /// Derivative with respect to the coefficient of `h(s)` along an axis, given `h` and its
    /// derivative with respect to `s`.
    #[inline]
    pub fn prism(&self, axis: usize, shift: f64, slope: f64) -> f64 {
        self.column(
            Vector2::ith(axis, shift),
            self.u * (2.0 * slope * self.q[axis]),
        )
    }

    /// Derivatives with respect to `fx, fy, cx, cy` and the skew, which move the observed point: at
    /// a fixed pixel, `u_d = A^-1 (p - c)` changes.
    #[inline]
    pub fn intrinsics(&self) -> CameraMatrixDerivatives {
        let a = &self.inverse_focal;
        CameraMatrixDerivatives::new(
            [
                self.column(Vector2::new(a.m11, a.m21), Vector2::zeros()),
                self.column(Vector2::new(a.m12, a.m22), Vector2::zeros()),
            ],
            self.distorted,
            self.gradient * (self.value * self.inverse_norm),
            self.along,
        )
    }

    /// Derivatives with respect to a centre of distortion at `e`, for a pixel near the line:
    /// `u_d = e + d(u - e)`, so `du_d = (I - J) de`.
    #[inline]
    pub fn centre(&self) -> [f64; 2] {
        let centre = (self.line - self.q) * self.inverse_norm;
        [centre.x, centre.y]
    }

    /// Derivative with respect to the line.
    #[inline]
    pub fn wrt_line(&self) -> Vector3<f64> {
        let numerator_part = self.u.push(1.0) * self.inverse_norm;
        let norm_part = self.norm_gradient * (self.value * self.inverse_norm);
        numerator_part - Vector3::new(norm_part.x, norm_part.y, 0.0)
    }
}

/// Derivatives of a distance `n / |G|` with respect to the camera matrix.
pub(super) struct CameraMatrixDerivatives {
    /// With respect to `fx, fy, cx, cy`.
    pub intrinsics: [f64; INTRINSICS],
    /// With respect to the skew.
    pub skew: f64,
}

impl CameraMatrixDerivatives {
    /// Computes them from the derivatives with respect to the principal point, the observed point,
    /// `G n / |G|^2` and `A^-1 G / |G|`.
    ///
    /// An entry `(i, j)` of `A` moves the pixel of `u_d` as `c_i` does, `u_d_j` times as far, and
    /// changes `G = A^-T q` by `-A^-T e_j G_i`.
    #[inline]
    pub fn new(
        wrt_centre: [f64; 2],
        observed: Vector2<f64>,
        gradient: Vector2<f64>,
        along: Vector2<f64>,
    ) -> Self {
        let entry = |i: usize, j: usize| observed[j] * wrt_centre[i] + gradient[i] * along[j];
        let [x, y] = wrt_centre;
        Self {
            intrinsics: [entry(0, 0), entry(1, 1), x, y],
            skew: entry(0, 1),
        }
    }
}

/// The Hessian of `q . u_d` with respect to `u`, times `v`, for a radial factor with its first and
/// second derivative with respect to `s`, and for the tangential coefficients `p1, p2`.
#[inline]
pub(super) fn hessian(
    u: Vector2<f64>,
    (q, v): (Vector2<f64>, Vector2<f64>),
    (slope, curvature): (f64, f64),
    [p1, p2]: [f64; 2],
) -> Vector2<f64> {
    let (uv, qv, qu) = (u.dot(&v), q.dot(&v), q.dot(&u));
    let tangential = Vector2::new(
        (6.0 * p2 * q.x + 2.0 * p1 * q.y) * v.x + 2.0 * (p1 * q.x + p2 * q.y) * v.y,
        2.0 * (p1 * q.x + p2 * q.y) * v.x + (2.0 * p2 * q.x + 6.0 * p1 * q.y) * v.y,
    );
    q * (2.0 * slope * uv)
        + u * (2.0 * slope * qv + 4.0 * curvature * qu * uv)
        + v * (2.0 * slope * qu)
        + tangential
}
