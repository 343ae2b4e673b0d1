//! All planes to choose among, undistorted.

use super::hypothesis::Hypothesis;
use super::squareness::CandidatePlane;
use super::straightness::Straightness;
use crate::lens::Lens;
use crate::linear::{Homographies, Undistortion};
use crate::observations::ObservedPlane;
use crate::solver::JointProblem;

/// The planes that have homographies, and their properties.
pub(crate) struct Pool<L> {
    /// Mean square curvature of the sides under the lens that makes them straightest, in units of
    /// their noise; at least 1.
    pub curvature: f64,
    pub undistortion: Undistortion<L>,
    /// Indices of the planes, ascending.
    pub places: Vec<usize>,
    pub candidates: Vec<CandidatePlane>,
    /// In the order of `places`.
    pub homographies: Vec<Homographies>,
}

impl<L: Lens> Pool<L> {
    pub fn of(planes: &[ObservedPlane], problem: &JointProblem<'_, L>) -> Self {
        Self::under_lens(Straightness::of(planes, problem), planes, problem)
    }

    /// The pool under the lens of `straightness`.
    pub fn under_lens(
        straightness: Straightness<L>,
        planes: &[ObservedPlane],
        problem: &JointProblem<'_, L>,
    ) -> Self {
        let Straightness {
            undistortion,
            curvature,
        } = straightness;
        let mut pool = Self {
            curvature,
            undistortion,
            places: Vec::new(),
            candidates: Vec::new(),
            homographies: Vec::new(),
        };
        for (i, plane) in planes.iter().enumerate() {
            let single = std::slice::from_ref(plane);
            let candidate = CandidatePlane::of(plane, &pool.undistortion, problem.size);
            let homographies = Homographies::estimate(single, &pool.undistortion);
            if let (Ok(candidate), Ok(homographies)) = (candidate, homographies) {
                pool.places.push(i);
                pool.candidates.push(candidate);
                pool.homographies.push(homographies);
            }
        }
        pool
    }

    /// The pool without one plane.
    pub fn without(&self, plane: usize) -> Self {
        let is_other = |i: &usize| self.places[*i] != plane;
        let rest: Vec<usize> = (0..self.places.len()).filter(is_other).collect();
        Self {
            curvature: self.curvature,
            undistortion: self.undistortion.clone(),
            places: rest.iter().map(|i| self.places[*i]).collect(),
            candidates: rest.iter().map(|i| self.candidates[*i].clone()).collect(),
            homographies: rest.iter().map(|i| self.homographies[*i].clone()).collect(),
        }
    }

    pub fn homographies_of(&self, planes: &[usize]) -> Homographies {
        let place = |plane: &usize| self.places.binary_search(plane).ok();
        Homographies::joined(
            planes
                .iter()
                .filter_map(place)
                .map(|i| &self.homographies[i]),
        )
    }

    /// The planes that are squares by a hypothesis.
    pub fn squares(&self, hypothesis: &Hypothesis) -> Vec<usize> {
        hypothesis.squares().map(|i| self.places[i]).collect()
    }
}
