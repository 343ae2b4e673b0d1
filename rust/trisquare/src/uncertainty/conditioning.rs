//! The refusal of geometry from which the camera matrix does not follow.
//!
//! K must follow from the planes, not from the lens polynomial: wherever the principal point is
//! free, the covariance is judged with the centre of distortion freed from it. (Tied, the
//! polynomial's centre would vouch for the principal point, and with it the planes' one direction
//! for the focal lengths: parallel planes would give plausible numbers.)
//!
//! The rule: refused is what predicts a standard deviation above [`MAX_STD`] of the focal length
//! (`fx`, `fy`) or of the width (`cx`, `cy`). The evidence, over scenes of three squares measured
//! every 4 px with noise of 0.05 to 0.5 px, each by its worst parameter: 3,000 sound scenes (tilts
//! of 25 to 50 degrees) have a median of 0.5 % and a largest value of 2.9 %; 2,000 scenes of
//! parallel planes have a median of 43 % and a smallest value of 5.9 %. The latter does not depend
//! on the noise, because the angle between planes that are parallel is estimated at some multiple
//! of its own standard deviation, and what that angle tells of K has a relative error of one over
//! that multiple; its distribution falls off like a Gaussian's tail toward the limit.
//!
//! Strong noise alone is no reason to refuse: where planes clearly differ in direction (by more
//! than [`DISTINCT_DEGREES`], which in 1,000 scenes of parallel planes with noise of 1 to 3 px no
//! estimate reached whose standard deviation was below the limit) the limit grows with the noise
//! above [`COMMON_NOISE`], so that a sound scene photographed badly returns large standard
//! deviations. And exact samples do not make a degenerate geometry sound: less noise than
//! [`MIN_NOISE`] is judged as if it were that, because boards are not flat and lenses are not
//! polynomials.
//!
//! Where a value of the camera matrix is held, residuals above [`NO_NOISE`] say that it is wrong: the
//! planes contradict it, and what the residuals predict hangs on where the search ended. (Of 24 scenes,
//! a focal length held at 1,000 times the truth left 4 % of half the diagonal or more in all that
//! found an optimum; one at 1.3 times left 0.3 % at most.)
//!
//! A freed skew has no limit of its own: where the planes leave it open, it is the focal lengths and
//! the principal point that suffer.

use nalgebra::{DMatrix, Vector2};

use super::covariance::covariance;
use crate::ill_conditioning::{Cause, IllConditioning, Remedy};
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::numeric::ArrowSystem;
use crate::observations::{Fixed, FreeParameters, ObservedPlane, Options, View};

/// Largest standard deviation accepted: of a focal length as a part of it, of the principal point
/// as a part of the width. Between the sound and the parallel scenes of the module's evidence.
const MAX_STD: f64 = 0.04;

/// The same where the principal point is held, and no lens polynomial can stand in for the planes:
/// those that face the camera, which is what remains to be refused, predict 18 % or more (250
/// scenes). Of parallel planes tilted by 25 to 50 degrees, which are legitimate then, 6 % predict
/// more than 4 %, and 2 % more than 10 %: about an axis along the picture's own, tilt leaves the
/// aspect open.
const MAX_STD_CENTRED: f64 = 0.1;

/// The one that holds for what is fixed.
pub(super) fn largest_std(fixed: Fixed) -> f64 {
    match fixed.principal_point {
        true => MAX_STD_CENTRED,
        false => MAX_STD,
    }
}

/// Noise of one pixel of edge above which the limit grows: what ordinary pictures have at most
/// (0.5 px for samples 4 px apart).
const COMMON_NOISE: f64 = 1.0;

/// The limit grows with the noise to so many times itself, where a linear prediction ends.
const MAX_LIMIT_GROWTH: f64 = 4.0;

/// Planes so far apart (degrees) are certainly not parallel.
const DISTINCT_DEGREES: f64 = 25.0;

/// Noise of one pixel of edge that is assumed at least (0.1 px for samples 4 px apart): below, what
/// is wrong with paper and lens is larger.
const MIN_NOISE: f64 = 0.2;

/// Residuals of so large a part of half the picture's diagonal are no noise.
const NO_NOISE: f64 = 0.01;

/// Standard deviation granted to a freed centre of distortion beforehand, in half image
/// diagonals: it is unobservable where there is no distortion, and then tells nothing anyway.
const CENTRE_PRIOR: f64 = 0.5;

/// A standard deviation above this part of its limit asks for a second look at the optimum.
const DOUBTFUL: f64 = 0.3;

/// Planes less apart than this (degrees) are called parallel when the geometry is refused.
const PARALLEL_DEGREES: f64 = 5.0;

/// Planes less apart, or less tilted, than this (degrees) are the likeliest cause of a refusal.
const ALIKE_DEGREES: f64 = 20.0;

/// Figures that span less than this part of the picture's height are small.
const SMALL_SPAN: f64 = 0.2;

/// Figures that span less than this part of both width and height huddle together.
const HUDDLED_SPAN: f64 = 0.6;

/// The free parameters, with the centre of distortion freed from the principal point where the
/// lens polynomial could otherwise stand in for the planes.
pub(crate) fn judged_parameters(free: &FreeParameters) -> FreeParameters {
    if free.position("cx").is_some() {
        free.with_free_centre()
    } else {
        free.clone()
    }
}

/// What a judgement of the geometry looks at.
pub(crate) struct Conditioning<'a, L: Lens> {
    pub view: &'a View<L>,
    pub planes: &'a [ObservedPlane],
    pub size: ImageSize,
    pub options: &'a Options<L>,
    /// What the samples' standard deviations are to be multiplied by.
    pub noise_scale: f64,
}

/// The parameter of the camera matrix that is known worst.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weakest {
    pub parameter: &'static str,
    /// As a part of a focal length itself, or of the picture's width; infinite where it is not
    /// observable.
    pub std: f64,
    /// In the same unit.
    pub limit: f64,
}

impl Weakest {
    /// The standard deviation as a part of what is accepted.
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
    /// Why the camera matrix does not follow from the geometry, without remedies; `None` where it
    /// does.
    ///
    /// `system` holds the normal equations over the [`judged_parameters`], `factor` turns the
    /// inverse of their information into a covariance.
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

    /// The refusal of what is held of the camera matrix, in an optimum without it; of what is free
    /// with it, one parameter is named.
    pub fn of_contradicted(
        &self,
        parameter: &'static str,
        fixed: Fixed,
        remedy: Remedy,
    ) -> IllConditioning {
        IllConditioning {
            cause: self.cause(),
            parameter,
            std: f64::INFINITY,
            limit: largest_std(fixed),
            remedies: vec![remedy],
        }
    }

    /// The parameter that is known worst in proportion to its limit; `None` if K is held.
    pub fn weakest(
        &self,
        system: &ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) -> Option<Weakest> {
        let noise = self.noise();
        // Where a bent side was left out, the paper has shown what is wrong with it.
        let entire = self
            .planes
            .iter()
            .flat_map(ObservedPlane::sides)
            .all(|side| !side.is_outlier);
        let floor = match entire {
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
        (focal || principal_point) && residual > NO_NOISE * self.size.half_diagonal()
    }

    fn judged_covariance(
        &self,
        system: &ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) -> Option<DMatrix<f64>> {
        let mut system = system.clone();
        self.bound_centre(&mut system, free, factor);
        covariance(&system, factor)
    }

    /// Bounds the centre of distortion where it is freed from the principal point: the parameters
    /// after the free ones.
    pub(super) fn bound_centre(
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
        largest_std(self.options.fixed) * growth
    }

    /// Noise of one pixel of edge: that of a sample, brought from the samples' spacing to 1 px.
    fn noise(&self) -> f64 {
        let (mut weights, mut length) = (0.0, 0.0);
        for side in self.planes.iter().flat_map(ObservedPlane::sides) {
            weights += side.samples.iter().map(|s| s.weight.powi(2)).sum::<f64>();
            length += span(side.samples.iter().map(|s| s.pixel)).norm();
        }
        let noise = self.noise_scale * (length / weights).sqrt();
        // Samples without weight or extent tell nothing.
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

    /// The larger dimension of the largest figure, in pixels.
    fn largest_figure(&self) -> f64 {
        let figures = self.planes.iter().flat_map(|plane| &plane.figures);
        figures
            .map(|figure| span(figure.samples().map(|s| s.pixel)).amax())
            .fold(0.0, f64::max)
    }

    /// All pairs of planes, and the angles between their directions in degrees.
    fn pairs(&self) -> impl Iterator<Item = ((usize, usize), f64)> {
        let normals: Vec<_> = self.view.planes.iter().map(|p| p.pose.normal()).collect();
        let pairs = (0..normals.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
        pairs.map(move |(i, j)| {
            let (a, b) = (&normals[i], &normals[j]);
            let sine = a.cross(b).norm();
            ((i, j), sine.atan2(a.dot(b).abs()).to_degrees())
        })
    }

    /// The first two of the planes that differ most in direction, and the angle between them.
    fn farthest_pair(&self) -> Option<((usize, usize), f64)> {
        self.pairs()
            .reduce(|farthest, pair| match pair.1 > farthest.1 {
                true => pair,
                false => farthest,
            })
    }

    /// The largest angle between a plane and the image plane, in degrees.
    fn largest_tilt(&self) -> f64 {
        let tilts = self.view.planes.iter().map(|plane| {
            let normal = plane.pose.normal();
            normal.xy().norm().atan2(normal.z.abs()).to_degrees()
        });
        tilts.fold(0.0, f64::max)
    }
}

/// Width and height of the box around points.
fn span(points: impl Iterator<Item = Vector2<f64>>) -> Vector2<f64> {
    let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
    for point in points {
        low = low.inf(&point);
        high = high.sup(&point);
    }
    (high - low).sup(&Vector2::zeros())
}
