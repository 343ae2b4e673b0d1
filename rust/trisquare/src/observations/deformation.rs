//! Data of the deformation of a flat target.

use nalgebra::{SVector, Vector2};

/// Number of terms of a deformation: heights, three of the second order, four of the third and five
/// of the fourth, then the stretch and the shear.
pub(crate) const TERMS: usize = 14;

/// Positions of the stretch and of the shear among the terms.
pub(crate) const STRETCH: usize = TERMS - 2;
pub(crate) const SHEAR: usize = TERMS - 1;

/// The value of every term, or the effect of each of them at a sample.
pub(crate) type Terms = SVector<f64, TERMS>;

/// How a target departs from its stated flat shape.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deformation {
    pub centre: Vector2<f64>,
    /// Half the extent, `R`.
    pub radius: f64,
    /// `a_ij`, `e` and `g`, already removed from the samples.
    pub terms: Terms,
    pub prior: DeformationPrior,
}

/// Prior of the terms of all deformations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DeformationPrior {
    pub kind: DeformationKind,
    /// `tau^2`.
    pub variance: f64,
}

/// How targets are deformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DeformationKind {
    /// They are bent, as stiff sheets are.
    Bent,
    /// They are rolled or twisted as a whole.
    Rolled,
    /// They are flat, but stretched.
    Stretched,
}
