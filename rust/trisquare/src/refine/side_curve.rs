//! The samples of a straight side beside a smooth curve: what they sum to, from a few nodes.
//!
//! Along a side, the distance to the image of a line is a smooth function of the place, and so are
//! its derivatives. They are computed at Chebyshev's nodes of a curve near the samples, and are
//! between these the polynomial through the nodes. Across the curve, over the fractions of a pixel
//! by which samples scatter, the distance grows linearly. A sample then costs a few
//! multiplications, and its lens is asked only at the nodes.

use std::f64::consts::PI;
use std::sync::LazyLock;

use nalgebra::{Vector2, Vector3};

use super::line_sums::{LineSums, RESIDUAL};
use crate::geometry::Line;
use crate::lens::Lens;
use crate::numeric::Loss;
use crate::observations::{ObservedPlane, PlaneState, Side, View};

/// Nodes of a side: the images of straight sides under lenses of up to 160 degrees are polynomials
/// of that many terms to 2e-5 px or better, and to 1e-9 px as a rule.
const NODES: usize = 10;

/// Sums of weights times Chebyshev's polynomials from which the products of two polynomials through
/// the nodes follow.
const MOMENTS: usize = 2 * NODES - 1;

/// Samples that are summed at a time.
const LANES: usize = 4;

/// Samples from which the nodes are worth their while.
const LEAST_SAMPLES: usize = 3 * NODES;

/// The last terms of the curve, and what its nodes miss the image of the line by, over the noise of
/// the best sample: beyond, a polynomial does not describe the side.
const TRUNCATION: f64 = 0.01;

/// Newton steps that bring a node onto the image of the line: from a chord two or three.
const MAX_STEPS: usize = 8;

/// Least cosine of the angle between the image of the line and the chord.
const LEAST_COSINE: f64 = 0.3;

/// Values of some functions at the nodes, or the coefficients of Chebyshev's polynomials in them.
type AtNodes<const N: usize> = [[f64; N]; NODES];

/// Where the nodes lie, from -1 to 1.
static PLACES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| std::array::from_fn(|k| ((k as f64 + 0.5) * PI / NODES as f64).cos()));

/// Takes values at the nodes to coefficients.
static TRANSFORM: LazyLock<AtNodes<NODES>> = LazyLock::new(|| {
    std::array::from_fn(|m| {
        let norm = if m == 0 { 1.0 } else { 2.0 } / NODES as f64;
        let value = |k: usize| norm * (m as f64 * (k as f64 + 0.5) * PI / NODES as f64).cos();
        std::array::from_fn(value)
    })
});

/// Coefficients of functions of given values at the nodes.
fn coefficients<const N: usize>(values: &AtNodes<N>) -> AtNodes<N> {
    let mut found = [[0.0; N]; NODES];
    for (own, factors) in found.iter_mut().zip(TRANSFORM.iter()) {
        for (factor, values) in factors.iter().zip(values) {
            for (sum, value) in own.iter_mut().zip(values) {
                *sum += factor * value;
            }
        }
    }
    found
}

/// Chebyshev's polynomials at some places.
fn polynomials<const M: usize>(places: &[f64; LANES]) -> [[f64; LANES]; M] {
    let mut values = [[1.0; LANES]; M];
    values[1] = *places;
    for m in 2..M {
        for i in 0..LANES {
            values[m][i] = 2.0 * places[i] * values[m - 1][i] - values[m - 2][i];
        }
    }
    values
}

/// Some samples beside the curve of their side.
#[derive(Debug, Clone, Copy, Default)]
struct Samples {
    /// Along the side, from -1 to 1.
    places: [f64; LANES],
    /// Across the chord from the curve, pixels.
    beside: [f64; LANES],
    /// One over the standard deviation; zero where there is no sample.
    weights: [f64; LANES],
}

/// The samples of a side beside a curve.
#[derive(Debug, Clone)]
pub(super) struct SideCurve {
    /// Pixels of the curve.
    nodes: [Vector2<f64>; NODES],
    /// Unit normal of the chord.
    across: Vector2<f64>,
    samples: Vec<Samples>,
}

/// The curves of all sides, by plane; `None` of sides that have none.
pub(super) struct SideCurves(Vec<Vec<Option<SideCurve>>>);

impl SideCurves {
    /// Near where a view sees the lines, for noise of a scale.
    pub fn of<L: Lens>(planes: &[ObservedPlane], view: &View<L>, scale: f64) -> Self {
        let own = |(plane, state): (&ObservedPlane, &PlaneState)| {
            let curve = |(f, side): (usize, &Side)| {
                let line = state.line(f, &side.line()?);
                SideCurve::of(&view.lens, &line, side, scale)
            };
            plane.sides_by_figure().map(curve).collect()
        };
        Self(planes.iter().zip(&view.planes).map(own).collect())
    }

    /// Of a plane's side, counted over its figures.
    pub fn get(&self, plane: usize, side: usize) -> Option<&SideCurve> {
        self.0[plane][side].as_ref()
    }
}

impl SideCurve {
    /// Near the image of a line, for noise of a scale.
    fn of<L: Lens>(lens: &L, line: &Vector3<f64>, side: &Side, scale: f64) -> Option<Self> {
        if side.samples.len() < LEAST_SAMPLES {
            return None;
        }
        let pixels = side.samples.iter().map(|sample| sample.pixel);
        let chord = Line::fit(pixels.clone().map(|pixel| (pixel, 1.0)))?;
        let across = chord.normal();
        let along = Vector2::new(-across.y, across.x);
        let (low, high) = pixels
            .map(|pixel| along.dot(&pixel))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), place| {
                (low.min(place), high.max(place))
            });
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let weights = side.samples.iter().map(|sample| sample.weight);
        let tolerance = TRUNCATION * scale / weights.fold(f64::MIN_POSITIVE, f64::max);

        let mut nodes = [Vector2::zeros(); NODES];
        let mut heights = [[0.0]; NODES];
        for ((node, height), place) in nodes.iter_mut().zip(&mut heights).zip(PLACES.iter()) {
            let at = along * (middle + half * place);
            *node = at - across * chord.distance(&at);
            let mut arrived = false;
            for _ in 0..MAX_STEPS {
                let ray = lens.unproject_with_jacobian(node)?;
                let (distance, normal) = lens.line_distance_and_normal(&ray, line);
                let cosine = normal.dot(&across);
                arrived = distance.abs() <= tolerance;
                if arrived || cosine.abs() < LEAST_COSINE {
                    break;
                }
                *node -= across * (distance / cosine);
            }
            if !arrived {
                return None;
            }
            *height = [chord.distance(node)];
        }
        let heights = coefficients(&heights);
        if heights[NODES - 2..]
            .iter()
            .any(|[term]| term.abs() > tolerance)
        {
            return None;
        }
        let samples = side.samples.chunks(LANES).map(|chunk| {
            let mut own = Samples::default();
            for (i, sample) in chunk.iter().enumerate() {
                own.places[i] = (along.dot(&sample.pixel) - middle) / half;
                own.beside[i] = chord.distance(&sample.pixel);
                own.weights[i] = sample.weight;
            }
            let terms = polynomials::<NODES>(&own.places);
            for ([height], term) in heights.iter().zip(&terms) {
                for i in 0..LANES {
                    own.beside[i] -= height * term[i];
                }
            }
            own
        });
        Some(Self {
            nodes,
            across,
            samples: samples.collect(),
        })
    }

    /// Sums over the samples at so many times their weights. `row` gives the derivatives of a
    /// node's distance to the line, and the distance.
    pub fn sums<L: Lens, const N: usize>(
        &self,
        (lens, line): (&L, &Vector3<f64>),
        (loss, to_scale): (Loss, f64),
        row: impl Fn(&L::PixelRay) -> [f64; N],
    ) -> Option<LineSums<N>> {
        let mut rows = [[0.0; N]; NODES];
        let mut cosines = [[0.0]; NODES];
        for ((own, cosine), node) in rows.iter_mut().zip(&mut cosines).zip(&self.nodes) {
            let ray = lens.unproject_with_jacobian(node)?;
            *own = row(&ray);
            let (_, normal) = lens.line_distance_and_normal(&ray, line);
            *cosine = [normal.dot(&self.across)];
        }
        let (rows, cosines) = (coefficients(&rows), coefficients(&cosines));

        let mut cost = [0.0; LANES];
        let mut weights = [[0.0; LANES]; MOMENTS];
        let mut residuals = [[0.0; LANES]; NODES];
        for samples in &self.samples {
            let terms = polynomials::<MOMENTS>(&samples.places);
            let (mut distance, mut slope) = ([0.0; LANES], [0.0; LANES]);
            for m in 0..NODES {
                for i in 0..LANES {
                    distance[i] += rows[m][RESIDUAL] * terms[m][i];
                    slope[i] += cosines[m][0] * terms[m][i];
                }
            }
            let mut weight = [0.0; LANES];
            for i in 0..LANES {
                distance[i] += samples.beside[i] * slope[i];
                let to_noise = samples.weights[i] * to_scale;
                let (own, factor) = loss.cost_and_weight(distance[i] * to_noise);
                cost[i] += own;
                weight[i] = factor * to_noise * to_noise;
            }
            for (sum, term) in weights.iter_mut().zip(&terms) {
                for i in 0..LANES {
                    sum[i] += weight[i] * term[i];
                }
            }
            for (sum, term) in residuals.iter_mut().zip(&terms) {
                for i in 0..LANES {
                    sum[i] += weight[i] * distance[i] * term[i];
                }
            }
        }
        let weights = weights.map(|lanes| lanes.iter().sum::<f64>());
        let residuals = residuals.map(|lanes| lanes.iter().sum::<f64>());

        // T_i T_j = (T_(i+j) + T_|i-j|) / 2
        let mut weighted = [[0.0; N]; NODES];
        for i in 0..NODES {
            for j in 0..NODES {
                let factor = 0.5 * (weights[i + j] + weights[i.abs_diff(j)]);
                for c in 0..N {
                    weighted[i][c] += factor * rows[j][c];
                }
            }
        }
        let mut products = [[0.0; N]; N];
        for m in 0..NODES {
            for i in 0..N {
                for j in 0..N {
                    products[i][j] += rows[m][i] * weighted[m][j];
                }
            }
        }
        for i in 0..N {
            let sum = (0..NODES).map(|m| rows[m][i] * residuals[m]).sum();
            (products[i][RESIDUAL], products[RESIDUAL][i]) = (sum, sum);
        }
        Some(LineSums {
            cost: cost.iter().sum(),
            products,
        })
    }

    /// Distances of the samples to a line's image, and its unit normals there; `None` where the lens
    /// is not invertible.
    pub fn distances_and_normals<L: Lens>(
        &self,
        lens: &L,
        line: &Vector3<f64>,
    ) -> Option<impl Iterator<Item = (f64, Vector2<f64>)>> {
        let mut values = [[0.0; 3]; NODES];
        for (own, node) in values.iter_mut().zip(&self.nodes) {
            let ray = lens.unproject_with_jacobian(node)?;
            let (distance, normal) = lens.line_distance_and_normal(&ray, line);
            *own = [distance, normal.x, normal.y];
        }
        let values = coefficients(&values);
        Some(self.samples.iter().flat_map(move |samples| {
            let terms = polynomials::<NODES>(&samples.places);
            let mut at = [[0.0; LANES]; 3];
            for (values, terms) in values.iter().zip(&terms) {
                for (sum, value) in at.iter_mut().zip(values) {
                    for i in 0..LANES {
                        sum[i] += value * terms[i];
                    }
                }
            }
            (0..LANES)
                .filter(|i| samples.weights[*i] > 0.0)
                .map(move |i| {
                    let normal = Vector2::new(at[1][i], at[2][i]);
                    let distance = at[0][i] + samples.beside[i] * normal.dot(&self.across);
                    (distance, normal)
                })
        }))
    }
}
