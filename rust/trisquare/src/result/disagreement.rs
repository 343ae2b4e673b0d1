//! A plane that disagrees with the others.

/// A plane that disagrees with the rest.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Disagreement {
    /// Index of the plane.
    pub plane: usize,
    /// By how much the focal length `fx` changes without it, as a part of it.
    pub focal_change: f64,
    /// The size of the disagreement, as a normal deviate.
    pub sigmas: f64,
}
