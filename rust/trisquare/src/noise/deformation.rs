//! Deformation of a board, or of the sheet of a square: its terms, and the displacement of samples
//! by each.
//!
//! A bent sheet has the heights `R sum a_ij P_i(X / R) P_j(Y / R)` with `R` half the extent and
//! `2 <= i + j <= 4` (lower orders are the pose), `a_ij` normal with variance `tau^2 / (d / 2)^n`,
//! `d = i + j`. Stiff sheets resist curvature, which grows with the square of the order: `n` is 4.
//! Sheets rolled or twisted as a whole have hardly any terms but the lowest: `n` is 12.
//!
//! A stretched sheet is flat, but its ratio of width to height is `1 + e` times the stated one, as
//! from a printer that feeds the paper too fast or too slowly, and its axes are not quite at right
//! angles: a point `(X, Y)` is displaced by `((e X + g Y) / 2, (g X - e Y) / 2)` (size and rotation
//! are part of the pose). `e` is normal with standard deviation `tau`, `g` with a tenth of that.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::lens::Lens;
use crate::numeric::BlockEquations;
use crate::observations::{
    Deformation, DeformationKind, DeformationPrior, ObservedPlane, PlaneState, SHEAR, STRETCH,
    Sample, Terms, View,
};

/// Lowest and highest order of a term; variations finer than a quarter of a board are part of the
/// sides' own errors.
const ORDERS: std::ops::RangeInclusive<usize> = 2..=4;

/// Number of intervals across a bent sheet at which its height is sampled.
const HEIGHT_PLACES: u8 = 10;

/// Number of fixed-point steps to the intersection of a ray with a bent sheet: each reduces the
/// error by a factor of the slope.
const INTERSECTION_STEPS: u8 = 4;

/// Standard deviation of the shear relative to that of the stretch.
const SHEAR_PART: f64 = 0.1;

/// `tau^2` of an exact target: deviations of a millionth of the extent, far below any pixel.
const NONE: f64 = 1e-12;

impl DeformationPrior {
    /// That of exact targets.
    pub const EXACT: Self = Self {
        kind: DeformationKind::Bent,
        variance: NONE,
    };

    /// Precision of each term.
    fn precisions(&self) -> Terms {
        let (bend, steepness, stretch) = match self.kind {
            DeformationKind::Bent => (self.variance, 4, NONE),
            DeformationKind::Rolled => (self.variance, 12, NONE),
            DeformationKind::Stretched => (NONE, 4, self.variance),
        };
        let mut precisions = Terms::zeros();
        for (precision, (i, j)) in precisions.iter_mut().zip(orders()) {
            *precision = (0.5 * (i + j) as f64).powi(steepness) / bend;
        }
        precisions[STRETCH] = 1.0 / stretch;
        precisions[SHEAR] = 1.0 / (SHEAR_PART * SHEAR_PART * stretch);
        precisions
    }
}

impl Deformation {
    /// No deformation yet; `None` if no point of the plane is seen.
    pub fn none<L: Lens>(
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
            terms: Terms::zeros(),
            prior: DeformationPrior::EXACT,
        })
    }

    /// The displacement (px) of a sample from its line per unit of each term, given the
    /// distance's derivative by the line.
    ///
    /// A point `P + d` on the ray `x = (P + d) / s` of a line through `P` has `l . x = (l . d) / s`,
    /// and the derivative by the line is `x / |d(l.x)/dp|`. `d` is `z n` with the normal `n` where
    /// the sheet is bent, and in the plane where it is stretched.
    pub fn displacements<L: Lens>(
        &self,
        (lens, state): (&L, &PlaneState),
        line: &Vector3<f64>,
        wrt_line: &Vector3<f64>,
        sample: &Sample,
    ) -> Option<Terms> {
        let (point, distance, ray) = plane_point(lens, state, &sample.pixel)?;
        let per_length = wrt_line.norm() / distance;
        let per_height = line.dot(&state.pose.normal()) * per_length;
        // The sample has been moved back across its line only. Along the line, the point seen still
        // differs from the point at which its pixel looks on flat paper.
        let height = self.radius * self.terms.dot(&heights(&self.place(&point)));
        let along = state.pose.rotation.tr_mul(&state.pose.normal().cross(line));
        let along = along.xy().normalize();
        let slide = along * (along.dot(&ray.xy()) * height / ray.z);
        let mut found = heights(&self.place(&(point + slide))) * (self.radius * per_height);
        for (term, stretching) in [
            (STRETCH, stretching(1.0, 0.0)),
            (SHEAR, stretching(0.0, 1.0)),
        ] {
            let moved = stretching * (point - self.centre);
            found[term] = line.dot(&(state.pose.rotation * moved.push(0.0))) * per_length;
        }
        Some(found)
    }

    /// The displacement (px) of an uncorrected sample from its line: computed at the point of the
    /// deformed sheet that its pixel sees, not to first order as in [`Self::displacements`].
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
            height = self.radius * self.terms.dot(&heights(&self.place(&seen)));
        }
        // The point `p` seen at `q = p + D p` is displaced by `D (1 + D)^-1 q`, and `D^2` is
        // `-det D` times the identity.
        let stretching = stretching(self.terms[STRETCH], self.terms[SHEAR]);
        let square = -stretching.determinant();
        let by_seen = (stretching - Matrix2::identity() * square) / (1.0 - square);
        let stretched = by_seen * (point - self.centre);
        let moved = state.pose.rotation * stretched.push(height);
        let distance = distance + height / ray.z;
        Some(line.dot(&moved) * wrt_line.norm() / distance)
    }

    /// Difference of the highest and the lowest place of a bent sheet, over its extent.
    pub fn height(&self) -> f64 {
        if self.prior.kind == DeformationKind::Stretched {
            return 0.0;
        }
        let places =
            || (0..=HEIGHT_PLACES).map(|i| 2.0 * f64::from(i) / f64::from(HEIGHT_PLACES) - 1.0);
        let places = places().flat_map(|x| places().map(move |y| Vector2::new(x, y)));
        let heights = places.map(|place| self.terms.dot(&heights(&place)));
        let range = heights.fold((f64::MAX, f64::MIN), |(low, high), z| {
            (low.min(z), high.max(z))
        });
        // Terms are in units of half the extent.
        0.5 * (range.1 - range.0)
    }

    /// Stretch `e` of a stretched sheet: the ratio of width to height is `1 + e` times the stated
    /// one.
    pub fn stretch(&self) -> f64 {
        match self.prior.kind {
            DeformationKind::Stretched => self.terms[STRETCH],
            DeformationKind::Bent | DeformationKind::Rolled => 0.0,
        }
    }

    /// A point of the plane in units of half the extent.
    fn place(&self, point: &Vector2<f64>) -> Vector2<f64> {
        (point - self.centre) / self.radius
    }

    /// Adds a prior of the terms to their plane's equations, in which they are the last own
    /// parameters; returns its contribution to minus twice the log likelihood.
    pub fn add_prior(&self, prior: DeformationPrior, equations: &mut BlockEquations) -> f64 {
        let precisions = prior.precisions();
        let gradient = precisions.component_mul(&self.terms);
        equations.add_prior(precisions.as_slice(), gradient.as_slice());
        let logarithms: f64 = precisions.iter().map(|precision| precision.ln()).sum();
        gradient.dot(&self.terms) - logarithms
    }
}

/// Orders in X and Y of every height.
fn orders() -> impl Iterator<Item = (usize, usize)> {
    ORDERS.flat_map(|order| (0..=order).map(move |i| (i, order - i)))
}

/// Products of Legendre polynomials at a place, the effects of the heights on it.
fn heights(place: &Vector2<f64>) -> Terms {
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
    let mut values = Terms::zeros();
    for (value, (i, j)) in values.iter_mut().zip(orders()) {
        *value = x[i] * y[j];
    }
    values
}

/// Displacement of a point of a sheet by its stretch and its shear, as a matrix.
fn stretching(stretch: f64, shear: f64) -> Matrix2<f64> {
    Matrix2::new(stretch, shear, shear, -stretch) * 0.5
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Columns;
    use crate::observations::{Placement, TERMS, sort_by_plane};
    use crate::synthetic::{Scene, SceneOptions};

    /// Small enough for one step of a finite difference.
    const STEP: f64 = 1e-6;

    #[test]
    fn the_effects_of_the_terms_are_the_derivatives_of_the_displacement() {
        let truth = Scene::random(4, SceneOptions::default());
        let planes = sort_by_plane(&truth.edges(1, 0.0, 25.0)).unwrap();
        let lens = truth.camera;
        let state = |pose: &crate::geometry::Pose| PlaneState {
            pose: *pose,
            figures: vec![Placement::IDENTITY],
        };
        let view = View {
            lens,
            planes: truth.poses.iter().map(state).collect(),
            relations: Vec::new(),
        };
        for (plane, state) in planes.iter().zip(&view.planes) {
            let none = Deformation::none(plane, &view, state).unwrap();
            for side in plane.sides() {
                let line = state.line(0, &side.line().unwrap());
                let sample = &side.samples[side.samples.len() / 3];
                let ray = lens.unproject_with_jacobian(&sample.pixel).unwrap();
                let wrt_line = lens
                    .line_distance_jacobian(&ray, &line, Columns::NONE)
                    .wrt_line;
                let found = none
                    .displacements((&lens, state), &line, &wrt_line, sample)
                    .unwrap();
                for term in 0..TERMS {
                    let [more, less] = [STEP, -STEP].map(|change| {
                        let mut changed = none;
                        changed.terms[term] += change;
                        let of = (&lens, state);
                        changed.displacement(of, &line, &wrt_line, sample).unwrap()
                    });
                    let expected = (more - less) / (2.0 * STEP);
                    let scale = found.amax();
                    assert!((found[term] - expected).abs() < 1e-6 * scale, "term {term}");
                }
            }
        }
    }
}
