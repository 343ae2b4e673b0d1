//! The stages, in order, and nothing else.

use nalgebra::Matrix3;

use crate::covariance::check_plane_count;
use crate::geometry::{Geometry, judged_parameters};
use crate::levenberg::Termination;
use crate::linear::{
    Homographies, Undistortion, conic_camera_matrix, fallback_camera_matrices, first_view,
};
use crate::observations::{ObservedPlane, Sample, sort_by_plane};
use crate::parameters::FreeParameters;
use crate::photometric::{self, Photographs};
use crate::refine::{Refined, Search, finish, search};
use crate::remedies;
use crate::result::{Calibration, Stage};
use crate::view::View;
use crate::weakness::Weakness;
use crate::{Brown, Error, Fixed, ImageSize, Method, Options, PlaneEdges};

/// Samples of each side with which the search for the optimum starts: enough for the robust
/// scale, and within a few standard deviations of what all samples will say.
const START_SAMPLES_PER_SIDE: usize = 16;

/// Residuals with the principal point held may be this part of those with it free, for chance;
/// where they are smaller, the free optimum is a wrong one.
const BEATEN: f64 = 0.98;

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

    with_stages(&planes, size, options, Advice::Sought, |stages| {
        let refined = stages.optimum()?;
        let mut calibration = match stages.result(&refined) {
            Err(Error::WeakGeometry(weakness)) => return Err(stages.advised(&refined, *weakness)),
            other => other?,
        };
        if let (Method::MaximumLikelihood, Some(photographs)) = (options.method, photographs) {
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
    })
}

/// The paper's steps 1 and 2, and on them what `answer` makes of all stages.
fn with_stages<T>(
    planes: &[ObservedPlane],
    size: ImageSize,
    options: &Options,
    advice: Advice,
    answer: impl FnOnce(&Stages<'_>) -> Result<T, Error>,
) -> Result<T, Error> {
    let free = options.free_parameters();
    let judged = judged_parameters(&free);
    let sample_limit = match options.method {
        Method::Linear => usize::MAX,
        Method::MaximumLikelihood => START_SAMPLES_PER_SIDE,
    };
    let some: Vec<ObservedPlane> = planes.iter().map(|p| p.thinned(sample_limit)).collect();
    let undistortion = Undistortion::estimate(&some, size, options)?;
    let homographies = Homographies::estimate(&some, &undistortion)?;
    answer(&Stages {
        planes,
        some: &some,
        free: &free,
        judged: &judged,
        size,
        options,
        advice,
        undistortion: &undistortion,
        homographies: &homographies,
    })
}

/// Whether a refusal says what would help.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Advice {
    Sought,
    /// This run is itself the trial of a remedy.
    NotSought,
}

/// Keeps the optimum with the smaller residuals.
fn keep_better(best: &mut Option<Refined<Brown>>, found: Refined<Brown>) {
    if best
        .as_ref()
        .is_none_or(|b| found.noise_scale < b.noise_scale)
    {
        *best = Some(found);
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
    advice: Advice,
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

    /// The answer of the method asked for.
    fn optimum(&self) -> Result<Refined<Brown>, Error> {
        match self.options.method {
            Method::Linear => self.linear().map_err(|error| self.why_not_linear(error)),
            Method::MaximumLikelihood => self.refine(),
        }
    }

    /// The linear steps' own answer.
    fn linear(&self) -> Result<Refined<Brown>, Error> {
        let camera_matrix = conic_camera_matrix(self.homographies, self.size, self.options)?;
        let view = self.view(&camera_matrix)?;
        self.around(view).ok_or(Error::NotConverged {
            stage: "the linear solution (its distortion is not invertible at a sample)",
            iterations: 0,
            rms: 0.0,
        })
    }

    /// Where the linear steps give no camera, its geometry is the likeliest reason, and the
    /// refinement can tell.
    fn why_not_linear(&self, error: Error) -> Error {
        match self.refine() {
            Err(weak @ Error::WeakGeometry(_)) => weak,
            Err(_) => error,
            Ok(refined) => match self.judge(&refined) {
                Err(weakness) => self.advised(&refined, weakness),
                Ok(()) => error,
            },
        }
    }

    /// Joint maximum likelihood from the conic's camera matrix, or from the first fallback that
    /// settles where that one does not.
    ///
    /// A doubtful answer may be a wrong optimum, with the principal point far off and the planes
    /// turned to match: then all starts are tried and the one that fits best is taken.
    fn refine(&self) -> Result<Refined<Brown>, Error> {
        let conic = conic_camera_matrix(self.homographies, self.size, self.options);
        let starts = conic.into_iter().chain(fallback_camera_matrices(
            self.homographies,
            self.size,
            self.options,
        ));
        let mut unsettled: Option<Search<Brown>> = None;
        let mut best: Option<Refined<Brown>> = None;
        for camera_matrix in starts {
            let start = match self.view(&camera_matrix) {
                Err(error @ Error::TooFewDegreesOfFreedom { .. }) => return Err(error),
                Err(_) => continue,
                Ok(start) => start,
            };
            let Some(found) = self.search(self.free, start) else {
                continue;
            };
            match self.finish(found.clone()) {
                Some(refined) if !self.is_doubtful(&refined) => return Ok(refined),
                Some(refined) => keep_better(&mut best, refined),
                None => unsettled = unsettled.or(Some(found)),
            }
        }
        let centred = self.centred();
        let again = centred.clone().and_then(|c| self.search(self.free, c.view));
        if let Some(refined) = again.and_then(|found| self.finish(found)) {
            keep_better(&mut best, refined);
        }
        let beaten = |b: &Refined<Brown>| {
            let held = centred.as_ref().and_then(|c| self.around(c.view.clone()));
            held.is_some_and(|held| held.noise_scale < BEATEN * b.noise_scale)
        };
        best.filter(|b| !beaten(b))
            .ok_or_else(|| self.no_convergence(centred.or(unsettled)))
    }

    /// A view with the spread of all residuals around it.
    fn around(&self, view: View<Brown>) -> Option<Refined<Brown>> {
        Refined::of_linear(self.planes, self.free, self.judged, view)
    }

    /// Searches the optimum of some samples from a start.
    fn search(&self, free: &FreeParameters, start: View<Brown>) -> Option<Search<Brown>> {
        // Where the straightening's polynomial does not reach a sample, start without.
        let pinhole = View {
            lens: start.lens.without_distortion(),
            ..start.clone()
        };
        search(self.some, free, start).or_else(|| search(self.some, free, pinhole))
    }

    /// The optimum with the principal point held where it is known to be, or at the image centre:
    /// parallel planes have one there, though none without.
    fn centred(&self) -> Option<Search<Brown>> {
        let fixed = Fixed {
            principal_point: true,
            ..self.options.fixed
        };
        let options = Options {
            fixed,
            ..*self.options
        };
        let free = options.free_parameters();
        fallback_camera_matrices(self.homographies, self.size, &options)
            .iter()
            .filter_map(|camera_matrix| self.search(&free, self.view(camera_matrix).ok()?))
            .find(|found| found.termination == Termination::Converged)
    }

    /// From the optimum of some samples to that of all.
    fn finish(&self, found: Search<Brown>) -> Option<Refined<Brown>> {
        if found.termination != Termination::Converged {
            return None;
        }
        let view = found.view.clone();
        finish(self.planes, self.free, self.judged, found).or_else(|| {
            // Some samples misled: search among all of them.
            let found = search(self.planes, self.free, view)?;
            let converged = found.termination == Termination::Converged;
            let found = converged.then_some(found)?;
            let view = found.view.clone();
            // Where the cost is far from a parabola, Newton's undamped steps may not settle.
            finish(self.planes, self.free, self.judged, found).or_else(|| self.around(view))
        })
    }

    /// A geometry that cannot answer is the likeliest reason, and has its own error.
    fn no_convergence(&self, unsettled: Option<Search<Brown>>) -> Error {
        let iterations = unsettled.as_ref().map_or(0, |found| found.iterations);
        let refined = unsettled.and_then(|found| self.around(found.view));
        let rms = refined.as_ref().map_or(0.0, |refined| refined.noise_scale);
        if let Some(refined) = &refined
            && let Err(weakness) = self.judge(refined)
        {
            return self.advised(refined, weakness);
        }
        Error::NotConverged {
            stage: "the joint refinement",
            iterations,
            rms,
        }
    }

    fn geometry<'a>(&'a self, refined: &'a Refined<Brown>) -> Geometry<'a, Brown> {
        Geometry {
            view: &refined.view,
            planes: self.planes,
            size: self.size,
            options: self.options,
            noise_scale: refined.noise_scale,
        }
    }

    fn judge(&self, refined: &Refined<Brown>) -> Result<(), Weakness> {
        let geometry = self.geometry(refined);
        geometry.judge(&refined.system, self.free, refined.covariance_factor)
    }

    fn is_doubtful(&self, refined: &Refined<Brown>) -> bool {
        let geometry = self.geometry(refined);
        let weakest = geometry.weakest(&refined.system, self.free, refined.covariance_factor);
        weakest.is_some_and(|weakest| weakest.is_doubtful())
    }

    /// A refusal with what would help.
    fn advised(&self, refined: &Refined<Brown>, mut weakness: Weakness) -> Error {
        let succeeds = |fixed: Fixed| {
            let options = Options {
                fixed,
                ..*self.options
            };
            let trial = |stages: &Stages<'_>| stages.result(&stages.optimum()?);
            with_stages(self.planes, self.size, &options, Advice::NotSought, trial).is_ok()
        };
        if self.advice == Advice::Sought {
            weakness.remedies = remedies::holding(&self.options.fixed, succeeds);
            let geometry = self.geometry(refined);
            let shown = remedies::showing(&geometry, &weakness);
            weakness.remedies.extend(shown);
        }
        Error::WeakGeometry(Box::new(weakness))
    }

    /// Judges the geometry, and only then gives numbers.
    fn result(&self, refined: &Refined<Brown>) -> Result<Calibration, Error> {
        let weak = |weakness| Error::WeakGeometry(Box::new(weakness));
        self.judge(refined).map_err(weak)?;
        let stage = match self.options.method {
            Method::Linear => Stage::Linear,
            Method::MaximumLikelihood => Stage::Edges,
        };
        Calibration::assemble(self.planes, self.free, self.size, refined, stage).ok_or(
            Error::NotConverged {
                stage: "the covariance",
                iterations: refined.iterations,
                rms: refined.noise_scale,
            },
        )
    }
}
