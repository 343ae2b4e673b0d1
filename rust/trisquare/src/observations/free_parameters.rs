//! The free parameters of a lens.

use std::ops::Range;

use nalgebra::DVector;

use super::options::{Fixed, Options};
use crate::image_size::ImageSize;
use crate::lens::{Columns, DistortionModel, INTRINSICS, Lens, MAX_LENS_COLUMNS};
use crate::numeric::ArrowSystem;

/// The free parameters of a lens: which Jacobian columns they own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FreeParameters {
    columns: Vec<usize>,
    /// The lens's own names of its parameters.
    names: &'static [&'static str],
    /// Columns that free the centre of distortion from the principal point.
    centre: Range<usize>,
    /// `fy / fx` where `fy` follows `fx`.
    aspect: Option<f64>,
    /// Column and standard deviation of what is known beforehand to be near zero.
    priors: Vec<(usize, f64)>,
}

/// The coefficients beyond the default model are held to so many times what lenses are like: an
/// unusual lens is not bent to the usual, and coefficients a hundred times any lens's are none.
pub(crate) const PRIOR_SLACK: f64 = 3.0;

impl FreeParameters {
    pub fn new<L: Lens>(model: L::Model, fixed: &Fixed, aspect: f64) -> Self {
        let mut columns = Vec::with_capacity(MAX_LENS_COLUMNS);
        if !fixed.focal {
            columns.push(0);
            if !fixed.aspect {
                columns.push(1);
            }
        }
        if !fixed.principal_point {
            columns.extend([2, 3]);
        }
        if !fixed.distortion {
            columns.extend(model.columns().iter());
        }
        if !fixed.skew {
            columns.extend(L::skew_column());
        }
        Self {
            columns,
            names: L::parameter_names(),
            centre: L::centre_columns(),
            aspect: (fixed.aspect && !fixed.focal).then_some(aspect),
            priors: Vec::new(),
        }
    }

    /// The same with the coefficients beyond the default model held to what lenses are like that
    /// have about the focal length of a given one, those that a poorer model has as they are held
    /// there; those of its radial part, which alone turns back, tighter by a factor.
    pub fn held_like<L: Lens>(
        mut self,
        model: L::Model,
        (lens, size): (&L, ImageSize),
        poorer: &Self,
        tighter: f64,
    ) -> Self {
        let usual = lens.coefficient_priors(size);
        let further = model.further_columns();
        let free = further
            .iter()
            .filter(|column| self.columns.contains(column));
        let is_radial = |column: usize| self.names[column].starts_with('k');
        let prior = |column: usize| {
            let known = poorer.priors.iter().find(|(other, _)| *other == column);
            let std = known.map_or(PRIOR_SLACK * usual[column - INTRINSICS], |(_, std)| *std);
            let factor = if is_radial(column) { tighter } else { 1.0 };
            (column, std / factor)
        };
        self.priors = free.map(prior).collect();
        self
    }

    /// Column and standard deviation of what is held near zero.
    pub fn priors(&self) -> &[(usize, f64)] {
        &self.priors
    }

    /// Adds what is known of the coefficients beforehand; returns its cost.
    pub fn add_prior<L: Lens>(&self, lens: &L, system: &mut ArrowSystem) -> f64 {
        if self.priors.is_empty() {
            return 0.0;
        }
        let values = lens.parameters();
        let mut cost = 0.0;
        for (column, std) in &self.priors {
            let deviation = values[*column] / std;
            cost += 0.5 * deviation * deviation;
            for i in (0..self.columns.len()).filter(|i| self.columns[*i] == *column) {
                system.prior[(i, i)] += 1.0 / (std * std);
                system.prior_gradient[i] += deviation / std;
            }
        }
        cost
    }

    /// All parameters of a lens.
    pub fn all<L: Lens>() -> Self {
        let names = L::parameter_names();
        Self {
            columns: (0..names.len()).collect(),
            names,
            centre: L::centre_columns(),
            aspect: None,
            priors: Vec::new(),
        }
    }

    /// The first of them, without priors.
    #[cfg(test)]
    pub fn leading(&self, count: usize) -> Self {
        Self {
            columns: self.columns[..count].to_vec(),
            priors: Vec::new(),
            ..self.clone()
        }
    }

    /// What of the camera matrix is held, where something of it usually is free, and beside it the
    /// distortion if no coefficient is free.
    pub fn held(&self) -> Vec<&'static str> {
        let is_free = |column: usize| self.columns.contains(&column);
        let mut held = Vec::new();
        if !is_free(2) {
            held.push("principal point");
        }
        match (is_free(0), is_free(1)) {
            (false, _) => held.push("focal length"),
            (true, false) => held.push("aspect"),
            (true, true) => {}
        }
        if !held.is_empty() && self.columns.iter().all(|column| *column < INTRINSICS) {
            held.push("distortion");
        }
        held
    }

    /// The same with the centre of distortion freed from the principal point.
    pub fn with_free_centre(&self) -> Self {
        let mut freed = self.clone();
        freed.columns.extend(self.centre.clone());
        freed
    }

    /// Whether `fy` follows `fx`.
    pub fn aspect_is_fixed(&self) -> bool {
        self.aspect.is_some()
    }

    /// The columns of a lens Jacobian that [`Self::gather`] reads.
    pub fn columns(&self) -> Columns {
        let followed = self.aspect.map(|_| 1);
        Columns::of(self.columns.iter().copied().chain(followed))
    }

    pub fn len(&self) -> usize {
        self.columns.len()
    }

    pub fn names(&self) -> Vec<&'static str> {
        self.columns.iter().map(|c| self.names[*c]).collect()
    }

    /// Position of a named parameter among the free ones.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.columns
            .iter()
            .position(|c| self.names.get(*c) == Some(&name))
    }

    /// Picks the free columns out of a lens Jacobian.
    pub fn gather(&self, wrt_lens: &[f64; MAX_LENS_COLUMNS], free: &mut [f64]) {
        for (value, column) in free.iter_mut().zip(&self.columns) {
            *value = wrt_lens[*column];
        }
        if let Some(aspect) = self.aspect {
            free[0] += aspect * wrt_lens[1];
        }
    }

    /// How far two lenses are apart in the free parameters.
    pub fn difference<L: Lens>(&self, a: &L, b: &L) -> DVector<f64> {
        let (a, b) = (a.parameters(), b.parameters());
        DVector::from_fn(self.len(), |i, _| a[self.columns[i]] - b[self.columns[i]])
    }

    /// The lens after a step of the free parameters.
    pub fn advance<L: Lens>(&self, lens: &L, step: &DVector<f64>) -> L {
        let mut parameters = lens.parameters();
        for (column, change) in self.columns.iter().zip(step.iter()) {
            if *column < self.names.len() {
                parameters[*column] += change;
            }
        }
        if let Some(aspect) = self.aspect {
            parameters[1] = aspect * parameters[0];
        }
        lens.with_parameters(&parameters)
    }
}

impl<L: Lens> Options<L> {
    pub(crate) fn free_parameters(&self) -> FreeParameters {
        FreeParameters::new::<L>(self.model, &self.fixed, self.aspect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::{Brown, BrownModel};

    #[test]
    fn what_does_not_turn_a_distortion_back_is_not_held_tighter_for_it() {
        let lens = Brown::new([900.0, 900.0, 640.0, 480.0, -0.3, 0.0, 0.0, 0.0, 0.0]);
        let size = ImageSize {
            width: 1280,
            height: 960,
        };
        let free = FreeParameters::all::<Brown>();
        let held = |tighter| {
            let held = free
                .clone()
                .held_like(BrownModel::Brown, (&lens, size), &free, tighter);
            held.priors().to_vec()
        };
        let factors = held(1.0).into_iter().zip(held(9.0));
        let factors: Vec<_> = factors
            .map(|((column, usual), (_, tight))| (free.names[column], usual / tight))
            .collect();
        assert_eq!(factors, [("k3", 9.0), ("p1", 1.0), ("p2", 1.0)]);
    }
}
