//! Data of the out-of-plane shape of a board.

use nalgebra::{SVector, Vector2};

/// Number of terms of a relief: three of the second order, four of the third, five of the fourth.
pub(crate) const TERMS: usize = 12;

/// Heights of the terms, or the effect of each of them at a sample.
pub(crate) type Heights = SVector<f64, TERMS>;

/// The out-of-plane shape of a board.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoardRelief {
    pub centre: Vector2<f64>,
    /// Half the extent, `R`.
    pub radius: f64,
    /// `a_ij`, already removed from the samples.
    pub heights: Heights,
    /// `tau^2`.
    pub variance: f64,
    /// `n`: steepness with which the variance of a height decreases with its order.
    pub steepness: i32,
}
