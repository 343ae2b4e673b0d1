//! Refusal of geometry that does not determine the camera matrix.
//!
//! K must be determined by the planes, not by the lens polynomial: wherever the principal point is
//! free, the covariance is judged with the centre of distortion freed from it. (With the two tied,
//! the polynomial's centre would determine the principal point, and with it a single direction of
//! planes the focal lengths: parallel planes would give plausible numbers.)
//!
//! The rule: a geometry is refused if it predicts a standard deviation above [`MAX_STD`] of the
//! focal length (`fx`, `fy`) or of the width (`cx`, `cy`). The evidence is from scenes of three
//! squares measured every 4 px with noise of 0.05 to 0.5 px, each judged by its worst parameter:
//! 3,000 sound scenes (tilts of 25 to 50 degrees) have a median of 0.5 % and a largest value of
//! 2.9 %; 2,000 scenes of parallel planes have a median of 43 % and a smallest value of 5.9 %. The
//! latter does not depend on the noise, because the angle between planes that are parallel is
//! estimated as some multiple of its own standard deviation, and the information about K from that
//! angle has a relative error of one over that multiple; its distribution falls off like a
//! Gaussian's tail toward the limit.
//!
//! Strong noise alone is no reason to refuse: where planes clearly differ in direction (by more
//! than [`DISTINCT_DEGREES`], which in 1,000 scenes of parallel planes with noise of 1 to 3 px no
//! estimate reached whose standard deviation was below the limit) the limit grows with the noise
//! above [`COMMON_NOISE`], so that a sound scene photographed badly gives large standard
//! deviations. And exact samples do not make a degenerate geometry sound: noise below [`MIN_NOISE`]
//! is raised to that value, because boards are not flat and lenses are not polynomials.
//!
//! Where a value of the camera matrix is held, residuals above [`MAX_NOISE_RESIDUAL`] show that it
//! is wrong: the planes contradict it, and the standard deviations predicted from the residuals
//! depend on where the search ended. (In 24 scenes, a focal length held at 1,000 times the truth
//! left residuals of 4 % of half the diagonal or more wherever an optimum was found; one at 1.3
//! times left 0.3 % at most.)
//!
//! A freed skew has no limit of its own: if the planes do not determine it, the focal lengths and
//! the principal point become uncertain.

use nalgebra::{DMatrix, Vector2};

use super::covariance::covariance;
use crate::ill_conditioning::{Cause, IllConditioning, Remedy};
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::numeric::ArrowSystem;
use crate::observations::{Fixed, FreeParameters, ObservedPlane, Options, View};

/// Largest accepted standard deviation: of a focal length as a fraction of it, of the principal
/// point as a fraction of the width. It lies between the sound and the parallel scenes of the
/// module's evidence.
const MAX_STD: f64 = 0.04;

/// The same where the principal point is held, so that no lens polynomial can stand in for the
/// planes. Planes that face the camera, the remaining case to be refused, predict 18 % or more (250
/// scenes). Of parallel planes tilted by 25 to 50 degrees, which are legitimate then, 6 % predict
/// more than 4 %, and 2 % more than 10 %: a tilt about an axis parallel to one of the picture's
/// leaves the aspect open.
const MAX_STD_CENTRED: f64 = 0.1;

/// Returns the limit for what is fixed.
pub(super) fn max_std(fixed: Fixed) -> f64 {
    match fixed.principal_point {
        true => MAX_STD_CENTRED,
        false => MAX_STD,
    }
}

/// Noise of one pixel of edge above which the limit grows: the maximum of ordinary pictures (0.5 px
/// for samples 4 px apart).
const COMMON_NOISE: f64 = 1.0;

/// Largest factor by which the limit grows with the noise: beyond it a linear prediction is not
/// valid.
const MAX_LIMIT_GROWTH: f64 = 4.0;

/// Angle between planes (degrees) above which they are certainly not parallel.
const DISTINCT_DEGREES: f64 = 25.0;

/// Minimum noise of one pixel of edge that is assumed (0.1 px for samples 4 px apart): below, the
/// errors of paper and lens are larger.
const MIN_NOISE: f64 = 0.2;

/// Residual, as a fraction of half the picture's diagonal, above which it is not noise.
const MAX_NOISE_RESIDUAL: f64 = 0.01;

/// Prior standard deviation of a freed centre of distortion, in half image diagonals: the centre is
/// unobservable where there is no distortion, and then gives no information in any case.
const CENTRE_PRIOR: f64 = 0.5;

/// Standard deviation, as a fraction of its limit, above which another optimum is looked for.
const DOUBTFUL: f64 = 0.3;

/// Angle between planes (degrees) below which a refusal calls them parallel.
const PARALLEL_DEGREES: f64 = 5.0;

/// Angle between planes, or their tilt, (degrees) below which it is the likeliest cause of a
/// refusal.
const ALIKE_DEGREES: f64 = 20.0;

/// Extent of the largest figure, as a fraction of the picture's height, below which figures are
/// small.
const SMALL_SPAN: f64 = 0.2;

/// Extent of all figures together, as a fraction of width and height, below which they lie close
/// together.
const HUDDLED_SPAN: f64 = 0.6;

/// Returns the free parameters, with the centre of distortion freed from the principal point where
/// the lens polynomial could otherwise stand in for the planes.
pub(crate) fn judged_parameters(free: &FreeParameters) -> FreeParameters {
    if free.position("cx").is_some() {
        free.with_free_centre()
    } else {
        free.clone()
    }
}

/// Input of a judgement of the geometry.
pub(crate) struct Conditioning<'a, L: Lens> {
    pub view: &'a View<L>,
    pub planes: &'a [ObservedPlane],
    pub size: ImageSize,
    pub options: &'a Options<L>,
    /// Factor on the samples' standard deviations.
    pub noise_scale: f64,
}

/// The parameter of the camera matrix that is known worst.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weakest {
    pub parameter: &'static str,
    /// Its standard deviation, as a fraction of the focal length itself or of the picture's width;
    /// infinite where it is not observable.
    pub std: f64,
    /// Its largest accepted standard deviation, in the same unit.
    pub limit: f64,
}

impl Weakest {
    /// Standard deviation as a fraction of the limit.
    pub fn ratio(&self) -> f64 {
        self.std / self.limit
    }

    /// Whether another optimum should be looked for: a wrong one may look determined, but not
    /// well.
    pub fn is_doubtful(&self) -> bool {
        self.ratio() > DOUBTFUL
    }
}

impl<L: Lens> Conditioning<'_, L> {
    /// Returns why the geometry does not determine the camera matrix, without remedies; `None` if
    /// it does.
    ///
    /// `system` holds the normal equations over the [`judged_parameters`] and possibly others after
    /// them, `factor` turns the inverse of their information into a covariance.
    pub fn ill_conditioning(
        &self,
        system: &ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) -> Option<IllConditioning> {
        let weakest = self.weakest(system, free, factor)?;
        (!(weakest.ratio() <= 1.0)).then(|| IllConditioning {
            cause: self.cause(),
            parameter: weakest.parameter,
            std: weakest.std,
            limit: weakest.limit,
            remedies: Vec::new(),
        })
    }

    /// Returns the refusal of held values of the camera matrix, judged at an optimum without them;
    /// `parameter` is one of those that are free beside the held values.
    pub fn held_refusal(
        &self,
        parameter: &'static str,
        fixed: Fixed,
        remedy: Remedy,
    ) -> IllConditioning {
        IllConditioning {
            cause: self.cause(),
            parameter,
            std: f64::INFINITY,
            limit: max_std(fixed),
            remedies: vec![remedy],
        }
    }

    /// Returns the parameter that is known worst in proportion to its limit; `None` if K is held.
    pub fn weakest(
        &self,
        system: &ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) -> Option<Weakest> {
        let noise = self.noise();
        // A bent side that was left out has already shown the errors of the paper.
        let has_all_sides = self
            .planes
            .iter()
            .flat_map(ObservedPlane::sides)
            .all(|side| !side.is_outlier);
        let floor = match has_all_sides {
            true => (MIN_NOISE / noise).max(1.0).powi(2),
            false => 1.0,
        };
        let limit = self.limit(noise);
        let covariance = match self.contradicts_held() {
            true => None,
            false => self.judged_covariance(system, free, factor * floor),
        };
        let focal = self.view.lens.focal();
        let width = f64::from(self.size.width);
        let units = [
            ("fx", focal.x),
            ("fy", focal.y),
            ("cx", width),
            ("cy", width),
        ];
        let known = units.into_iter().filter_map(|(parameter, unit)| {
            let position = free.position(parameter)?;
            let variance = covariance.as_ref().map(|c| c[(position, position)]);
            let std = variance
                .filter(|v| *v >= 0.0)
                .map_or(f64::INFINITY, f64::sqrt);
            Some(Weakest {
                parameter,
                std: std / unit.max(0.0),
                limit,
            })
        });
        known.max_by(|a, b| a.ratio().total_cmp(&b.ratio()))
    }

    /// Whether the planes contradict values of the camera matrix that are held.
    fn contradicts_held(&self) -> bool {
        let Fixed {
            focal,
            principal_point,
            ..
        } = self.options.fixed;
        let samples = || self.planes.iter().flat_map(ObservedPlane::samples);
        let weights: f64 = samples().map(|sample| sample.weight.powi(2)).sum();
        let residual = self.noise_scale * (samples().count() as f64 / weights).sqrt();
        (focal || principal_point) && residual > MAX_NOISE_RESIDUAL * self.size.half_diagonal()
    }

    fn judged_covariance(
        &self,
        system: &ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) -> Option<DMatrix<f64>> {
        let mut system = system.leading(judged_parameters(free).len());
        self.add_centre_prior(&mut system, free, factor);
        covariance(&system, factor)
    }

    /// Adds the prior of the centre of distortion where it is freed from the principal point: to
    /// the parameters after the free ones.
    pub(super) fn add_centre_prior(
        &self,
        system: &mut ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) {
        let focal = self.view.lens.focal().x;
        let prior = CENTRE_PRIOR * self.size.half_diagonal() / focal;
        for i in free.len()..system.prior.nrows() {
            system.prior[(i, i)] += factor / (prior * prior);
        }
    }

    fn limit(&self, noise: f64) -> f64 {
        let growth = match self.pairs().any(|(_, degrees)| degrees > DISTINCT_DEGREES) {
            true => (noise / COMMON_NOISE).clamp(1.0, MAX_LIMIT_GROWTH),
            false => 1.0,
        };
        max_std(self.options.fixed) * growth
    }

    /// Returns the noise of one pixel of edge: that of a sample, converted from the samples'
    /// spacing to 1 px.
    fn noise(&self) -> f64 {
        let (mut weights, mut length) = (0.0, 0.0);
        for side in self.planes.iter().flat_map(ObservedPlane::sides) {
            weights += side.samples.iter().map(|s| s.weight.powi(2)).sum::<f64>();
            length += span(side.samples.iter().map(|s| s.pixel)).norm();
        }
        let noise = self.noise_scale * (length / weights).sqrt();
        // Samples without weight or extent give no information.
        if noise.is_nan() { f64::INFINITY } else { noise }
    }

    fn cause(&self) -> Cause {
        let planes = self.planes.len();
        let fixed = &self.options.fixed;
        let (pair, degrees) = self.farthest_pair().unwrap_or(((0, 0), 0.0));
        let tilt = self.largest_tilt();
        if tilt < ALIKE_DEGREES && (planes == 1 || fixed.principal_point) {
            return Cause::Facing {
                planes,
                degrees: tilt,
            };
        }
        // One direction gives two equations.
        let two_suffice = match fixed.principal_point {
            true => fixed.focal || fixed.aspect,
            false => fixed.focal && fixed.skew,
        };
        if planes > 1 && !two_suffice {
            if degrees < PARALLEL_DEGREES {
                return Cause::Parallel { planes, degrees };
            }
            if degrees < ALIKE_DEGREES {
                let planes = pair;
                return Cause::Alike { planes, degrees };
            }
        }
        let pixels = self.largest_figure();
        if pixels < SMALL_SPAN * f64::from(self.size.height) {
            return Cause::Small { pixels };
        }
        let all = span(
            self.planes
                .iter()
                .flat_map(|p| p.samples())
                .map(|s| s.pixel),
        );
        let width = all.x / f64::from(self.size.width);
        let height = all.y / f64::from(self.size.height);
        if width.max(height) < HUDDLED_SPAN {
            return Cause::Huddled { width, height };
        }
        Cause::Open { planes, degrees }
    }

    /// Returns the larger dimension of the largest figure, in pixels.
    fn largest_figure(&self) -> f64 {
        let figures = self.planes.iter().flat_map(|plane| &plane.figures);
        figures
            .map(|figure| span(figure.samples().map(|s| s.pixel)).amax())
            .fold(0.0, f64::max)
    }

    /// Returns all pairs of planes, and the angles between their directions in degrees.
    fn pairs(&self) -> impl Iterator<Item = ((usize, usize), f64)> {
        let normals: Vec<_> = self.view.planes.iter().map(|p| p.pose.normal()).collect();
        let pairs = (0..normals.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
        pairs.map(move |(i, j)| {
            let (a, b) = (&normals[i], &normals[j]);
            let sine = a.cross(b).norm();
            ((i, j), sine.atan2(a.dot(b).abs()).to_degrees())
        })
    }

    /// Returns the first two of the planes that differ most in direction, and the angle between
    /// them.
    fn farthest_pair(&self) -> Option<((usize, usize), f64)> {
        self.pairs()
            .reduce(|farthest, pair| match pair.1 > farthest.1 {
                true => pair,
                false => farthest,
            })
    }

    /// Returns the largest angle between a plane and the image plane, in degrees.
    fn largest_tilt(&self) -> f64 {
        let tilts = self.view.planes.iter().map(|plane| {
            let normal = plane.pose.normal();
            normal.xy().norm().atan2(normal.z.abs()).to_degrees()
        });
        tilts.fold(0.0, f64::max)
    }
}

/// Returns width and height of the box around points.
fn span(points: impl Iterator<Item = Vector2<f64>>) -> Vector2<f64> {
    let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
    for point in points {
        low = low.inf(&point);
        high = high.sup(&point);
    }
    (high - low).sup(&Vector2::zeros())
}
