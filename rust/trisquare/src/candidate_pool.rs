//! All planes among which a choice is made, without their distortion.

use nalgebra::Vector2;

use crate::explanation::Explanation;
use crate::linear::{Homographies, Undistortion};
use crate::local_noise::Noise;
use crate::misfit::Misfit;
use crate::observations::{ObservedPlane, Sample, Side};
use crate::refine::{Residual, Residuals, robust_scale};
use crate::squareness::Candidate;
use crate::task::Task;
use crate::{ImageSize, Line, Straightening};

/// The planes that have homographies, and what these show.
pub(crate) struct Pool {
    pub undistortion: Undistortion,
    /// Their indices, ascending.
    pub places: Vec<usize>,
    pub candidates: Vec<Candidate>,
    /// In the order of `places`.
    pub homographies: Vec<Homographies>,
}

impl Pool {
    pub fn of(planes: &[ObservedPlane], undistortion: Undistortion, size: ImageSize) -> Self {
        let mut pool = Self {
            undistortion,
            places: Vec::new(),
            candidates: Vec::new(),
            homographies: Vec::new(),
        };
        for (i, plane) in planes.iter().enumerate() {
            let one = std::slice::from_ref(plane);
            let candidate = Candidate::of(plane, &pool.undistortion, size);
            let homographies = Homographies::estimate(one, &pool.undistortion);
            if let (Ok(candidate), Ok(homographies)) = (candidate, homographies) {
                pool.places.push(i);
                pool.candidates.push(candidate);
                pool.homographies.push(homographies);
            }
        }
        pool
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

    /// The planes that an explanation takes for squares.
    pub fn squares(&self, explanation: &Explanation) -> Vec<usize> {
        explanation.squares().map(|i| self.places[i]).collect()
    }
}

/// From straightness alone: the sides of false squares are straight, too.
pub(crate) fn undistortion(planes: &[ObservedPlane], task: &Task<'_>) -> Undistortion {
    Undistortion::estimate(planes, task.size, task.options)
        .unwrap_or_else(|_| Undistortion::Straightened(Straightening::identity(task.size)))
}

/// Mean square curvature of undistorted sides in units of their noise, at least 1.
pub(crate) fn curvature(planes: &[ObservedPlane], undistortion: &Undistortion) -> f64 {
    let of_side = |side: &Side| -> Option<Vec<Residual>> {
        let pixels = side
            .samples
            .iter()
            .map(|s| undistortion.undistort(&s.pixel));
        let ideal: Vec<_> = pixels.collect::<Option<_>>()?;
        let line = Line::fit(ideal.iter().map(|pixel| (*pixel, 1.0)))?;
        let residual = |(pixel, sample): (&Vector2<f64>, &Sample)| Residual {
            distance: line.distance(pixel),
            weight: sample.weight,
            counts: true,
        };
        Some(ideal.iter().zip(&side.samples).map(residual).collect())
    };
    let own = |plane: &ObservedPlane| -> Option<Vec<Residual>> {
        let sides: Vec<_> = plane.sides().map(of_side).collect::<Option<_>>()?;
        Some(sides.concat())
    };
    let Some(residuals) = planes.iter().map(own).collect::<Option<Residuals>>() else {
        return 1.0;
    };
    let noise = Noise::of(planes, &residuals, robust_scale(&residuals));
    let (mut curved, mut freedom) = (0.0, 0.0);
    for (p, plane) in planes.iter().enumerate() {
        for s in 0..plane.sides().count() {
            let misfit = Misfit::of_side(&noise, p, s);
            curved += misfit.curved;
            freedom += misfit.curved_freedom;
        }
    }
    f64::max(curved / f64::max(freedom, 1.0), 1.0)
}
