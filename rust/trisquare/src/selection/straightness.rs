//! The lens that makes the sides of candidates straightest, and the remaining curvature.
//!
//! The sides of false squares are straight, too, so that one lens fits all that one camera saw. A
//! board in a picture of a picture was seen by another camera: no lens makes all sides straight
//! then, and the lens on which half of the planes agree is used.

use nalgebra::Vector2;

use super::subsets::triples;
use crate::geometry::Line;
use crate::lens::Lens;
use crate::linear::{Straightening, Undistortion};
use crate::noise::{Misfit, Noise};
use crate::observations::{ObservedPlane, Sample, Side};
use crate::refine::{Residual, Residuals, robust_scale, straightness_residuals};
use crate::solver::JointProblem;

/// Mean square curvature, in units of the noise, above which lenses of some planes are tried: that
/// of clearly uneven paper, or of two cameras.
pub(super) const CURVED: f64 = 2.0;

/// Maximum number of triples of planes whose lens is tried: all of six, of which half are right.
const MAX_TRIPLES: usize = 20;

/// Minimum improvement of the straighter half's curvature, in variance, for a lens of some planes
/// to be used: for bent papers the straightest triple improves it by chance two- or threefold.
const CLEARLY_STRAIGHTER: f64 = 4.0;

/// A lens, and the curvature of the sides under it.
pub(crate) struct Straightness<L> {
    pub undistortion: Undistortion<L>,
    /// Mean square curvature of the sides, in units of their noise; at least 1.
    pub curvature: f64,
}

impl<L: Lens> Straightness<L> {
    pub fn of(planes: &[ObservedPlane], problem: &JointProblem<'_, L>) -> Self {
        let common = Straightened::of(planes, undistortion(planes, problem));
        let curvature = common.mean_below(f64::INFINITY);
        if curvature < CURVED {
            return Self {
                undistortion: common.undistortion,
                curvature,
            };
        }
        let indices: Vec<usize> = (0..planes.len()).collect();
        let by_triple = |triple: [usize; 3]| {
            let subset = triple.map(|i| planes[i].clone());
            let found = Undistortion::estimate(&subset, problem.size, problem.options).ok()?;
            Some(Straightened::of(planes, found))
        };
        let triples = triples(&indices, MAX_TRIPLES);
        let lenses = triples.into_iter().filter_map(by_triple);
        let best = lenses.min_by(|a, b| a.lower_median().total_cmp(&b.lower_median()));
        match best {
            Some(best) if CLEARLY_STRAIGHTER * best.lower_median() < common.lower_median() => {
                Self {
                    curvature: best.mean_below(CLEARLY_STRAIGHTER * best.lower_median()),
                    undistortion: best.undistortion,
                }
            }
            _ => Self {
                undistortion: common.undistortion,
                curvature,
            },
        }
    }

    /// Curvature under a known lens; `None` if it does not see all sides.
    pub fn by_lens(planes: &[ObservedPlane], lens: L) -> Option<Self> {
        let found = Straightened::of(planes, Undistortion::Known(lens));
        (!found.misfits.is_empty()).then(|| Self {
            curvature: found.mean_below(f64::INFINITY),
            undistortion: found.undistortion,
        })
    }
}

fn undistortion<L: Lens>(
    planes: &[ObservedPlane],
    problem: &JointProblem<'_, L>,
) -> Undistortion<L> {
    Undistortion::estimate(planes, problem.size, problem.options)
        .unwrap_or_else(|_| Undistortion::Straightened(Straightening::identity(problem.size)))
}

/// Planes undistorted by a lens.
struct Straightened<L> {
    undistortion: Undistortion<L>,
    /// Misfit of every plane; empty if the lens cannot map them all.
    misfits: Vec<Misfit>,
}

impl<L: Lens> Straightened<L> {
    fn of(planes: &[ObservedPlane], undistortion: Undistortion<L>) -> Self {
        let plane_residuals = |plane: &ObservedPlane| -> Option<Vec<Residual>> {
            let sides = plane.sides().map(|side| residuals(side, &undistortion));
            Some(sides.collect::<Option<Vec<_>>>()?.concat())
        };
        let misfits = match planes
            .iter()
            .map(plane_residuals)
            .collect::<Option<Residuals>>()
        {
            Some(residuals) => {
                let noise = Noise::of(planes, &residuals, robust_scale(&residuals, 0));
                (0..planes.len())
                    .map(|p| Misfit::of_plane(&noise, p))
                    .collect()
            }
            None => Vec::new(),
        };
        Self {
            undistortion,
            misfits,
        }
    }

    /// Mean square curvature, at least 1, of the planes for which it is at most `limit`.
    fn mean_below(&self, limit: f64) -> f64 {
        let (mut curved, mut freedom) = (0.0, 0.0);
        for misfit in self.misfits.iter().filter(|m| plane_curvature(m) <= limit) {
            curved += misfit.curved;
            freedom += misfit.curved_freedom;
        }
        f64::max(curved / f64::max(freedom, 1.0), 1.0)
    }

    /// Lower median over the planes of the mean square curvature, at least 1.
    fn lower_median(&self) -> f64 {
        let mut all: Vec<f64> = self.misfits.iter().map(plane_curvature).collect();
        all.sort_by(f64::total_cmp);
        let middle = all.len().saturating_sub(1) / 2;
        all.get(middle)
            .map_or(f64::INFINITY, |curved| curved.max(1.0))
    }
}

fn plane_curvature(misfit: &Misfit) -> f64 {
    misfit.curved / misfit.curved_freedom.max(1.0)
}

/// A side's distances from its line: in the picture if the lens is known, otherwise in the
/// undistorted one, which does not exist for wide lenses.
fn residuals<L: Lens>(side: &Side, undistortion: &Undistortion<L>) -> Option<Vec<Residual>> {
    if let Undistortion::Known(lens) = undistortion {
        return straightness_residuals(lens, side);
    }
    let pixels = side
        .samples
        .iter()
        .map(|s| undistortion.undistort(&s.pixel));
    let ideal: Vec<_> = pixels.collect::<Option<_>>()?;
    let line = Line::fit(ideal.iter().map(|pixel| (*pixel, 1.0)))?;
    let residual = |(pixel, sample): (&Vector2<f64>, &Sample)| Residual {
        distance: line.distance(pixel),
        normal: line.normal(),
        weight: sample.weight,
        is_counted: true,
    };
    Some(ideal.iter().zip(&side.samples).map(residual).collect())
}
