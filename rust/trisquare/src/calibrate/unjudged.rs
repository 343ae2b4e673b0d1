//! Calibrations that are compared with others, without a judgement or without advice.

use std::rc::Rc;

use super::comparison::Comparison;
use super::stages::CheckedInput;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::observations::{Options, PlaneEdges, sort_by_plane};
use crate::result::Calibration;
use crate::solver::{JointProblem, NestedOptima, Work};

/// As [`calibrate`], without a judgement of the geometry: to compare models, the richest first, of
/// which the chosen one is judged. They share their work, which the first one bounds.
pub(crate) fn calibrate_unjudged<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    shared: &mut Comparison<L>,
) -> Result<Calibration<L>, Error> {
    CheckedInput::check(edges, size, options, None)?.compared(shared)
}

/// As [`calibrate`], if no plane or side has to be rejected; `None` where one has, or there is no
/// answer. What would help is not looked for, which takes longer than to see that they disagree.
pub(crate) fn calibrate_agreeing<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Option<Calibration<L>> {
    CheckedInput::check(edges, size, options, None)
        .ok()?
        .agreeing()
}

/// What one fit of a lens to all planes leaves.
pub(crate) struct FirstFit {
    /// Whether the planes agree.
    pub agrees: bool,
    /// Of the residuals, in pixels.
    pub rms: f64,
}

impl FirstFit {
    /// Without the search for false planes; `None` where the fit fails, which that search may mend.
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
