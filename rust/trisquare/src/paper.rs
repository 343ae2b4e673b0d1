//! Paper that is not flat: every large board is granted a smooth relief.
//!
//! A bump of height `z(X, Y)` displaces rows and columns of a board alike, toward the vanishing
//! point of its normal and the more the flatter the board is looked at: a displacement that whole
//! sheets share, and that no line alone can tell from distortion. The heights are
//! `R sum a_ij P_i(X / R) P_j(Y / R)` with `R` half the board's extent and `2 <= i + j <= 4`
//! (lower orders are the pose), `a_ij` normal with variance `tau^2 / (d / 2)^4`, `d = i + j`: stiff
//! sheets resist curvature, which grows with the square of the order. `tau` follows from the
//! residuals together with the strength of what every side errs on its own
//! ([`crate::side_errors`]), and where it is beyond doubt the camera is that of generalised least
//! squares, the heights eliminated like a pose whose size is known beforehand.

use nalgebra::{SVector, Vector2, Vector3};

use crate::arrow::Block;
use crate::correlated::white_variance;
use crate::edge_problem::EdgeProblem;
use crate::levenberg::Problem;
use crate::observations::{ObservedPlane, Sample};
use crate::parameters::FreeParameters;
use crate::refine::{Refined, residuals, robust_scale};
use crate::side_errors::SideErrors;
use crate::side_families::has_grid;
use crate::view::{PlaneState, View};
use crate::{Brown, Lens};

/// Terms of a relief: three of the second order, four of the third, five of the fourth.
pub(crate) const TERMS: usize = 12;

/// Lowest and highest order of a term; what is finer than a quarter of a board is left to the
/// sides' own errors.
const ORDERS: std::ops::RangeInclusive<usize> = 2..=4;

/// `tau^2` that counts as none: heights of a millionth of the extent, far below any pixel.
pub(crate) const FLAT: f64 = 1e-12;

/// `tau^2` tried: from heights of a ten-thousandth of half the board's extent, which is less than
/// a tenth of a pixel on the largest boards, to a tenth, which is no board any more.
const FIRST_VARIANCE: f64 = 1e-8;
const VARIANCE_RATIO: f64 = 10.0;
const VARIANCES: i32 = 7;

/// Twice the log likelihood that a relief has to gain: chance does so once in a hundred times.
const CLEARLY: f64 = 6.6;

/// Generalised least-squares steps; two or three are used, and nine where the fit of flat boards
/// was far off.
const MAX_STEPS: usize = 20;

/// Predicted fall of the cost, in units of the noise variance, below which a step is the last.
const LAST_DECREASE: f64 = 0.03;

/// Pixels over which a distance's gradient is taken.
const GRADIENT_STEP: f64 = 0.01;

/// Heights, or what each does at a sample.
pub(crate) type Heights = SVector<f64, TERMS>;

/// The relief of a board.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Relief {
    centre: Vector2<f64>,
    /// Half the extent, `R`.
    radius: f64,
    /// `a_ij`, already taken out of the samples.
    pub heights: Heights,
    /// `tau^2`.
    pub variance: f64,
}

impl Relief {
    /// A flat one, of a board that has lines enough to show another; `None` if it has not.
    fn flat(plane: &ObservedPlane, view: &View<Brown>, state: &PlaneState) -> Option<Self> {
        let large = plane.figures.iter().any(has_grid);
        if !large || plane.is_set_aside() {
            return None;
        }
        let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
        for sample in plane.samples() {
            let point = on_plane(&view.lens, state, &sample.pixel)?.0;
            (low, high) = (low.inf(&point), high.sup(&point));
        }
        let radius = 0.5 * (high - low).max();
        (radius > 0.0).then_some(Self {
            centre: 0.5 * (low + high),
            radius,
            heights: Heights::zeros(),
            variance: FLAT,
        })
    }

    /// The displacement (px) of a sample from its line that each unit of height makes; the distance's
    /// derivative by the line is given.
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
        let (point, distance) = on_plane(lens, state, &sample.pixel)?;
        let per_height = line.dot(&state.pose.normal()) * wrt_line.norm() / distance;
        // The sample has been moved back across its line: along it the point that was seen is not
        // yet where its pixel looks on flat paper.
        let height = self.radius * self.heights.dot(&terms(&self.place(&point)));
        let towards = state.pose.rotation.tr_mul(&lens.unproject(&sample.pixel)?);
        let along = state.pose.rotation.tr_mul(&state.pose.normal().cross(line));
        let along = along.xy().normalize();
        let slid = along * (along.dot(&towards.xy()) * height / towards.z);
        Some(terms(&self.place(&(point + slid))) * (self.radius * per_height))
    }

    /// A point of the plane in units of the relief's extent.
    fn place(&self, point: &Vector2<f64>) -> Vector2<f64> {
        (point - self.centre) / self.radius
    }

    /// Precision of every height at a variance.
    fn precisions(variance: f64) -> Heights {
        let mut precisions = Heights::zeros();
        for (precision, (i, j)) in precisions.iter_mut().zip(orders()) {
            *precision = (0.5 * (i + j) as f64).powi(4) / variance;
        }
        precisions
    }

    /// Adds what is known of the heights to their plane's equations; returns its part of minus
    /// twice the log likelihood.
    pub fn hold(&self, variance: f64, block: &mut Block) -> f64 {
        let precisions = Self::precisions(variance);
        let first = block.hessian.nrows() - TERMS;
        let mut criterion = 0.0;
        for (k, (precision, height)) in precisions.iter().zip(&self.heights).enumerate() {
            block.hessian[(first + k, first + k)] += precision;
            block.gradient[first + k] += precision * height;
            criterion += precision * height * height - precision.ln();
        }
        criterion
    }
}

/// Orders in X and Y of every term.
fn orders() -> impl Iterator<Item = (usize, usize)> {
    ORDERS.flat_map(|order| (0..=order).map(move |i| (i, order - i)))
}

/// Legendre's products at a place.
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

/// The point of a plane at which a pixel looks, and how far it is from the camera.
fn on_plane<L: Lens>(
    lens: &L,
    state: &PlaneState,
    pixel: &Vector2<f64>,
) -> Option<(Vector2<f64>, f64)> {
    let (ray, normal) = (lens.unproject(pixel)?, state.pose.normal());
    let distance = normal.dot(&state.pose.translation) / normal.dot(&ray);
    let point = state
        .pose
        .rotation
        .tr_mul(&(ray * distance - state.pose.translation));
    (point.iter().all(|v| v.is_finite()) && distance > 0.0).then(|| (point.xy(), distance))
}

/// The samples with the boards' relief taken out, and the optimum of generalised least squares
/// there; `None` where no board has one.
pub(crate) fn accounted(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    refined: &Refined<Brown>,
) -> Option<(Vec<ObservedPlane>, Refined<Brown>)> {
    // Where a tone curve's error is to be told from the samples, both would claim the same.
    if planes.iter().any(ObservedPlane::drifts) {
        return None;
    }
    let mut planes = planes.to_vec();
    for (plane, state) in planes.iter_mut().zip(&refined.view.planes) {
        plane.relief = plane
            .relief
            .or_else(|| Relief::flat(plane, &refined.view, state));
    }
    let mut found = refined.clone();
    let variance = variance(&errors(&planes, free, &found)?)?;
    for relief in planes.iter_mut().filter_map(|p| p.relief.as_mut()) {
        relief.variance = variance;
    }
    for _ in 0..MAX_STEPS {
        let errors = errors(&planes, free, &found)?;
        let step = errors.marginal(&errors.strength()?.mean)?.solve(0.0)?;
        for (p, plane) in planes.iter_mut().enumerate() {
            let state = &found.view.planes[p];
            let own = &step.blocks[p];
            if plane.relief.is_some() {
                let risen = own.rows(state.parameter_count(), TERMS).into_owned();
                raise(
                    plane,
                    (&found.view.lens, state),
                    &Heights::from_fn(|k, _| risen[k]),
                )?;
            }
        }
        let view = found.view.advanced(free, &step);
        let residuals = residuals(&planes, &view)?;
        let scale = robust_scale(&residuals);
        let (_, system) = EdgeProblem::new(&planes, judged, scale).evaluate(&view)?;
        let unknowns = view.unknowns(free);
        let iterations = found.iterations + 1;
        found = Refined::around((view, residuals, system), scale, unknowns, iterations);
        if step.predicted_decrease < LAST_DECREASE {
            return Some((planes, found));
        }
    }
    None
}

/// The errors of sides and boards that the residuals of an optimum show.
fn errors(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    refined: &Refined<Brown>,
) -> Option<SideErrors> {
    let noise = refined.noise(planes);
    let white = white_variance(&noise, refined);
    SideErrors::gather(planes, free, &refined.view, &noise, white)
}

/// The likeliest variance of the relief, if there clearly is any.
fn variance(errors: &SideErrors) -> Option<f64> {
    if !errors.has_relief() {
        return None;
    }
    let flat = errors.likeliest_at(FLAT, None)?;
    let tried = (0..VARIANCES).filter_map(|index| {
        let variance = FIRST_VARIANCE * VARIANCE_RATIO.powi(index);
        Some((variance, errors.likeliest_at(variance, Some(flat.0))?.1))
    });

    let (variance, criterion) = tried.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (flat.1 - criterion > CLEARLY).then_some(variance)
}

/// Takes further heights of a plane's relief out of its samples.
fn raise(
    plane: &mut ObservedPlane,
    (lens, state): (&Brown, &PlaneState),
    by: &Heights,
) -> Option<()> {
    let relief = plane.relief.as_mut()?;
    relief.heights += by;
    let relief = *relief;
    for (f, figure) in plane.figures.iter_mut().enumerate() {
        for side in &mut figure.sides {
            let line = state.line(f, side);
            for sample in &mut side.samples {
                let sight = lens.sight(&sample.pixel)?;
                let distance = lens.line_distance_jacobian(
                    &sight,
                    &line,
                    crate::lens::Columns::of([].into_iter()),
                );
                let rows =
                    relief.displacements((lens, state), &line, &distance.wrt_line, sample)?;
                let at = |x: f64, y: f64| {
                    let moved = lens.sight(&(sample.pixel + Vector2::new(x, y)))?;
                    Some(lens.line_distance(&moved, &line) - distance.value)
                };
                let gradient = Vector2::new(at(GRADIENT_STEP, 0.0)?, at(0.0, GRADIENT_STEP)?);
                sample.pixel -= gradient.normalize() * rows.dot(by);
            }
        }
    }
    Some(())
}
