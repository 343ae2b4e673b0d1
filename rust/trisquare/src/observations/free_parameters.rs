//! The free parameters of a lens.

use std::ops::Range;

use nalgebra::DVector;

use super::options::{Fixed, Options};
use crate::image_size::ImageSize;
use crate::lens::{
    Columns, DISTORTION, DistortionModel, INTRINSICS, Lens, MATRIX, MAX_LENS_COLUMNS, SKEW,
};
use crate::numeric::ArrowSystem;

/// The free parameters of a lens, as columns of its Jacobian.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FreeParameters {
    columns: Vec<usize>,
    /// The lens's names of all its parameters.
    names: &'static [&'static str],
    /// Columns that free the centre of distortion from the principal point.
    centre: Range<usize>,
    /// `fy / fx` where `fy` follows `fx`.
    aspect: Option<f64>,
    /// Column and standard deviation of the coefficients with a prior about zero.
    priors: Vec<(usize, f64)>,
    /// The picture of which the lens has to see all, and the standard deviation, in pixels, by
    /// which it may fall short of that.
    reach: Option<(ImageSize, f64)>,
}

/// Distance beyond a corner of the picture up to which a lens has to see, as a fraction of the
/// corner's distance: just inside its rim a lens sees hardly anything.
const BEYOND_CORNER: f64 = 0.02;

/// Prior standard deviation of the coefficients beyond the default model, in units of their usual
/// spread over lenses: wide enough for an unusual lens, while coefficients a hundred times as large
/// as any lens's are excluded.
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
            reach: None,
        }
    }

    /// Returns the same parameters with priors on the coefficients beyond the default model: the
    /// usual spread over lenses of about the given one's focal length. Coefficients with a prior
    /// under a poorer model keep that prior.
    pub fn with_priors<L: Lens>(
        mut self,
        model: L::Model,
        (lens, size): (&L, ImageSize),
        poorer: &Self,
    ) -> Self {
        let spreads = lens.coefficient_priors(size);
        let further = model.further_columns();
        let free = further
            .iter()
            .filter(|column| self.columns.contains(column));
        let prior = |column: usize| {
            let known = poorer.priors.iter().find(|(other, _)| *other == column);
            let spreads = PRIOR_SLACK * spreads[column - INTRINSICS];
            (column, known.map_or(spreads, |(_, std)| *std))
        };
        self.priors = free.map(prior).collect();
        self
    }

    /// Returns the same parameters for a lens that has to see all of a picture, to within
    /// `shortfall` pixels (a standard deviation).
    pub fn with_reach(self, size: ImageSize, shortfall: f64) -> Self {
        Self {
            reach: Some((size, shortfall)),
            ..self
        }
    }

    /// Whether the lens has to see all of a picture.
    pub fn has_reach(&self) -> bool {
        self.reach.is_some()
    }

    /// Whether a lens sees all of the picture that it has to see.
    pub fn is_reach_met<L: Lens>(&self, lens: &L) -> bool {
        self.reach.is_none_or(|(size, _)| lens.sees_all_of(size))
    }

    /// Returns the positions of the camera matrix's parameters among the free ones.
    pub fn camera_matrix_positions(&self) -> Vec<usize> {
        let names = self.names().into_iter().enumerate();
        let places = names.filter_map(|(place, name)| MATRIX.contains(&name).then_some(place));
        places.collect()
    }

    /// Returns the same parameters without the picture that the lens has to see, which guides the
    /// search and is no measurement.
    pub fn without_reach(&self) -> Self {
        Self {
            reach: None,
            ..self.clone()
        }
    }

    /// Adds a penalty that moves the rim of the lens beyond the corners that it has to see; returns
    /// its cost.
    ///
    /// The distortion folds back at the rim: to first order a parameter moves the rim as it moves
    /// the pixel there.
    pub fn add_reach<L: Lens>(&self, lens: &L, system: &mut ArrowSystem) -> f64 {
        let Some((size, shortfall)) = self.reach else {
            return 0.0;
        };
        let centre = lens.principal_point();
        let mut cost = 0.0;
        for corner in size.corners() {
            let target = corner + (corner - centre) * BEYOND_CORNER;
            let rim = lens.rim_towards(&target);
            let seen = rim.and_then(|rim| Some((rim, lens.unproject_with_jacobian(&rim)?)));
            let Some((rim, ray)) = seen else {
                continue;
            };
            let outwards = (target - rim).normalize();
            let residual = (target - rim).norm() / shortfall;
            let residual_derivative =
                lens.projection_jacobian(&ray).transpose() * outwards / -shortfall;
            let mut gradient = DVector::zeros(self.len());
            self.gather(&residual_derivative.into(), gradient.as_mut_slice());
            system.prior += &gradient * gradient.transpose();
            system.prior_gradient += gradient * residual;
            cost += 0.5 * residual * residual;
        }
        cost
    }

    /// Column and standard deviation of the coefficients with a prior about zero.
    pub fn priors(&self) -> &[(usize, f64)] {
        &self.priors
    }

    /// Adds the prior of the coefficients; returns its cost.
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
            reach: None,
        }
    }

    /// Returns the first `count` of them, without priors.
    #[cfg(test)]
    pub fn leading(&self, count: usize) -> Self {
        Self {
            columns: self.columns[..count].to_vec(),
            priors: Vec::new(),
            ..self.clone()
        }
    }

    /// Returns the names of the parts of the camera matrix that are held, the skew apart, and, if
    /// there are any, that of the distortion if no coefficient is free.
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
        let is_camera_matrix =
            |column: &usize| *column < INTRINSICS || self.names.get(*column) == Some(&SKEW);
        if !held.is_empty() && self.columns.iter().all(is_camera_matrix) {
            held.push(DISTORTION);
        }
        held
    }

    /// Returns the same parameters with the centre of distortion freed from the principal point.
    pub fn with_free_centre(&self) -> Self {
        let mut freed = self.clone();
        freed.columns.extend(self.centre.clone());
        freed
    }

    /// Returns the same parameters with the skew freed, if the lens has that parameter.
    pub fn with_free_skew(&self) -> Self {
        let mut freed = self.clone();
        let column = self.names.iter().position(|name| *name == SKEW);
        freed
            .columns
            .extend(column.filter(|column| !self.columns.contains(column)));
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

    /// Copies the free columns out of a lens Jacobian.
    pub fn gather(&self, wrt_lens: &[f64; MAX_LENS_COLUMNS], free: &mut [f64]) {
        for (value, column) in free.iter_mut().zip(&self.columns) {
            *value = wrt_lens[*column];
        }
        if let Some(aspect) = self.aspect {
            free[0] += aspect * wrt_lens[1];
        }
    }

    /// Returns the difference of two lenses in the free parameters.
    pub fn difference<L: Lens>(&self, a: &L, b: &L) -> DVector<f64> {
        let (a, b) = (a.parameters(), b.parameters());
        DVector::from_fn(self.len(), |i, _| a[self.columns[i]] - b[self.columns[i]])
    }

    /// Returns the lens after a step of the free parameters.
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
    use crate::lens::Brown;

    #[test]
    fn a_held_distortion_is_named_where_the_skew_is_free() {
        let fixed = Fixed {
            principal_point: true,
            distortion: true,
            skew: false,
            ..Fixed::default()
        };
        let options = Options {
            fixed,
            ..Options::<Brown>::new()
        };
        let held = options.free_parameters().held();
        assert_eq!(held, ["principal point", DISTORTION]);
    }

    /// Cost and gradient of a lens that folds back inside the picture.
    fn reach(free: &FreeParameters, lens: &Brown) -> (f64, DVector<f64>) {
        let mut system = ArrowSystem::zeros(free.len(), std::iter::empty());
        let cost = free.add_reach(lens, &mut system);
        (cost, system.prior_gradient)
    }

    #[test]
    fn every_parameter_draws_the_rim_to_the_corners_as_it_moves_it() {
        let lens = Brown::new([700.0, 710.0, 640.0, 480.0, -0.3, 0.02, 0.0, 0.0, 0.0]);
        let size = ImageSize {
            width: 1280,
            height: 960,
        };
        assert!(!lens.sees_all_of(size));
        let free = FreeParameters::all::<Brown>().with_reach(size, 10.0);
        let (_, gradient) = reach(&free, &lens);
        for (i, name) in free.names().into_iter().enumerate() {
            let step = if name.starts_with(['k', 'p']) {
                1e-5
            } else {
                1e-2
            };
            let change = DVector::from_fn(free.len(), |j, _| if i == j { step } else { 0.0 });
            let [above, below] = [change.clone(), -change]
                .map(|change| reach(&free, &free.advance(&lens, &change)).0);
            let slope = (above - below) / (2.0 * step);
            let far = (slope - gradient[i]).abs();
            assert!(
                far <= 0.05 * gradient[i].abs() + 0.1,
                "{name}: {slope}, {}",
                gradient[i]
            );
        }
    }
}
