//! The out-of-plane shape of a board: data alone.

use nalgebra::{SVector, Vector2};

/// Terms of a relief: three of the second order, four of the third, five of the fourth.
pub(crate) const TERMS: usize = 12;

/// Heights, or what each does at a sample.
pub(crate) type Heights = SVector<f64, TERMS>;

/// The out-of-plane shape of a board.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoardRelief {
    pub centre: Vector2<f64>,
    /// Half the extent, `R`.
    pub radius: f64,
    /// `a_ij`, already taken out of the samples.
    pub heights: Heights,
    /// `tau^2`.
    pub variance: f64,
    /// `n`: how steeply the variance of a height falls with its order.
    pub steepness: i32,
}
