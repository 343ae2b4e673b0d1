//! Errors shared by the samples of a side, and the certainty lost by them.
//!
//! Paper curves, ink bleeds, and no lens is exactly its polynomial: the samples of a side then
//! share an error that averaging does not remove. Every side is given a smooth displacement
//! `sum_k a_k P_k(s)` of its image ([`crate::noise::side_basis`]), `a_k` normal with variance
//! `tau^2 / (1 + (k/2)^2)^1.5`: the spectrum of an error correlated over about a third of the side,
//! as in the residuals of real boards. `tau` is estimated from the residuals by restricted maximum
//! likelihood (H. D. Patterson & R. Thompson, Biometrika 58 (1971) 545-554), which takes into
//! account what the fitted parameters have absorbed. Marginalised over the `a_k`, the normal
//! equations keep their arrowhead structure.

use nalgebra::DMatrix;

use super::local::Noise;
use super::picture_fields::PictureFields;
use super::side_basis::ORDERS;
use super::side_families::{Family, SharedColumns, families_of, spectrum};
use crate::lens::Lens;
use crate::numeric::{ArrowSystem, Block, BlockEquations};
use crate::observations::{
    Deformation, DeformationPrior, FreeParameters, ObservedPlane, TERMS, View,
};

/// The first variance tried, as a fraction of the variance of a side's mean by noise alone.
const FIRST_VARIANCE: f64 = 0.2;

/// Fraction of the first variance used for a variance of zero if sides have to be marginalised
/// nevertheless.
const NO_VARIANCE: f64 = 1e-6;

/// The normal equations, with the information of every side on its displacement.
pub(crate) struct SideErrors {
    /// The equations under white noise.
    pub(super) system: ArrowSystem,
    /// In the order of the planes.
    families: Vec<Family>,
    /// The first variance tried, px^2.
    pub(super) first_variance: f64,
    /// Deformations of the targets, by plane.
    deformations: Vec<Option<Deformation>>,
}

impl SideErrors {
    /// Gathers the moments of a view's residuals; `white` is the variance of their noise in units
    /// of the scale at which they are summed. Fields of the picture, if any, are shared parameters
    /// after the free ones.
    pub fn gather<L: Lens>(
        planes: &[ObservedPlane],
        (free, fields): (&FreeParameters, Option<PictureFields>),
        view: &View<L>,
        noise: &Noise,
        white: f64,
    ) -> Option<Self> {
        let camera = &SharedColumns {
            lens: &view.lens,
            free,
            fields,
        };
        let plane_parameters = |p: usize| {
            view.planes[p].parameter_count() + planes[p].deformation.map_or(0, |_| TERMS)
        };
        let mut system = ArrowSystem::zeros(camera.len(), (0..planes.len()).map(plane_parameters));
        camera.free.add_prior(&view.lens, &mut system);
        let mut families = Vec::new();
        for (p, plane) in planes.iter().enumerate() {
            let (state, block) = (&view.planes[p], &mut system.blocks[p]);
            let mut moments = noise.sides[p].iter();
            for (f, figure) in plane.figures.iter().enumerate() {
                let mut figure_families =
                    families_of(figure, p, block.hessian.nrows(), camera.len())?;
                for (index, side) in figure.sides.iter().enumerate() {
                    let moments = moments.next()?;
                    let family = figure_families
                        .iter_mut()
                        .find(|family| family.sides.contains(&index));
                    if let Some(family) = family {
                        let place = (state, f, index, side);
                        family.add(
                            place,
                            plane.deformation.as_ref(),
                            moments,
                            camera,
                            white,
                            block,
                        )?;
                    }
                }
                families.extend(figure_families);
            }
            if plane.is_outlier() {
                block.hessian.fill_diagonal(1.0);
            }
            state.hold_turn(&mut block.hessian);
        }
        view.tie(&mut system);
        Some(Self {
            system,
            first_variance: first_variance(&families),
            families,
            deformations: planes.iter().map(|plane| plane.deformation).collect(),
        })
    }

    /// Sets the prior standard deviations of the picture's fields, which had no prior.
    pub fn set_field_priors(&mut self, deviations: &[f64]) {
        let prior = &mut self.system.prior;
        let first = prior.nrows() - deviations.len();
        for (i, deviation) in deviations.iter().enumerate() {
            prior[(first + i, first + i)] = 1.0 / (deviation * deviation);
        }
    }

    /// Sets the variance (px^2), possibly zero, of the positions of squares' sides; returns whether
    /// there are any.
    pub fn set_line_variance(&mut self, variance: f64) -> bool {
        let is_of_square = |family: &&mut Family| family.sides.len() == 1;
        let sides = self.families.iter_mut().filter(is_of_square);
        sides.map(|side| side.line_variance = variance).count() > 0
    }

    /// Number of planes.
    pub fn plane_count(&self) -> usize {
        self.system.blocks.len()
    }

    /// Sets the prior of every target's deformation.
    pub fn set_deformation_prior(&mut self, prior: DeformationPrior) {
        for deformation in self.deformations.iter_mut().flatten() {
            deformation.prior = prior;
        }
    }

    /// Whether any plane may be deformed.
    pub fn has_deformation(&self) -> bool {
        self.deformations.iter().any(Option::is_some)
    }

    /// Contribution of displacements of unit variance on each plane to the covariance of the shared
    /// parameters as fitted, that is with weights for white noise.
    pub fn unit_covariances(&self) -> Option<Vec<DMatrix<f64>>> {
        let information = self.system.reduced_information()?.cholesky()?;
        let shared = self.system.prior.nrows();
        let mut found = vec![DMatrix::zeros(shared, shared); self.system.blocks.len()];
        let crosses = self.system.tied_crosses()?;
        for family in &self.families {
            let block = &self.system.blocks[family.plane];
            let plane_solution = block
                .hessian
                .clone()
                .cholesky()?
                .solve(&crosses[family.plane]);
            let cross = family.shared_cross() - plane_solution.tr_mul(&family.plane_cross());
            let influence = information.solve(&cross);
            found[family.plane] += &influence * family.covariance() * influence.transpose();
        }
        Some(found)
    }

    /// The normal equations marginalised over displacements with the given variance of each plane.
    pub fn marginal(&self, variances: &[f64]) -> Option<ArrowSystem> {
        let block = |(plane, variance): (usize, &f64)| {
            let (mut found, _) = self.marginalise(plane, *variance)?;
            self.add_deformation_prior(plane, self.deformation_prior(plane), &mut found);
            Some(self.system.blocks[plane].with_equations(&found))
        };
        let blocks: Option<Vec<Block>> = variances.iter().enumerate().map(block).collect();
        Some(ArrowSystem {
            prior: self.system.prior.clone(),
            prior_gradient: self.system.prior_gradient.clone(),
            blocks: blocks?,
            eliminated: None,
        })
    }

    /// The equations of one plane marginalised over the displacements of its sides, and their
    /// contribution to minus twice the log likelihood. They do not include the prior of the
    /// deformation yet.
    fn marginalise(&self, plane: usize, variance: f64) -> Option<(BlockEquations, f64)> {
        let mut equations = self.system.blocks[plane].equations();
        let mut criterion = 0.0;
        let first = self.families.partition_point(|family| family.plane < plane);
        let families = self.families[first..].iter();
        for family in families.take_while(|family| family.plane == plane) {
            let variance = match variance {
                0.0 if family.line_variance > 0.0 => NO_VARIANCE * self.first_variance,
                variance => variance,
            };
            if variance > 0.0 {
                criterion += family.marginalise(variance, &mut equations)?;
            }
        }
        Some((equations, criterion))
    }

    /// The marginalised equations with the plane's pose eliminated if it may be deformed: the
    /// pose does not depend on the deformation's prior.
    pub(super) fn before_deformation(
        &self,
        plane: usize,
        variance: f64,
    ) -> Option<(BlockEquations, f64)> {
        let (equations, sides_criterion) = self.marginalise(plane, variance)?;
        if self.deformations[plane].is_none() {
            return Some((equations, sides_criterion));
        }
        let pose = self.system.blocks[plane].hessian.nrows() - TERMS;
        let (equations, pose_criterion) = equations.without_first(pose)?;
        Some((equations, sides_criterion + pose_criterion))
    }

    /// Adds the prior of a plane's deformation to its equations; returns its contribution to minus
    /// twice the log likelihood.
    pub(super) fn add_deformation_prior(
        &self,
        plane: usize,
        prior: DeformationPrior,
        equations: &mut BlockEquations,
    ) -> f64 {
        let deformation = self.deformations[plane].as_ref();
        deformation.map_or(0.0, |deformation| deformation.add_prior(prior, equations))
    }

    /// Prior of a plane's deformation.
    pub(super) fn deformation_prior(&self, plane: usize) -> DeformationPrior {
        self.deformations[plane].map_or(DeformationPrior::EXACT, |deformation| deformation.prior)
    }
}

/// `FIRST_VARIANCE` times the variance of a side's mean by noise alone.
fn first_variance(families: &[Family]) -> f64 {
    let (mut information, mut sides) = (0.0, 0.0);
    for family in families {
        for side in 0..family.sides.len() {
            information += family.gram[(side * ORDERS, side * ORDERS)];
            sides += 1.0;
        }
    }
    FIRST_VARIANCE * sides / information
}

/// `tau^2` of sides with this root mean square displacement (px).
pub(crate) fn displacement_variance(displacement: f64) -> f64 {
    displacement * displacement / (0..ORDERS).map(spectrum).sum::<f64>()
}

/// Root mean square displacement of a side, px.
pub(crate) fn rms_displacement(variance: f64) -> f64 {
    (variance * (0..ORDERS).map(spectrum).sum::<f64>()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::side_basis::{basis, direction, places};
    use super::*;
    use crate::geometry::Pose;
    use crate::lens::DefaultLens;
    use crate::numeric::Loss;
    use crate::observations::{Options, Placement, PlaneState, sort_by_plane};
    use crate::refine::residuals;
    use crate::synthetic::{Scene, SceneOptions};
    use nalgebra::DVector;

    const NOISE: f64 = 0.2;

    fn scene() -> (Vec<ObservedPlane>, View<DefaultLens>) {
        let truth = Scene::random(4, SceneOptions::default());
        let planes = sort_by_plane(&truth.edges(1, NOISE, 25.0)).unwrap();
        let state = |pose: &Pose| PlaneState {
            pose: *pose,
            figures: vec![Placement::IDENTITY],
        };
        let view = View {
            lens: truth.camera,
            planes: truth.poses.iter().map(state).collect(),
            relations: Vec::new(),
        };
        (planes, view)
    }

    /// The Jacobian of all samples, their residuals, weights, and the basis of their sides'
    /// displacements.
    fn dense(
        planes: &[ObservedPlane],
        view: &View<DefaultLens>,
        free: &FreeParameters,
    ) -> (DMatrix<f64>, DVector<f64>, DVector<f64>, DMatrix<f64>) {
        let all = residuals(planes, view).unwrap();
        let count: usize = all.iter().map(Vec::len).sum();
        let sides: usize = planes.iter().map(|p| p.sides().count()).sum();
        let mut jacobian = DMatrix::zeros(count, free.len() + 6 * planes.len());
        let mut displacement = DMatrix::zeros(count, ORDERS * sides);
        let (mut residual, mut weight) = (DVector::zeros(count), DVector::zeros(count));
        let (mut row, mut index) = (0, 0);
        for (p, plane) in planes.iter().enumerate() {
            let mut own = all[p].iter();
            for side in plane.sides() {
                let state = &view.planes[p];
                let model = side.line().unwrap().into();
                let line = state.line(0, &side.line().unwrap());
                for (s, sample) in places(&side.samples, &direction(&side.samples).unwrap())
                    .iter()
                    .zip(&side.samples)
                {
                    let pixel_ray = view.lens.unproject_with_jacobian(&sample.pixel).unwrap();
                    let distance =
                        view.lens
                            .line_distance_jacobian(&pixel_ray, &line, free.columns());
                    let mut shared = vec![0.0; free.len()];
                    free.gather(&distance.wrt_lens, &mut shared);
                    for (i, value) in shared.into_iter().enumerate() {
                        jacobian[(row, i)] = value;
                    }
                    let pose = distance.wrt_line.transpose() * state.line_jacobian(0, &model);
                    for i in 0..6 {
                        jacobian[(row, free.len() + 6 * p + i)] = pose[i];
                    }
                    for (k, value) in basis(*s).iter().enumerate() {
                        displacement[(row, ORDERS * index + k)] = *value;
                    }
                    residual[row] = own.next().unwrap().distance;
                    let x = residual[row] / NOISE;
                    weight[row] = Loss::Tukey.cost_and_weight(x).1 / (NOISE * NOISE);
                    row += 1;
                }
                index += 1;
            }
        }
        (jacobian, residual, weight, displacement)
    }

    #[test]
    fn marginal_equations_are_those_of_the_dense_covariance() {
        let (planes, view) = scene();
        let free = Options::default().free_parameters();
        let (jacobian, residual, weight, displacement) = dense(&planes, &view, &free);
        let all = residuals(&planes, &view).unwrap();
        let noise = Noise::of(&planes, &all, NOISE);
        let errors = SideErrors::gather(&planes, (&free, None), &view, &noise, 1.0).unwrap();
        let criterion = |variance: f64| {
            let spread = DMatrix::from_diagonal(&DVector::from_fn(displacement.ncols(), |i, _| {
                variance * spectrum(i % ORDERS)
            }));
            let noise = DMatrix::from_diagonal(&weight.map(|w| 1.0 / w))
                + &displacement * spread * displacement.transpose();
            let factor = noise.cholesky().unwrap();
            let inverse = factor.inverse();
            let information = jacobian.tr_mul(&(&inverse * &jacobian));
            let gradient = jacobian.tr_mul(&(&inverse * &residual));
            let covariance = information.clone().cholesky().unwrap();
            let log = |l: &DMatrix<f64>| 2.0 * l.diagonal().map(f64::ln).sum();
            let criterion = log(factor.l_dirty())
                + log(covariance.l_dirty())
                + residual.dot(&(inverse * &residual))
                - gradient.dot(&covariance.solve(&gradient));
            (criterion, covariance.inverse())
        };
        let white = criterion(0.0).0 - errors.criterion(&[0.0; 3]).unwrap();
        for variance in [1e-4, 0.04, 5.0] {
            let (expected, covariance) = criterion(variance);
            let found = errors.criterion(&[variance; 3]).unwrap();
            // The Jacobian is a polynomial of the fifth degree along each side here.
            assert!((found + white - expected).abs() < 1e-3 * expected.abs().max(1.0));
            let own =
                crate::uncertainty::covariance(&errors.marginal(&[variance; 3]).unwrap(), 1.0)
                    .unwrap();
            let expected = covariance.view((0, 0), own.shape());
            for i in 0..own.nrows() {
                assert!((own[(i, i)] / expected[(i, i)] - 1.0).abs() < 1e-3);
            }
        }
    }
}
