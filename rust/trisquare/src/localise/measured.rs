//! A measured side.

use super::equations::Normal;
use super::side::SideModel;
use super::span::SpanEdges;
use super::tone_fit::ToneShare;

/// A measured span, its side, and its share in the estimate of an unknown tone curve.
pub(super) struct Measured {
    pub edges: SpanEdges,
    pub side: SideModel,
    /// Matrix of the side's normal equations.
    pub normal: Normal,
    pub share: Option<ToneShare>,
    /// Whether other lines cross it, at which light and dark are exchanged.
    pub is_crossed: bool,
}
