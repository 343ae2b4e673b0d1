//! The stages, in order, and nothing else.

use nalgebra::DMatrix;

use crate::consistency::disagreement;
use crate::covariance::{Geometry, check_plane_count, covariance};
use crate::levenberg::{Problem, Termination};
use crate::linear::{
    Homographies, Undistortion, conic_camera_matrix, fallback_camera_matrices, first_view,
};
use crate::observations::{ObservedPlane, sort_by_plane};
use crate::parameters::FreeParameters;
use crate::photometric::{self, Photographs};
use crate::refine::{EdgeProblem, EdgeProblemFor, PlaneState, Refined, View, refine, residuals};
use crate::result::{Calibration, Stage, Warning};
use crate::robust::Loss;
use crate::{Brown, Error, ImageSize, Method, Options, PlaneEdges};

/// Samples of each side that the straightening uses when the refinement follows anyway.
const START_SAMPLES_PER_SIDE: usize = 24;

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

    let samples_per_side = match options.method {
        Method::Linear => usize::MAX,
        Method::MaximumLikelihood => START_SAMPLES_PER_SIDE,
    };
    let undistortion = Undistortion::estimate(&planes, size, options, samples_per_side)?;
    let homographies = Homographies::estimate(&planes, &undistortion)?;
    let stages = Stages {
        planes: &planes,
        free: &free,
        size,
        options,
        undistortion: &undistortion,
        homographies: &homographies,
    };
    match options.method {
        Method::Linear => stages.finish_linear(),
        Method::MaximumLikelihood => {
            let refined = stages.refine()?;
            let mut calibration = stages.finish(&refined, Stage::Edges)?;
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

/// What every stage may look at.
struct Stages<'a> {
    planes: &'a [ObservedPlane],
    free: &'a FreeParameters,
    size: ImageSize,
    options: &'a Options,
    undistortion: &'a Undistortion,
    homographies: &'a Homographies,
}

impl Stages<'_> {
    fn view(&self, camera_matrix: &nalgebra::Matrix3<f64>) -> Result<View<Brown>, Error> {
        first_view(
            camera_matrix,
            self.homographies,
            self.planes,
            self.undistortion,
            self.size,
            self.options,
        )
    }

    fn sample_count(&self) -> usize {
        self.planes.iter().map(|p| p.samples().count()).sum()
    }

    fn check_freedom(&self, view: &View<Brown>) -> Result<(), Error> {
        let unknowns = self.free.len()
            + view
                .planes
                .iter()
                .map(PlaneState::parameter_count)
                .sum::<usize>();
        let samples = self.sample_count();
        if samples <= unknowns {
            return Err(Error::TooFewDegreesOfFreedom { samples, unknowns });
        }
        Ok(())
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
        let mut last: Option<Refined<Brown>> = None;
        for camera_matrix in starts {
            let Ok(start) = self.view(&camera_matrix) else {
                continue;
            };
            self.check_freedom(&start)?;
            // Where the straightening's polynomial does not reach a sample, start without.
            let pinhole = View {
                lens: start.lens.without_distortion(),
                ..start.clone()
            };
            let refined = refine(self.planes, self.free, start)
                .or_else(|| refine(self.planes, self.free, pinhole));
            match refined {
                Some(refined) if refined.termination == Termination::Converged => {
                    return Ok(refined);
                }
                Some(refined) => last = last.or(Some(refined)),
                None => {}
            }
        }
        // A geometry that cannot answer is the likeliest reason: it has its own error.
        let iterations = last.as_ref().map_or(0, |refined| refined.iterations);
        if let Some(refined) = &last {
            self.judge(refined)?;
        }
        Err(Error::NotConverged {
            stage: "the joint refinement",
            iterations,
            rms: last.map_or(0.0, |refined| refined.scale),
        })
    }

    fn system(
        &self,
        refined: &Refined<Brown>,
        free: &FreeParameters,
        loss: Loss,
    ) -> Option<crate::arrow::ArrowSystem> {
        let problem = EdgeProblemFor {
            problem: EdgeProblem {
                planes: self.planes,
                free,
                loss,
                scale: refined.scale,
            },
            lens: std::marker::PhantomData,
        };
        Some(problem.evaluate(&refined.view)?.1)
    }

    fn judge(&self, refined: &Refined<Brown>) -> Result<(), Error> {
        // Only where both are free can the lens polynomial stand in for the planes.
        let both = self.free.position("fx").is_some() && self.free.position("cx").is_some();
        let judged = if both {
            self.free.with_free_centre()
        } else {
            self.free.clone()
        };
        let weights: f64 = self
            .planes
            .iter()
            .flat_map(ObservedPlane::samples)
            .map(|s| s.weight * s.weight)
            .sum();
        let typical_std = (self.sample_count() as f64 / weights).sqrt();
        let geometry = Geometry {
            view: &refined.view,
            size: self.size,
            options: self.options,
            noise: refined.noise_scale * typical_std,
        };
        let system = self
            .system(refined, &judged, Loss::Tukey)
            .unwrap_or_else(|| crate::arrow::ArrowSystem::zeros(judged.len(), std::iter::empty()));
        geometry.judge(&system, self.free, refined.covariance_factor)
    }

    fn finish_linear(&self) -> Result<Calibration, Error> {
        let camera_matrix = conic_camera_matrix(self.homographies, self.size, self.options)?;
        let view = self.view(&camera_matrix)?;
        self.check_freedom(&view)?;
        let refined =
            Refined::of_linear(self.planes, self.free, view).ok_or(Error::NotConverged {
                stage: "the linear solution (its distortion is not invertible at a sample)",
                iterations: 0,
                rms: 0.0,
            })?;
        self.finish(&refined, Stage::Linear)
    }

    fn finish(&self, refined: &Refined<Brown>, stage: Stage) -> Result<Calibration, Error> {
        self.judge(refined)?;
        let singular = || Error::NotConverged {
            stage: "the covariance",
            iterations: refined.iterations,
            rms: refined.scale,
        };
        let system = self
            .system(refined, self.free, Loss::Tukey)
            .ok_or_else(singular)?;
        let covariance = if self.free.len() == 0 {
            DMatrix::zeros(0, 0)
        } else {
            covariance(&system, refined.covariance_factor).ok_or_else(singular)?
        };
        let warnings = disagreement(
            &system,
            self.free,
            refined.view.lens.focal().x,
            refined.covariance_factor,
        )
        .map(Warning::Disagreement);
        let residuals = residuals(self.planes, &refined.view).ok_or_else(singular)?;
        Ok(Calibration::assemble(
            self.planes,
            self.free,
            self.size,
            refined,
            covariance,
            &residuals,
            warnings.into_iter().collect(),
            stage,
        ))
    }
}
