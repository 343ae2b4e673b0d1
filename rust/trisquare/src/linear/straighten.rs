//! Step 1: distortion from the straightness of curves, before any camera matrix is known.
//!
//! About a centre, `r_u = r_d (1 + a1 rho^2 + a2 rho^4 + ...)`, `rho = r_d / S`, `S` half the image
//! diagonal (Zhou et al. 2013, section 2; F. Devernay & O. Faugeras, Machine Vision and
//! Applications 13 (2001) 14-24). The cost is the distance of the samples from the straight line
//! that fits them best, measured in the distorted picture: in undistorted coordinates, noise would
//! favour a map that shrinks the picture.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::error::Error;
use crate::geometry::{Line, MIN_LINE_SAMPLES};
use crate::image_size::ImageSize;
use crate::lens::increases_up_to;
use crate::numeric::{ArrowStep, ArrowSystem, Limits, Minimum, Problem, minimise};
use crate::observations::check_samples;

/// Maximum number of coefficients of a straightening.
pub const MAX_COEFFICIENTS: usize = 3;

/// Length of a sample's row: derivatives by coefficients, centre, a line's angle and offset; and
/// residual.
const ROW: usize = MAX_COEFFICIENTS + 5;

/// Maximum number of evaluations; from zero distortion about six are needed.
const MAX_ITERATIONS: usize = 60;

/// Decrease of half the sum of squares (px^2) below which a step is the last.
const LAST_DECREASE: f64 = 1e-9;

/// Predicted standard deviation of the centre, as a fraction of the width, below which it is freed.
const CENTRE_STD_LIMIT: f64 = 0.05;

/// Lower bound of the noise (px) in the prediction of the centre's standard deviation, so that
/// noise-free curves without distortion do not appear to determine it.
const MIN_NOISE: f64 = 0.01;

/// The map from observed to ideal pixels that makes curves straight.
///
/// With `q` the observed pixel's offset from the centre in units of `S`, half the image diagonal,
/// the ideal one is `q (1 + a1 |q|^2 + a2 |q|^4 + a3 |q|^6)`. Straight lines determine no focal
/// length, and undistorted pictures need none:
/// [`from_straightening`](crate::Lens::from_straightening) creates a lens of any focal length from
/// it, by [`Self::ideal_radius`], as the example `undistort` does.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Straightening {
    /// `a1, a2, ...`.
    pub coefficients: Vec<f64>,
    /// The centre of distortion, in pixels.
    pub centre: Vector2<f64>,
    /// `S`, half the image diagonal in pixels.
    pub radius: f64,
    /// Root mean square distance of the samples to their lines, in pixels of the photograph.
    pub rms: f64,
}

#[cfg(feature = "serde")]
crate::stored::read_checked!(Straightening {
    coefficients: Vec<f64>,
    centre: Vector2<f64>,
    radius: f64,
    rms: f64,
});

impl Straightening {
    /// Checks values that were read.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for a number that is not finite, or a radius that is not
    /// positive.
    #[cfg(feature = "serde")]
    fn check(&self) -> Result<(), Error> {
        let mut numbers = self.coefficients.iter().chain(self.centre.iter());
        let is_finite = numbers.all(|v| v.is_finite()) && self.rms.is_finite();
        if !(is_finite && self.radius > 0.0 && self.radius.is_finite()) {
            return Err(Error::InvalidArgument(
                "the numbers of a straightening must be finite, and its radius positive".into(),
            ));
        }
        Ok(())
    }

    /// The identity map.
    pub fn identity(size: ImageSize) -> Self {
        Self {
            coefficients: Vec::new(),
            centre: size.centre(),
            radius: size.half_diagonal(),
            rms: 0.0,
        }
    }

    /// Maps an observed pixel to its ideal position; `None` if the map is not invertible there.
    pub fn undistort(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let q = (pixel - self.centre) / self.radius;
        let square = q.norm_squared();
        let ideal = self.centre + q * self.factor(square).0 * self.radius;
        (self.increases_up_to_square(square) && ideal.norm().is_finite()).then_some(ideal)
    }

    /// The ideal radius of an observed one, both in pixels from the centre.
    pub fn ideal_radius(&self, observed: f64) -> f64 {
        let square = (observed / self.radius).powi(2);
        observed * self.factor(square).0
    }

    /// `1 + a1 s + ...` and its derivative with respect to `s = rho^2`.
    fn factor(&self, square: f64) -> (f64, f64) {
        let (mut factor, mut slope) = (0.0, 0.0);
        for a in self.coefficients.iter().rev() {
            slope = slope * square + factor;
            factor = factor * square + a;
        }
        (1.0 + square * factor, factor + square * slope)
    }

    /// Whether the map increases up to a squared distance from the centre, in units of `S`.
    fn increases_up_to_square(&self, square: f64) -> bool {
        let mut coefficients = [0.0; MAX_COEFFICIENTS];
        let given = coefficients.iter_mut().zip(&self.coefficients);
        given.for_each(|(coefficient, given)| *coefficient = *given);
        increases_up_to(coefficients, square)
    }

    /// The map around one pixel, also if it does not increase up to there.
    fn local_map(&self, pixel: &Vector2<f64>) -> LocalMap {
        let q = (pixel - self.centre) / self.radius;
        let square = q.norm_squared();
        let (factor, slope) = self.factor(square);
        LocalMap {
            q,
            square,
            factor,
            jacobian: Matrix2::identity() * factor + q * q.transpose() * (2.0 * slope),
        }
    }
}

/// The undistorting map around one pixel, in units of `S`.
struct LocalMap {
    q: Vector2<f64>,
    square: f64,
    factor: f64,
    /// The symmetric Jacobian of ideal by observed coordinates.
    jacobian: Matrix2<f64>,
}

/// Finds the distortion that makes all curves straight.
///
/// Without `centre`, the image centre is used, or freed if the curves determine it to better than 5
/// % of the width. Points in pixels.
///
/// ```
/// use nalgebra::Vector2;
/// use trisquare::{Brown, ImageSize, PointMaps, fit_distortion};
///
/// // What a camera sees of straight lines.
/// let camera = Brown::new([900.0, 900.0, 639.5, 479.5, -0.05, 0.0, 0.0, 0.0, 0.0]);
/// let point = |i: i32, y: f64| Vector2::new(100.0 + 27.0 * f64::from(i), y);
/// let line = |y| (0..40).map(|i| point(i, y)).collect::<Vec<_>>();
/// let curves = [90.0, 250.0, 700.0, 850.0].map(|y| camera.distort_pixels(&line(y)).unwrap());
///
/// let size = ImageSize { width: 1280, height: 960 };
/// let found = fit_distortion(&curves, size, 2, None)?;
/// assert!(found.rms < 0.01);
/// let straight: Vec<_> = curves[0].iter().map(|pixel| found.undistort(pixel).unwrap()).collect();
/// assert!((straight[0].y - straight[20].y).abs() < 0.1);
/// # Ok::<(), trisquare::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidArgument`] for a number of coefficients outside 1 to 3 or an empty picture,
/// [`Error::TooFewSamples`] and [`Error::SampleNotFinite`], whose line is the curve's index,
/// [`Error::NotFinite`] for the centre, [`Error::TooFewDegreesOfFreedom`], or
/// [`Error::NotConverged`].
pub fn fit_distortion(
    curves: &[Vec<Vector2<f64>>],
    size: ImageSize,
    coefficients: usize,
    centre: Option<Vector2<f64>>,
) -> Result<Straightening, Error> {
    size.check()?;
    check(curves, coefficients, centre.as_ref())?;
    let start = Straightening {
        coefficients: vec![0.0; coefficients],
        centre: centre.unwrap_or_else(|| size.centre()),
        ..Straightening::identity(size)
    };
    let mut problem = Straight {
        curves,
        origin: start.centre,
        free_centre: false,
    };
    let held = solve(&problem, start)?;
    if centre.is_some() {
        return Ok(problem.finish(held));
    }
    problem.free_centre = true;
    let Some((_, system)) = problem.evaluate(&held.state) else {
        return Ok(problem.finish(held));
    };
    let variance = 2.0 * held.cost / problem.sample_count() as f64;
    let covariance = system
        .reduced_information()
        .and_then(|information| information.cholesky())
        .map(|factor| factor.inverse() * variance.max(MIN_NOISE * MIN_NOISE));
    let limit = CENTRE_STD_LIMIT * f64::from(size.width);
    let is_determined = covariance.is_some_and(|c| {
        (coefficients..coefficients + 2).all(|i| c[(i, i)] > 0.0 && c[(i, i)].sqrt() < limit)
    });
    if is_determined && let Ok(freed) = solve(&problem, held.state.clone()) {
        return Ok(problem.finish(freed));
    }
    Ok(problem.finish(held))
}

fn check(
    curves: &[Vec<Vector2<f64>>],
    coefficients: usize,
    centre: Option<&Vector2<f64>>,
) -> Result<(), Error> {
    if !(1..=MAX_COEFFICIENTS).contains(&coefficients) {
        return Err(Error::InvalidArgument(format!(
            "a straightening has 1 to {MAX_COEFFICIENTS} coefficients, not {coefficients}"
        )));
    }
    if !centre.iter().all(|p| p.x.is_finite() && p.y.is_finite()) {
        return Err(Error::NotFinite { what: "the centre" });
    }
    for (line, curve) in curves.iter().enumerate() {
        check_samples(0, line, curve, MIN_LINE_SAMPLES)?;
    }
    let samples = curves.iter().map(Vec::len).sum();
    let unknowns = coefficients + 2 * curves.len();
    if samples <= unknowns {
        return Err(Error::TooFewDegreesOfFreedom { samples, unknowns });
    }
    Ok(())
}

fn solve(problem: &Straight<'_>, start: Straightening) -> Result<Minimum<Straightening>, Error> {
    let limits = Limits {
        iterations: MAX_ITERATIONS,
        decrease: LAST_DECREASE,
    };
    minimise(problem, start, limits).ok_or(Error::NotConverged {
        stage: "straightening",
        iterations: 0,
        rms: 0.0,
    })
}

/// The straightness of all curves as a least-squares problem in the coefficients (and the centre),
/// with the best lines for each of their values (variable projection; L. Kaufman, BIT 15 (1975)
/// 49-57).
struct Straight<'a> {
    curves: &'a [Vec<Vector2<f64>>],
    /// Fixed origin of the ideal coordinates.
    origin: Vector2<f64>,
    free_centre: bool,
}

impl Straight<'_> {
    fn sample_count(&self) -> usize {
        self.curves.iter().map(Vec::len).sum()
    }

    fn finish(&self, minimum: Minimum<Straightening>) -> Straightening {
        Straightening {
            rms: (2.0 * minimum.cost / self.sample_count() as f64).sqrt(),
            ..minimum.state
        }
    }

    /// The straight line nearest to a curve, in ideal coordinates (units of `S` about the origin),
    /// with distances measured in the distorted picture.
    fn line_of(&self, state: &Straightening, local_maps: &[LocalMap]) -> Option<Line> {
        let place = |local_map: &LocalMap| self.ideal(state, local_map);
        let first = Line::fit(local_maps.iter().map(|b| (place(b), 1.0)))?;
        let weight =
            |local_map: &LocalMap| 1.0 / (local_map.jacobian * first.normal()).norm_squared();
        Line::fit(local_maps.iter().map(|b| (place(b), weight(b))))
    }

    fn ideal(&self, state: &Straightening, local_map: &LocalMap) -> Vector2<f64> {
        local_map.q * local_map.factor + (state.centre - self.origin) / state.radius
    }
}

impl Problem for Straight<'_> {
    type State = Straightening;

    fn evaluate(&self, state: &Straightening) -> Option<(f64, ArrowSystem)> {
        let count = state.coefficients.len();
        let shared = count + if self.free_centre { 2 } else { 0 };
        let last = shared + 2;
        let mut system = ArrowSystem::zeros(shared, std::iter::empty());
        let mut cost = 0.0;
        for curve in self.curves {
            let local_maps: Vec<LocalMap> =
                curve.iter().map(|pixel| state.local_map(pixel)).collect();
            let max_square = local_maps
                .iter()
                .map(|local_map| local_map.square)
                .fold(0.0, f64::max);
            if !state.increases_up_to_square(max_square) {
                return None;
            }
            let line = self.line_of(state, &local_maps)?;
            let normal = line.normal();
            let tangent = Vector2::new(-normal.y, normal.x);
            // Shared parameters, the line's angle and offset, and the residual; then zeros.
            let mut row = SVector::<f64, ROW>::zeros();
            let mut sums = SMatrix::<f64, ROW, ROW>::zeros();
            for local_map in &local_maps {
                let ideal = self.ideal(state, local_map);
                let gradient = local_map.jacobian * normal;
                let norm = gradient.norm();
                let residual = line.distance(&ideal) / norm * state.radius;
                let unit = gradient / norm;
                // d(n / |g|) = (dn - (n / |g|) d|g|) / |g|.
                let slope = |change: f64, gradient_change: f64| {
                    (change * state.radius - residual * gradient_change) / norm
                };
                let mut power = 1.0;
                for k in 0..count {
                    let lower = power;
                    power *= local_map.square;
                    let normal_part = local_map.q.dot(&normal);
                    let gradient_change =
                        normal * power + local_map.q * (2.0 * (k + 1) as f64 * lower * normal_part);
                    row[k] = slope(normal_part * power, unit.dot(&gradient_change));
                }
                if self.free_centre {
                    let wrt_centre = (normal - gradient) / norm;
                    (row[count], row[count + 1]) = (wrt_centre.x, wrt_centre.y);
                }
                row[shared] = slope(
                    tangent.dot(&ideal),
                    unit.dot(&(local_map.jacobian * tangent)),
                );
                row[shared + 1] = state.radius / norm;
                row[last] = residual;
                sums.ger(1.0, &row, &row, 1.0);
            }
            cost += 0.5 * sums[(last, last)];
            // The line depends on the shared parameters: it is eliminated (Schur complement).
            let line_factor = sums.fixed_view::<2, 2>(shared, shared).cholesky()?;
            let half = line_factor
                .l_dirty()
                .solve_lower_triangular(&sums.fixed_rows::<2>(shared))?;
            sums -= half.tr_mul(&half);
            system.prior += sums.view((0, 0), (shared, shared));
            system.prior_gradient += sums.view((0, last), (shared, 1));
        }
        Some((cost, system))
    }

    fn advance(&self, state: &Straightening, step: &ArrowStep) -> Straightening {
        let mut next = state.clone();
        for (a, change) in next.coefficients.iter_mut().zip(step.shared.iter()) {
            *a += change;
        }
        if self.free_centre {
            let count = state.coefficients.len();
            next.centre += Vector2::new(step.shared[count], step.shared[count + 1]);
        }
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize {
        width: 1280,
        height: 960,
    };

    /// Curves whose ideal images are straight under a known straightening.
    fn curves(truth: &Straightening) -> Vec<Vec<Vector2<f64>>> {
        let ends = [
            ((50.0, 60.0), (1200.0, 100.0)),
            ((80.0, 50.0), (60.0, 900.0)),
            ((100.0, 880.0), (1250.0, 860.0)),
            ((1230.0, 90.0), (1150.0, 900.0)),
            ((300.0, 200.0), (900.0, 800.0)),
        ];
        ends.iter()
            .map(|(a, b)| {
                let (a, b) = (Vector2::new(a.0, a.1), Vector2::new(b.0, b.1));
                (0..60)
                    .map(|i| {
                        let target = a.lerp(&b, f64::from(i) / 59.0);
                        // Fixed-point inversion of the map, to rounding.
                        let mut pixel = target;
                        for _ in 0..200 {
                            pixel += target - truth.undistort(&pixel).unwrap();
                        }
                        pixel
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn samples_whose_squares_overflow_are_refused() {
        let far = |i: usize| Vector2::new(1e154 * i as f64, -1e155 * (i * i) as f64);
        let curves = vec![(0..8).map(far).collect::<Vec<_>>(); 4];
        let size = ImageSize {
            width: 640,
            height: 480,
        };
        let found = fit_distortion(&curves, size, 1, None);
        assert!(found.is_err(), "{found:?}");
    }

    #[test]
    fn recovers_the_coefficients_of_straight_lines() {
        let truth = Straightening {
            coefficients: vec![0.15, 0.03],
            ..Straightening::identity(SIZE)
        };
        let found = fit_distortion(&curves(&truth), SIZE, 2, Some(truth.centre)).unwrap();
        for (a, b) in found.coefficients.iter().zip(&truth.coefficients) {
            assert!((a - b).abs() < 1e-9, "{found:?}");
        }
        assert!(found.rms < 1e-9);
    }

    #[test]
    fn nothing_comes_back_from_beyond_the_first_fold() {
        // The slope 1 - 1.5 s + 0.5 s^2 vanishes at s = 1 and s = 2, and is positive again beyond.
        let folded = Straightening {
            coefficients: vec![-0.5, 0.1],
            ..Straightening::identity(SIZE)
        };
        let at = |square: f64| folded.centre + Vector2::new(0.0, folded.radius * square.sqrt());
        assert!(folded.undistort(&at(0.99)).is_some());
        for square in [1.01, 1.9, 2.1, 5.0] {
            assert!(folded.undistort(&at(square)).is_none(), "{square}");
        }
    }

    #[test]
    fn frees_the_centre_only_where_distortion_shows_it() {
        let truth = Straightening {
            coefficients: vec![0.2],
            centre: SIZE.centre() + Vector2::new(12.0, -7.0),
            ..Straightening::identity(SIZE)
        };
        let found = fit_distortion(&curves(&truth), SIZE, 1, None).unwrap();
        assert!((found.centre - truth.centre).norm() < 1e-5, "{found:?}");
        let pinhole = fit_distortion(&curves(&Straightening::identity(SIZE)), SIZE, 1, None);
        let pinhole = pinhole.unwrap();
        assert_eq!(pinhole.centre, SIZE.centre());
        assert!(pinhole.coefficients[0].abs() < 1e-10);
    }

    #[test]
    fn bad_curves_are_refused() {
        let line: Vec<_> = (0..9).map(|i| Vector2::new(f64::from(i), 5.0)).collect();
        for (curves, coefficients) in [
            (vec![], 2),
            (vec![line[..1].to_vec()], 2),
            (vec![line[..3].to_vec()], 2),
            (vec![line.clone()], 0),
            (vec![line.clone()], 4),
            (vec![vec![Vector2::new(f64::NAN, 1.0); 9]], 2),
            (vec![line.clone(), vec![Vector2::new(3.0, 1.0); 9]], 2),
        ] {
            assert!(fit_distortion(&curves, SIZE, coefficients, None).is_err());
        }
        let mut wild = line.clone();
        wild[4].y = f64::NAN;
        let refused = fit_distortion(&[line.clone(), wild], SIZE, 1, None);
        assert!(
            matches!(
                refused,
                Err(Error::SampleNotFinite {
                    line: 1,
                    sample: 4,
                    ..
                })
            ),
            "{refused:?}"
        );
        let empty = ImageSize { width: 0, ..SIZE };
        let refused = fit_distortion(&[line.clone(), line], empty, 1, None);
        assert!(matches!(refused, Err(Error::InvalidArgument(_))));
    }
}
