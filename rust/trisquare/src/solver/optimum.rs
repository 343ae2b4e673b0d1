//! Result of the search for the best camera.

use crate::noise::Noise;
use crate::refine::Refined;

/// An optimum, and the noise of its residuals if it was measured.
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
