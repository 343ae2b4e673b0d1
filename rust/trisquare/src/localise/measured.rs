//! A measured side.

use super::equations::Normal;
use super::side::SideModel;
use super::span::SpanEdges;
use super::tone_fit::ToneShare;

/// A measured span, its side, and what it tells of an unknown tone curve.
pub(super) struct Measured {
    pub edges: SpanEdges,
    pub side: SideModel,
    /// Of the side's normal equations.
    pub normal: Normal,
    pub share: Option<ToneShare>,
    /// Whether other lines cross it, exchanging light and dark.
    pub is_crossed: bool,
}
