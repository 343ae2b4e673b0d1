//! The stages, in order, and nothing else.

use nalgebra::Matrix3;

use crate::covariance::{Geometry, check_plane_count};
use crate::drift;
use crate::levenberg::Termination;
use crate::linear::{
    Homographies, Undistortion, conic_camera_matrix, fallback_camera_matrices, first_view,
};
use crate::observations::{ObservedPlane, Sample, sort_by_plane};
use crate::parameters::FreeParameters;
use crate::photometric::{self, Photographs};
use crate::refine::{Refined, Search, finish, search};
use crate::result::{Calibration, Stage};
use crate::view::View;
use crate::{Brown, Error, ImageSize, Method, Options, PlaneEdges};

/// Samples of each side with which the search for the optimum starts: enough for the robust
/// scale, and within a few standard deviations of what all samples will say.
const START_SAMPLES_PER_SIDE: usize = 16;

/// Calibrates a camera from edge samples of planes with known lines.
///
/// The paper's three steps (Zhou et al. 2013) and, unless `options.method` is linear, joint
/// maximum likelihood over all of them. Pixels; standard deviations are one sigma.
///
/// # Errors
/// Every variant of [`Error`] says what is wrong and what would help.
pub fn calibrate(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options,
) -> Result<Calibration, Error> {
    calibrate_photographs(edges, size, options, None)
}

/// As [`calibrate`], with the photographs themselves: the refined model is then fitted to the
/// pixels around the edges, corners included, and taken where that improves the answer.
///
/// # Errors
/// As [`calibrate`].
pub fn calibrate_photographs(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options,
    photographs: Option<&Photographs<'_>>,
) -> Result<Calibration, Error> {
    size.check()?;
    options.check()?;
    let planes = sort_by_plane(edges)?;
    let free = options.free_parameters();
    check_plane_count(planes.len(), &free)?;

    let judged = judged_parameters(&free);
    let sample_limit = match options.method {
        Method::Linear => usize::MAX,
        Method::MaximumLikelihood => START_SAMPLES_PER_SIDE,
    };
    let some: Vec<ObservedPlane> = planes.iter().map(|p| p.thinned(sample_limit)).collect();
    let undistortion = Undistortion::estimate(&some, size, options)?;
    let homographies = Homographies::estimate(&some, &undistortion)?;
    let stages = Stages {
        planes: &planes,
        some: &some,
        free: &free,
        judged: &judged,
        size,
        options,
        undistortion: &undistortion,
        homographies: &homographies,
    };
    match options.method {
        Method::Linear => stages.result(&stages.linear()?, Stage::Linear),
        Method::MaximumLikelihood => {
            let refined = drift::accounted(&planes, &free, &judged, stages.refine()?);
            let mut calibration = stages.result(&refined, Stage::Edges)?;
            if let Some(photographs) = photographs {
                photometric::improve(
                    edges,
                    &planes,
                    &free,
                    &refined,
                    photographs,
                    &mut calibration,
                );
            }
            Ok(calibration)
        }
    }
}

/// The free parameters, with the centre of distortion freed from the principal point where the
/// lens polynomial could otherwise stand in for the planes.
fn judged_parameters(free: &FreeParameters) -> FreeParameters {
    if free.position("fx").is_some() && free.position("cx").is_some() {
        free.with_free_centre()
    } else {
        free.clone()
    }
}

/// What every stage may look at.
struct Stages<'a> {
    planes: &'a [ObservedPlane],
    /// The same with fewer samples: from these the search starts.
    some: &'a [ObservedPlane],
    free: &'a FreeParameters,
    judged: &'a FreeParameters,
    size: ImageSize,
    options: &'a Options,
    undistortion: &'a Undistortion,
    homographies: &'a Homographies,
}

impl Stages<'_> {
    fn view(&self, camera_matrix: &Matrix3<f64>) -> Result<View<Brown>, Error> {
        let view = first_view(
            camera_matrix,
            self.homographies,
            self.planes,
            self.undistortion,
            self.size,
            self.options,
        )?;
        let unknowns = view.unknowns(self.free);
        let samples = self.samples().count();
        if samples <= unknowns {
            return Err(Error::TooFewDegreesOfFreedom { samples, unknowns });
        }
        Ok(view)
    }

    fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.planes.iter().flat_map(ObservedPlane::samples)
    }

    /// The linear steps' own answer.
    fn linear(&self) -> Result<Refined<Brown>, Error> {
        let camera_matrix = conic_camera_matrix(self.homographies, self.size, self.options)?;
        let view = self.view(&camera_matrix)?;
        Refined::of_linear(self.planes, self.free, self.judged, view).ok_or(Error::NotConverged {
            stage: "the linear solution (its distortion is not invertible at a sample)",
            iterations: 0,
            rms: 0.0,
        })
    }

    /// Joint maximum likelihood from the conic's camera matrix, or from the first fallback that
    /// settles where that one does not.
    fn refine(&self) -> Result<Refined<Brown>, Error> {
        let conic = conic_camera_matrix(self.homographies, self.size, self.options);
        let starts = conic.into_iter().chain(fallback_camera_matrices(
            self.homographies,
            self.size,
            self.options,
        ));
        let mut unsettled: Option<Search<Brown>> = None;
        for camera_matrix in starts {
            let start = match self.view(&camera_matrix) {
                Err(error @ Error::TooFewDegreesOfFreedom { .. }) => return Err(error),
                Err(_) => continue,
                Ok(start) => start,
            };
            // Where the straightening's polynomial does not reach a sample, start without.
            let pinhole = View {
                lens: start.lens.without_distortion(),
                ..start.clone()
            };
            let found = search(self.some, self.free, start)
                .or_else(|| search(self.some, self.free, pinhole));
            match found {
                Some(found) if found.termination == Termination::Converged => {
                    match self.finish(found.clone()) {
                        Some(refined) => return Ok(refined),
                        None => unsettled = unsettled.or(Some(found)),
                    }
                }
                Some(found) => unsettled = unsettled.or(Some(found)),
                None => {}
            }
        }
        Err(self.no_convergence(unsettled))
    }

    /// From the optimum of some samples to that of all.
    fn finish(&self, found: Search<Brown>) -> Option<Refined<Brown>> {
        let view = found.view.clone();
        finish(self.planes, self.free, self.judged, found).or_else(|| {
            // Some samples misled: search among all of them.
            let found = search(self.planes, self.free, view)?;
            let converged = found.termination == Termination::Converged;
            let found = converged.then_some(found)?;
            finish(self.planes, self.free, self.judged, found)
        })
    }

    /// A geometry that cannot answer is the likeliest reason, and has its own error.
    fn no_convergence(&self, unsettled: Option<Search<Brown>>) -> Error {
        let iterations = unsettled.as_ref().map_or(0, |found| found.iterations);
        let refined = unsettled
            .and_then(|found| Refined::of_linear(self.some, self.free, self.judged, found.view));
        let rms = refined.as_ref().map_or(0.0, |refined| refined.noise_scale);
        if let Some(Err(error)) = refined.map(|refined| self.judge(&refined)) {
            return error;
        }
        Error::NotConverged {
            stage: "the joint refinement",
            iterations,
            rms,
        }
    }

    fn judge(&self, refined: &Refined<Brown>) -> Result<(), Error> {
        let weights: f64 = self.samples().map(|s| s.weight * s.weight).sum();
        let typical_std = (self.samples().count() as f64 / weights).sqrt();
        let geometry = Geometry {
            view: &refined.view,
            size: self.size,
            options: self.options,
            noise: refined.noise_scale * typical_std,
        };
        geometry.judge(&refined.system, self.free, refined.covariance_factor)
    }

    /// Judges the geometry, and only then gives numbers.
    fn result(&self, refined: &Refined<Brown>, stage: Stage) -> Result<Calibration, Error> {
        self.judge(refined)?;
        Calibration::assemble(self.planes, self.free, self.size, refined, stage).ok_or(
            Error::NotConverged {
                stage: "the covariance",
                iterations: refined.iterations,
                rms: refined.noise_scale,
            },
        )
    }
}
