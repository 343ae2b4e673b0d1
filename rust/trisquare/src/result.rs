//! What a calibration returns.

use nalgebra::{DMatrix, Vector2};

use crate::consistency::Disagreement;
use crate::correlated::{Coherence, Correlated};
use crate::observations::{ObservedPlane, Placement};
use crate::pose_uncertainty::pose_uncertainties;
use crate::refine::root_mean_square;
use crate::task::{Solution, Task};
use crate::view::View;
use crate::{Brown, ImageSize, Lens, Pose, PoseUncertainty, ToneFit};

/// The stage a result comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Stage {
    /// The paper's three linear steps.
    Linear,
    /// Joint maximum likelihood over edge samples.
    Edges,
    /// The same model fitted to the pixels.
    Pixels,
}

/// Something a user should know of a result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Warning {
    /// One plane disagrees with the rest.
    #[error(
        "plane {} disagrees with the rest by {:.1} standard deviations (without it, fx would \
         change by {:+.2} %): is it a true, flat square?",
        .0.plane, .0.sigmas, 100.0 * .0.focal_change
    )]
    Disagreement(Disagreement),
    /// One side does not fit the square that the others show.
    #[error(
        "plane {plane}: side {side}{} is set aside: its samples miss the line that all others ask \
         for by {distance:.2} px (is it bent, torn, or covered?)",
        if *.figure == 0 { "" } else { " of its other outline" }
    )]
    SideSetAside {
        /// Index of the plane.
        plane: usize,
        /// Which of the plane's outlines.
        figure: usize,
        /// Which of the outline's sides, in the order of its samples.
        side: usize,
        /// Root mean square distance of its samples, px.
        distance: f64,
    },
    /// One plane does not fit the camera that the others show.
    #[error(
        "plane {plane} was set aside: it disagrees with all others, by {distance:.2} px: is it a \
         true, flat square?"
    )]
    PlaneSetAside {
        /// Index of the plane.
        plane: usize,
        /// Root mean square distance of its samples, px.
        distance: f64,
    },
    /// The planes cannot all be true squares seen by one camera.
    #[error(
        "the planes contradict each other: {factor:.1} times more than their sides' own \
         straightness lets expect; one of them may be no true, flat square"
    )]
    PlanesContradict {
        /// How far the sides are from where one camera would show them, over what is expected.
        factor: f64,
    },
    /// The samples of a side err together, beyond their noise.
    #[error(
        "the samples of a side err together, by {displacement:.3} px on plane {plane} (paper or \
         print not flat, or a lens beyond the model): the standard deviation of {parameter} was \
         raised {factor:.1} times for it"
    )]
    SidesErrTogether {
        /// The plane that shows it most.
        plane: usize,
        /// Root mean square error of a side there, px.
        displacement: f64,
        /// The parameter that suffers most.
        parameter: &'static str,
        /// Its standard deviation over what independent noise alone would give.
        factor: f64,
    },
    /// The pixels did not follow the model closely enough to be used.
    #[error("the fit to the pixels was not taken: {reason}")]
    PixelsNotUsed {
        /// What spoke against it.
        reason: &'static str,
    },
    /// Something lies over a part of one side, which is not used there.
    #[error(
        "plane {plane}: {:.0} % of side {side}{} is left out: something lies over it (a finger, \
         glare, a stain, a torn edge?)",
        100.0 * .part, if *.figure == 0 { "" } else { " of its other outline" }
    )]
    PartlyHidden {
        /// Index of the plane.
        plane: usize,
        /// Which of the plane's outlines.
        figure: usize,
        /// Which of the outline's sides, in the order of its samples.
        side: usize,
        /// Part of the side's length that is left out.
        part: f64,
    },
}

/// A plane of the scene.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plane {
    /// Index of its first figure among the edges given.
    pub figure: usize,
    /// Index of the picture that shows it.
    pub image: usize,
    /// `cam_from_plane`, in units of the first figure's coordinates.
    pub pose: Pose,
    /// Its four corners as observed (distorted), in pixels.
    pub corners: [Vector2<f64>; 4],
    /// Root mean square distance of its samples, in pixels.
    pub rms: f64,
    /// Number of its samples.
    pub samples: usize,
    /// How well its pose is known; `None` where its own samples do not determine it.
    pub uncertainty: Option<PoseUncertainty>,
}

/// A calibrated camera, how well it is known, and where the planes stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The camera.
    pub camera: Brown,
    /// Size of the pictures.
    pub image_size: ImageSize,
    /// Names of the free parameters, in the order of the covariance.
    pub parameters: Vec<&'static str>,
    /// Covariance of the free parameters.
    pub covariance: DMatrix<f64>,
    /// Whether `fy` follows `fx`, so that it has its standard deviation.
    pub aspect_fixed: bool,
    /// The planes, in the order in which their first figures were given.
    pub planes: Vec<Plane>,
    /// Root mean square distance of all samples to the images of their lines, in pixels.
    pub rms: f64,
    /// What the given standard deviations had to be multiplied by to agree with the residuals.
    pub noise_scale: f64,
    /// How far the residuals are from independent noise.
    pub coherence: Coherence,
    /// Evaluations of the refinement.
    pub iterations: usize,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The stage the numbers come from.
    pub stage: Stage,
    /// How each picture was coded, where the fit to the pixels found it out.
    pub tones: Vec<ToneFit>,
}

impl Calibration {
    /// One standard deviation of every free parameter (and of `fy` where it follows `fx`).
    pub fn std(&self) -> Vec<(&'static str, f64)> {
        let mut all = Vec::with_capacity(self.parameters.len() + 1);
        for (i, name) in self.parameters.iter().enumerate() {
            let std = self.covariance[(i, i)].sqrt();
            all.push((*name, std));
            if *name == "fx" && self.aspect_fixed {
                let focal = self.camera.focal();
                all.push(("fy", std * (focal.y / focal.x)));
            }
        }
        all
    }

    /// Says how well the poses of the optimum are known that it was assembled from.
    pub(crate) fn state_poses(&mut self, solution: &Solution) {
        let added = match self.stage {
            Stage::Pixels => &self.coherence.added_to_pixels,
            _ => &self.coherence.added,
        };
        let independent = &self.covariance - added;
        let displacements = &self.coherence.displacements;
        let (planes, refined) = (&solution.planes, &solution.refined);
        let poses = pose_uncertainties(planes, refined, &independent, displacements);
        for (plane, uncertainty) in self.planes.iter_mut().zip(poses) {
            plane.uncertainty = uncertainty;
        }
    }

    /// The numbers of an optimum, but for how well its poses are known.
    pub(crate) fn assemble(task: &Task<'_>, solution: &Solution, stage: Stage) -> Self {
        let Solution {
            planes,
            refined,
            correlated,
            ..
        } = solution;
        let free = &task.free;
        let Correlated {
            covariance,
            disagreement,
            coherence,
        } = correlated.clone();
        let together = coherence.warnings(&covariance, free);
        let disagreement = disagreement.map(Warning::Disagreement);
        let residuals = &refined.residuals;
        Self {
            camera: refined.view.lens,
            image_size: task.size,
            parameters: free.names(),
            covariance,
            aspect_fixed: free.aspect_is_fixed(),
            planes: planes
                .iter()
                .zip(residuals)
                .enumerate()
                .map(|(i, (plane, own))| Plane {
                    figure: plane.figures[0].index,
                    image: plane.image,
                    pose: refined.view.planes[i].pose,
                    corners: observed_corners(plane, &refined.view, i),
                    rms: root_mean_square(own.iter()),
                    samples: own.len(),
                    uncertainty: None,
                })
                .collect(),
            rms: root_mean_square(residuals.iter().flatten().filter(|r| r.counts)),
            noise_scale: refined.noise_scale,
            iterations: refined.iterations,
            warnings: together.into_iter().chain(disagreement).collect(),
            coherence,
            stage,
            tones: Vec::new(),
        }
    }
}

/// The images of a plane's corners: of a square where sides `i - 1` and `i` meet, of a lattice
/// the corners of the rectangle that its lines' crossings span.
pub(crate) fn observed_corners(
    plane: &ObservedPlane,
    view: &View<Brown>,
    index: usize,
) -> [Vector2<f64>; 4] {
    let sides = &plane.figures[0].sides;
    let crossing = |i: usize, j: usize| sides[i].line.intersection(&sides[j].line);
    let square = || -> Option<[Vector2<f64>; 4]> {
        (sides.len() == 4).then_some(())?;
        Some([
            crossing(3, 0)?,
            crossing(0, 1)?,
            crossing(1, 2)?,
            crossing(2, 3)?,
        ])
    };
    let corners = square().unwrap_or_else(|| {
        let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
        for i in 0..sides.len() {
            for j in 0..i {
                // Crossings of nearly parallel lines lie far outside and are none.
                let turn = sides[i].line.normal().perp(&sides[j].line.normal()).abs();
                if let Some(point) = crossing(i, j).filter(|_| turn > 0.1) {
                    low = low.inf(&point);
                    high = high.sup(&point);
                }
            }
        }
        [
            (low.x, low.y),
            (high.x, low.y),
            (high.x, high.y),
            (low.x, high.y),
        ]
        .map(|(x, y)| Vector2::new(x, y))
    });
    let state = &view.planes[index];
    corners.map(|corner| {
        let point = state.pose.transform(&Placement::IDENTITY.point(corner));
        // A corner beyond the valid radius is given where a pinhole would see it.
        view.lens.project(&point).unwrap_or_else(|| {
            let ideal = point.xy() / point.z;
            ideal.component_mul(&view.lens.focal()) + view.lens.principal_point()
        })
    })
}
