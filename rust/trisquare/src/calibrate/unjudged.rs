//! Calibrations for comparisons, without checks of the geometry or without remedies.

use std::rc::Rc;

use super::comparison::Comparison;
use super::stages::CheckedInput;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::observations::{Options, PlaneEdges, sort_by_plane};
use crate::result::Calibration;
use crate::solver::{JointProblem, NestedOptima, Work};

/// As [`calibrate`], without checks of the geometry: for a comparison of models, the richest first,
/// of which the chosen one is checked later. They share their work, which the first one bounds.
pub(crate) fn calibrate_unjudged<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    shared: &mut Comparison<L>,
) -> Result<Calibration<L>, Error> {
    CheckedInput::check(edges, size, options, None)?.compared(shared)
}

/// As [`calibrate`], if no plane or side has to be rejected; `None` if one has, or if there is no
/// solution. Remedies are not computed: that takes longer than the test for disagreement.
pub(crate) fn calibrate_agreeing<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Option<Calibration<L>> {
    CheckedInput::check(edges, size, options, None)
        .ok()?
        .agreeing()
}

/// Result of one fit of a lens to all planes.
pub(crate) struct FirstFit {
    /// Whether the planes agree.
    pub agrees: bool,
    /// Root mean square of the residuals, in pixels.
    pub rms: f64,
}

impl FirstFit {
    /// Fits without the search for false planes; `None` if the fit fails, which that search might
    /// prevent.
    pub(crate) fn of<L: Lens>(
        edges: &[PlaneEdges],
        size: ImageSize,
        options: &Options<L>,
    ) -> Option<Self> {
        let planes = sort_by_plane(edges).ok()?;
        let work = Rc::new(Work::for_planes(&planes));
        let nested = &mut NestedOptima::default();
        let problem = JointProblem::of_planes(&planes, size, options, &work, nested);
        let found = problem.solve(&planes).ok()?;
        Some(Self {
            agrees: found.agrees(&problem),
            rms: found.refined.rms(),
        })
    }
}
