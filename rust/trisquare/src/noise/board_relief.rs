//! Relief of a board, or of the sheet of a square: its heights, and the displacement of samples by
//! each.
//!
//! The heights are `R sum a_ij P_i(X / R) P_j(Y / R)` with `R` half the board's extent and
//! `2 <= i + j <= 4` (lower orders are the pose), `a_ij` normal with variance `tau^2 / (d / 2)^n`,
//! `d = i + j`. Stiff sheets resist curvature, which grows with the square of the order: `n` is 4.
//! If the relief of squares is fitted as well (`Sheets::All`), 12 is tried, too, and the likelier
//! one is used: sheets rolled or twisted as a whole have hardly any terms but the lowest.

use nalgebra::{Vector2, Vector3};

use crate::lens::Lens;
use crate::numeric::BlockEquations;
use crate::observations::{BoardRelief, Heights, ObservedPlane, PlaneState, Sample, View};

/// Lowest and highest order of a term; variations finer than a quarter of a board are part of the
/// sides' own errors.
const ORDERS: std::ops::RangeInclusive<usize> = 2..=4;

/// Number of intervals across a relief at which its height is sampled.
const HEIGHT_PLACES: u8 = 10;

/// Number of fixed-point steps to the intersection of a ray with a relief: each reduces the error
/// by a factor of the slope.
const INTERSECTION_STEPS: u8 = 4;

/// Exponents `n` of the decrease of variances with the order: of stiff sheets, and of sheets that
/// are rolled or twisted as a whole.
pub(super) const STIFF: i32 = 4;
pub(super) const ROLLED: i32 = 12;

/// `tau^2` of a flat board: heights of a millionth of the extent, far below any pixel.
pub(crate) const FLAT: f64 = 1e-12;

impl BoardRelief {
    /// A flat relief; `None` if no point of the plane is seen.
    pub fn flat<L: Lens>(
        plane: &ObservedPlane,
        view: &View<L>,
        state: &PlaneState,
    ) -> Option<Self> {
        let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
        for sample in plane.samples() {
            let point = plane_point(&view.lens, state, &sample.pixel)?.0;
            (low, high) = (low.inf(&point), high.sup(&point));
        }
        let radius = 0.5 * (high - low).max();
        (radius > 0.0).then_some(Self {
            centre: 0.5 * (low + high),
            radius,
            heights: Heights::zeros(),
            variance: FLAT,
            steepness: STIFF,
        })
    }

    /// The displacement (px) of a sample from its line per unit of each height, given the
    /// distance's derivative by the line.
    ///
    /// A point `P + z n` on the ray `x = (P + z n) / s` of a line through `P` has
    /// `l . x = z (l . n) / s`, and the derivative by the line is `x / |d(l.x)/dp|`.
    pub fn displacements<L: Lens>(
        &self,
        (lens, state): (&L, &PlaneState),
        line: &Vector3<f64>,
        wrt_line: &Vector3<f64>,
        sample: &Sample,
    ) -> Option<Heights> {
        let (point, distance, ray) = plane_point(lens, state, &sample.pixel)?;
        let per_height = line.dot(&state.pose.normal()) * wrt_line.norm() / distance;
        // The sample has been moved back across its line only. Along the line, the point seen still
        // differs from the point at which its pixel looks on flat paper.
        let height = self.radius * self.heights.dot(&terms(&self.place(&point)));
        let along = state.pose.rotation.tr_mul(&state.pose.normal().cross(line));
        let along = along.xy().normalize();
        let slide = along * (along.dot(&ray.xy()) * height / ray.z);
        Some(terms(&self.place(&(point + slide))) * (self.radius * per_height))
    }

    /// The displacement (px) of an uncorrected sample from its line by the relief's heights:
    /// computed at the intersection of the ray with the relief, not to first order as in
    /// [`Self::displacements`].
    pub fn displacement<L: Lens>(
        &self,
        (lens, state): (&L, &PlaneState),
        line: &Vector3<f64>,
        wrt_line: &Vector3<f64>,
        sample: &Sample,
    ) -> Option<f64> {
        let (point, distance, ray) = plane_point(lens, state, &sample.pixel)?;
        let mut height = 0.0;
        for _ in 0..INTERSECTION_STEPS {
            let seen = point + ray.xy() * (height / ray.z);
            height = self.radius * self.heights.dot(&terms(&self.place(&seen)));
        }
        let distance = distance + height / ray.z;
        Some(height * line.dot(&state.pose.normal()) * wrt_line.norm() / distance)
    }

    /// Difference of its highest and lowest place, over its extent.
    pub fn height(&self) -> f64 {
        let places =
            || (0..=HEIGHT_PLACES).map(|i| 2.0 * f64::from(i) / f64::from(HEIGHT_PLACES) - 1.0);
        let places = places().flat_map(|x| places().map(move |y| Vector2::new(x, y)));
        let heights = places.map(|place| self.heights.dot(&terms(&place)));
        let range = heights.fold((f64::MAX, f64::MIN), |(low, high), z| {
            (low.min(z), high.max(z))
        });
        // Heights are in units of half the extent.
        0.5 * (range.1 - range.0)
    }

    /// A point of the plane in units of the relief's extent.
    fn place(&self, point: &Vector2<f64>) -> Vector2<f64> {
        (point - self.centre) / self.radius
    }

    /// Precision of each height coefficient at a variance.
    fn precisions(&self, variance: f64) -> Heights {
        let mut precisions = Heights::zeros();
        for (precision, (i, j)) in precisions.iter_mut().zip(orders()) {
            *precision = (0.5 * (i + j) as f64).powi(self.steepness) / variance;
        }
        precisions
    }

    /// Adds the prior of the heights to their plane's equations, in which they are the last own
    /// parameters; returns its contribution to minus twice the log likelihood.
    pub fn add_prior(&self, variance: f64, equations: &mut BlockEquations) -> f64 {
        let precisions = self.precisions(variance);
        let gradient = precisions.component_mul(&self.heights);
        equations.add_prior(precisions.as_slice(), gradient.as_slice());
        let logarithms: f64 = precisions.iter().map(|precision| precision.ln()).sum();
        gradient.dot(&self.heights) - logarithms
    }
}

/// Orders in X and Y of every term.
fn orders() -> impl Iterator<Item = (usize, usize)> {
    ORDERS.flat_map(|order| (0..=order).map(move |i| (i, order - i)))
}

/// Products of Legendre polynomials at a place.
fn terms(place: &Vector2<f64>) -> Heights {
    let legendre = |s: f64| {
        let square = s * s;
        [
            1.0,
            s,
            0.5 * (3.0 * square - 1.0),
            0.5 * s * (5.0 * square - 3.0),
            0.125 * ((35.0 * square - 30.0) * square + 3.0),
        ]
    };
    let (x, y) = (legendre(place.x), legendre(place.y));
    let mut values = Heights::zeros();
    for (value, (i, j)) in values.iter_mut().zip(orders()) {
        *value = x[i] * y[j];
    }
    values
}

/// The point of a plane seen at a pixel, its distance from the camera (in lengths of the pixel's
/// ray), and the ray in the plane's axes.
fn plane_point<L: Lens>(
    lens: &L,
    state: &PlaneState,
    pixel: &Vector2<f64>,
) -> Option<(Vector2<f64>, f64, Vector3<f64>)> {
    let (ray, pose) = (lens.unproject(pixel)?, &state.pose);
    let normal = pose.normal();
    let distance = normal.dot(&pose.translation) / normal.dot(&ray);
    let point = pose.rotation.tr_mul(&(ray * distance - pose.translation));
    let is_seen = point.iter().all(|v| v.is_finite()) && distance > 0.0;
    is_seen.then(|| (point.xy(), distance, pose.rotation.tr_mul(&ray)))
}
