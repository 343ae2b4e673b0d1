//! Restriction of rich models to lenses that see all of the picture: that do not turn back inside
//! it.

use nalgebra::Vector2;

use super::problem::JointProblem;
use super::starts::Starts;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::observations::{ObservedPlane, View};
use crate::refine::{Refined, information};

/// Standard deviations (px), in successive steps, of the distance by which a lens may end short of
/// the corners that it has to see.
const SHORTFALLS: [f64; 5] = [100.0, 30.0, 10.0, 3.0, 1.0];

/// Increase of half the sum of squares, in units of the noise, above which the samples contradict
/// lenses that see all of the picture: four standard deviations.
const CONTRADICTED: f64 = 8.0;

/// Maximum ratio of such a lens's residuals to those of the lens that fits best.
const MAX_CONTRADICTED: f64 = 1.1;

/// Whether a lens certainly sees as far from its principal point, in all directions, as the
/// picture's corners are.
fn reaches_corners<L: Lens>(lens: &L, size: ImageSize) -> bool {
    let offsets = size.corners().map(|corner| corner - lens.principal_point());
    let valid_radius = lens.valid_pixel_radius();
    offsets.iter().all(|offset| offset.norm() < valid_radius)
}

impl<'a, L: Lens> JointProblem<'a, L> {
    /// The problem restricted to lenses that see all of the picture, if its optimum may not and the
    /// samples allow them: the search starts from that optimum and proceeds in steps, as its lens
    /// may turn back far from the corners.
    pub(super) fn seeing_whole_picture(self) -> Self {
        let size = self.size;
        let Some((planes, best)) = &self.found else {
            return self;
        };
        let best = &best.refined;
        let max_noise = MAX_CONTRADICTED * best.noise_scale;
        let mut view = best.view.clone();
        let mut last = None;
        for shortfall in SHORTFALLS {
            if self.work.is_spent() || reaches_corners(&view.lens, size) {
                break;
            }
            let free = self.free.clone().with_reach(size, shortfall);
            let problem = Self::new(size, self.options).with_work(&self.work);
            let problem = problem.with_free(free);
            let found = Starts::optimum_near(&problem, planes, view);
            let Some(found) = found.filter(|found| found.noise_scale < max_noise) else {
                break;
            };
            view = found.view.clone();
            if view.lens.sees_all_of(size) {
                last = Some((problem, found));
            }
        }
        match last {
            Some((problem, found)) => problem.starting_at(planes, found, best),
            None => self,
        }
    }

    /// The problem with its searches starting from its optimum `found`, given the lens that fits
    /// best.
    fn starting_at(
        self,
        planes: &'a [ObservedPlane],
        found: Refined<L>,
        best: &Refined<L>,
    ) -> Self {
        let cost = |view: &View<L>| {
            let information = information(planes, &self.free, (view, best.scale));
            information.map_or(f64::INFINITY, |(cost, _)| cost)
        };
        let is_contradicted = cost(&found.view) > cost(&best.view) + CONTRADICTED;
        let change = || self.free.difference(&best.view.lens, &found.view.lens);
        Self {
            contradicted: is_contradicted.then(change),
            beginning: Some(self.beginning_at(found.view.clone())),
            found: Some((planes, found.into())),
            ..self
        }
    }

    /// Checks that the lens of a rich model does not turn back inside the picture.
    ///
    /// # Errors
    /// [`Error::TurnsBack`].
    pub fn check_reach(&self, lens: &L) -> Result<(), Error> {
        if !self.is_rich() {
            return Ok(());
        }
        let distance = |pixel: &Vector2<f64>| (pixel - lens.principal_point()).norm();
        let corners = self.size.corners();
        let unseen = corners
            .iter()
            .filter_map(|corner| Some((distance(&lens.rim_towards(corner)?), distance(corner))));
        match unseen.max_by(|(_, a), (_, b)| a.total_cmp(b)) {
            Some((radius, corner)) => Err(Error::TurnsBack { radius, corner }),
            None => Ok(()),
        }
    }
}
