//! What a search for the best camera ends with.

use crate::noise::Noise;
use crate::refine::Refined;

/// An optimum, and what its residuals say of their noise where that was asked.
#[derive(Clone)]
pub(super) struct Optimum<L> {
    pub refined: Refined<L>,
    pub noise: Option<Noise>,
}

impl<L> From<Refined<L>> for Optimum<L> {
    fn from(refined: Refined<L>) -> Self {
        Self {
            refined,
            noise: None,
        }
    }
}
