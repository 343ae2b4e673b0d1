//! Known relations between the directions of two planes.

use nalgebra::Vector3;

use crate::geometry::Pose;

/// Relation between the directions of two planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Relation {
    /// At right angles.
    Orthogonal,
    /// Parallel to each other.
    Parallel,
}

impl Relation {
    /// The relation in words.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Orthogonal => "right angles",
            Self::Parallel => "parallel",
        }
    }

    /// The axes of the first plane that are perpendicular to the normal of the second.
    pub(crate) fn axes(self) -> &'static [usize] {
        match self {
            Self::Orthogonal => &[2],
            Self::Parallel => &[0, 1],
        }
    }
}

/// Two planes of a view and their relation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Related {
    pub planes: [usize; 2],
    pub relation: Relation,
}

/// An equation between two planes: its residual, and its derivative with respect to the rotation of
/// the first plane relative to the second.
pub(crate) struct Equation {
    pub planes: [usize; 2],
    pub gap: f64,
    pub by_turn: Vector3<f64>,
}

impl Related {
    /// Number of equations.
    pub fn count(&self) -> usize {
        self.relation.axes().len()
    }

    /// Returns the equations. For an axis `u` of the first plane and the normal `n` of the second,
    /// `u . n` changes by `(u x n) . (w1 - w2)` when the planes rotate by `w1` and `w2`.
    pub fn equations(&self, [first, second]: [&Pose; 2]) -> impl Iterator<Item = Equation> {
        self.relation.axes().iter().map(move |axis| {
            let axis = first.rotation.column(*axis).into_owned();
            let normal = second.normal();
            Equation {
                planes: self.planes,
                gap: axis.dot(&normal),
                by_turn: axis.cross(&normal),
            }
        })
    }
}
