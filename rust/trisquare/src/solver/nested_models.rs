//! Models richer than the default begin where the next poorer one ends, and have to be lenses.

use std::rc::Rc;

use super::problem::JointProblem;
use super::work::Work;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{Method, ObservedPlane, Options};

/// Pixels to which it is told where a distortion turns back.
const REACH_TOLERANCE: f64 = 0.5;

impl<'a, L: Lens> JointProblem<'a, L> {
    /// What is asked of some planes, beginning from what the next poorer model finds where the
    /// model is richer than the default.
    pub fn of_planes(
        planes: &[ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
    ) -> Self {
        let lens = poorer_lens(planes, size, options, work);
        Self::new(size, options).beyond(lens).within(work)
    }

    /// Refuses the lens of a rich model that turns back inside the picture.
    ///
    /// # Errors
    /// [`Error::TurnsBack`].
    pub fn check_reach(&self, lens: &L) -> Result<(), Error> {
        if !self.is_rich() || lens.sees_all_of(self.size) {
            return Ok(());
        }
        let centre = lens.principal_point();
        let offsets = self.size.corners().map(|corner| corner - centre);
        let farthest = offsets.iter().max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let farthest = farthest.copied().unwrap_or_default();
        let (mut seen, mut unseen) = (0.0, 1.0);
        while (unseen - seen) * farthest.norm() > REACH_TOLERANCE {
            let middle = 0.5 * (seen + unseen);
            match lens.unproject(&(centre + farthest * middle)) {
                Some(_) => seen = middle,
                None => unseen = middle,
            }
        }
        Err(Error::TurnsBack {
            radius: seen * farthest.norm(),
            corner: farthest.norm(),
        })
    }
}

/// The lens of the richest model poorer than the one asked for that converges; `None` where that is
/// no richer than the default.
fn poorer_lens<L: Lens>(
    planes: &[ObservedPlane],
    size: ImageSize,
    options: &Options<L>,
    work: &Rc<Work>,
) -> Option<L> {
    if options.fixed.distortion || options.method == Method::Linear {
        return None;
    }
    let poorer = Options {
        model: options.model.poorer()?,
        ..*options
    };
    let problem = JointProblem::of_planes(planes, size, &poorer, work);
    match problem.optimum(planes) {
        Ok(refined) => Some(refined.view.lens),
        Err(_) => problem.poorer,
    }
}
