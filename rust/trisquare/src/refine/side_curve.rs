//! The samples of a straight side relative to a smooth curve, and their sums from a few nodes.
//!
//! Along a side, the distance to the image of a line and its derivatives are smooth functions of
//! the position. They are computed at the Chebyshev nodes of a curve near the samples, and
//! interpolated by the polynomial through the nodes. Across the curve, over the fractions of a
//! pixel by which samples scatter, the distance is linear. A sample then costs a few
//! multiplications, and the lens is only evaluated at the nodes.

use nalgebra::{Vector2, Vector3};

use super::line_sums::{LineSums, RESIDUAL};
use crate::geometry::Line;
use crate::lens::{Lens, LineImage, PixelLanes};
use crate::numeric::{LANES, Loss, NODES, PolynomialSums, coefficients, polynomials};
use crate::observations::{ObservedPlane, PlaneState, Side, View};

/// Number of polynomial terms of the derivatives along a side: the truncation changes the direction
/// of a step by less than a part in a thousand, and does not move the optimum.
const TERMS: usize = 7;

/// Number of polynomials at each sample that determine the products of two derivatives.
const MOMENTS: usize = 2 * TERMS - 1;

/// Minimum number of samples for which the nodes save work.
const MIN_SAMPLES: usize = 3 * NODES;

/// Maximum size of the curve's last terms, and of the nodes' distance from the image of the line,
/// over the noise of the best sample: above it, a polynomial does not describe the side.
const TRUNCATION: f64 = 0.01;

/// Some samples relative to the curve of their side.
#[derive(Debug, Clone, Copy)]
struct Samples {
    /// Positions along the side, from -1 to 1.
    places: [f64; LANES],
    /// Distances from the curve, across the chord, pixels.
    distances: [f64; LANES],
    /// One over the standard deviation; zero for unused lanes.
    weights: [f64; LANES],
}

/// The samples of a side relative to a curve.
#[derive(Debug, Clone)]
pub(super) struct SideCurve {
    /// Pixels of the curve.
    nodes: [Vector2<f64>; NODES],
    /// Unit normal of the chord.
    across: Vector2<f64>,
    samples: Vec<Samples>,
}

/// The curves of all sides, by plane; `None` for sides without one.
pub(super) struct SideCurves(Vec<Vec<Option<SideCurve>>>);

impl SideCurves {
    /// Curves near the images of the lines in a view, for noise of a scale.
    pub fn of<L: Lens>(planes: &[ObservedPlane], view: &View<L>, scale: f64) -> Self {
        let plane_curves = |(plane, state): (&ObservedPlane, &PlaneState)| {
            let curve = |(f, side): (usize, &Side)| {
                let line = state.line(f, &side.line()?);
                SideCurve::of(&view.lens, &line, side, scale)
            };
            plane.sides_by_figure().map(curve).collect()
        };
        Self(planes.iter().zip(&view.planes).map(plane_curves).collect())
    }

    /// Whether any side has a curve.
    pub fn has_any(&self) -> bool {
        self.0.iter().flatten().any(Option::is_some)
    }

    /// The curve of a plane's side, with sides counted over its figures.
    pub fn get(&self, plane: usize, side: usize) -> Option<&SideCurve> {
        self.0[plane][side].as_ref()
    }
}

impl SideCurve {
    /// The curve near the image of a line, for noise of a scale.
    fn of<L: Lens>(lens: &L, line: &Vector3<f64>, side: &Side, scale: f64) -> Option<Self> {
        if side.samples.len() < MIN_SAMPLES {
            return None;
        }
        let pixels = side.samples.iter().map(|sample| sample.pixel);
        let chord = Line::fit(pixels.clone().map(|pixel| (pixel, 1.0)))?;
        let weights = side.samples.iter().map(|sample| sample.weight);
        let tolerance = TRUNCATION * scale / weights.fold(f64::MIN_POSITIVE, f64::max);
        let image = LineImage::over((lens, line), chord, pixels, (0.0, tolerance))?;
        let samples = side.samples.chunks(LANES).map(|chunk| {
            let pixels = PixelLanes::of(chunk.iter().map(|sample| sample.pixel));
            let places = image.places(&pixels);
            let mut lanes = Samples {
                places,
                distances: image.distances(&pixels, &polynomials::<NODES>(&places)),
                weights: [0.0; LANES],
            };
            for (weight, sample) in lanes.weights.iter_mut().zip(chunk) {
                *weight = sample.weight;
            }
            lanes
        });
        Some(Self {
            nodes: image.nodes,
            across: image.across(),
            samples: samples.collect(),
        })
    }

    /// Sums over the samples, with their weights multiplied by `to_scale`. `row` returns the
    /// derivatives of a node's distance to the line, and the distance.
    pub fn sums<L: Lens, const N: usize>(
        &self,
        (lens, line): (&L, &Vector3<f64>),
        (loss, to_scale): (Loss, f64),
        row: impl Fn(&L::PixelRay) -> [f64; N],
    ) -> Option<LineSums<N>> {
        let mut rows = [[0.0; N]; NODES];
        let mut cosines = [[0.0]; NODES];
        for ((node_row, cosine), node) in rows.iter_mut().zip(&mut cosines).zip(&self.nodes) {
            let ray = lens.unproject_with_jacobian(node)?;
            *node_row = row(&ray);
            let (_, normal) = lens.line_distance_and_normal(&ray, line);
            *cosine = [normal.dot(&self.across)];
        }
        Some(self.sums_of(&rows, &cosines, (loss, to_scale)))
    }

    /// The sums, given the rows of the nodes and the slopes of their distances across the curve.
    fn sums_of<const N: usize>(
        &self,
        rows: &[[f64; N]; NODES],
        cosines: &[[f64; 1]; NODES],
        (loss, to_scale): (Loss, f64),
    ) -> LineSums<N> {
        let (rows, cosines) = (coefficients(rows), coefficients(cosines));

        let distances = rows.map(|row| row[RESIDUAL]);
        let cosines = cosines.map(|[cosine]| cosine);
        let (cost, sums) = weighted_sums(&self.samples, (&distances, &cosines), (loss, to_scale));
        let (gram, residuals) = sums.finish();

        let mut weighted = [[0.0; N]; TERMS];
        for i in 0..TERMS {
            for j in 0..TERMS {
                for c in 0..N {
                    weighted[i][c] += gram[i][j] * rows[j][c];
                }
            }
        }
        let mut products = [[0.0; N]; N];
        for m in 0..TERMS {
            for i in 0..N {
                for j in 0..N {
                    products[i][j] += rows[m][i] * weighted[m][j];
                }
            }
        }
        for i in 0..N {
            let sum = (0..TERMS).map(|m| rows[m][i] * residuals[m]).sum();
            (products[i][RESIDUAL], products[RESIDUAL][i]) = (sum, sum);
        }
        LineSums { cost, products }
    }

    /// Calls `visit` with the distances of the samples to a line's image, and its unit normals
    /// there; a few calls for unused lanes may follow the last sample. `None` if the lens is not
    /// invertible at a node.
    #[inline]
    pub fn for_each_distance<L: Lens>(
        &self,
        lens: &L,
        line: &Vector3<f64>,
        mut visit: impl FnMut(f64, Vector2<f64>),
    ) -> Option<()> {
        let mut values = [[0.0; 4]; NODES];
        for (node_values, node) in values.iter_mut().zip(&self.nodes) {
            let ray = lens.unproject_with_jacobian(node)?;
            let (distance, normal) = lens.line_distance_and_normal(&ray, line);
            *node_values = [distance, normal.dot(&self.across), normal.x, normal.y];
        }
        let values = coefficients(&values);
        for samples in &self.samples {
            let terms = polynomials::<NODES>(&samples.places);
            // One by one: normals that a caller does not use are not computed.
            let interpolated = |which: usize| {
                let mut sums = [0.0; LANES];
                for (values, terms) in values.iter().zip(&terms) {
                    for i in 0..LANES {
                        sums[i] += values[which] * terms[i];
                    }
                }
                sums
            };
            let [distances, cosines, x, y] = [
                interpolated(0),
                interpolated(1),
                interpolated(2),
                interpolated(3),
            ];
            for i in 0..LANES {
                let distance = distances[i] + samples.distances[i] * cosines[i];
                visit(distance, Vector2::new(x[i], y[i]));
            }
        }
        Some(())
    }
}

/// The cost of samples and their weighted sums, from the polynomials of their distance to a line
/// and of its slope across the curve.
fn weighted_sums(
    samples: &[Samples],
    (distances, cosines): (&[f64; NODES], &[f64; NODES]),
    (loss, to_scale): (Loss, f64),
) -> (f64, PolynomialSums<TERMS, MOMENTS>) {
    let mut cost = [0.0; LANES];
    let mut sums = PolynomialSums::new();
    for samples in samples {
        let terms = polynomials::<MOMENTS>(&samples.places);
        let (mut distance, mut slope) = ([0.0; LANES], [0.0; LANES]);
        for m in 0..NODES {
            for i in 0..LANES {
                distance[i] += distances[m] * terms[m][i];
                slope[i] += cosines[m] * terms[m][i];
            }
        }
        let (mut weights, mut values) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            distance[i] += samples.distances[i] * slope[i];
            let to_noise = samples.weights[i] * to_scale;
            let (sample_cost, factor) = loss.cost_and_weight(distance[i] * to_noise);
            cost[i] += sample_cost;
            weights[i] = factor * to_noise * to_noise;
            values[i] = weights[i] * distance[i];
        }
        sums.add(&terms, &weights, &values);
    }
    (cost.iter().sum(), sums)
}
