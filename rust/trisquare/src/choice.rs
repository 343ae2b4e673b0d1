//! What a choice among candidates returns.

use crate::observations::ObservedPlane;

/// What was chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// One for each plane, in the order of the planes' first figures.
    pub verdicts: Vec<Verdict>,
    /// Why the choice may be wrong, if so.
    pub doubt: Option<Doubt>,
}

/// What became of a candidate plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Index of its first figure.
    pub figure: usize,
    /// Whether it is a square to the camera that was found.
    pub kept: bool,
    /// Root mean square distance of its samples from the best square that the camera allows (px),
    /// of what was not kept.
    pub residual: Option<f64>,
}

/// Why a choice may be wrong.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Doubt {
    /// Another camera makes squares of others.
    #[error(
        "another choice of squares is nearly as good: {squares} of them and a focal length of \
         {focal:.0} px"
    )]
    Rival {
        /// How many squares it has.
        squares: usize,
        /// Its focal length, px.
        focal: f64,
    },
    /// What agrees may do so by chance.
    #[error("so few agree that it may be chance")]
    Chance,
    /// The camera is no ordinary one.
    #[error(
        "they ask for an unusual camera: aspect {aspect:.3}, principal point {offset:.0} px from \
         the image centre"
    )]
    OddCamera {
        /// `fy / fx`.
        aspect: f64,
        /// Distance of the principal point from the image centre, px.
        offset: f64,
    },
}

impl Choice {
    /// The choice that keeps all.
    pub(crate) fn of_all(planes: &[ObservedPlane]) -> Self {
        let kept = |plane: &ObservedPlane| Verdict {
            figure: plane.figures[0].index,
            kept: true,
            residual: None,
        };
        Self {
            verdicts: planes.iter().map(kept).collect(),
            doubt: None,
        }
    }
}
