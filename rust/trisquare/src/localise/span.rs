//! What is measured, and what comes of it.

use nalgebra::Vector2;

/// A stretch of edge between two crossings, coarsely known.
#[derive(Debug, Clone)]
pub struct EdgeSpan {
    /// A polyline along the edge, pixels, of at least two points: the edge runs within about 4
    /// pixels of it, and may end a few pixels sooner or later.
    pub path: Vec<Vector2<f64>>,
    /// +1 if the picture gets lighter towards the right-hand normal `(-e.y, e.x)` of the path's
    /// direction `e`, which points inside where the path runs clockwise on the screen; else -1.
    pub polarity: f64,
    /// The spans, as indices into the same slice, that this one meets at its start and its end;
    /// samples keep clear of their blur.
    pub bounds: [Option<usize>; 2],
    /// A grid line of a chessboard has its crossings here, one for each point of its path and in
    /// that order: the span that crosses it, if that is one of the slice, and the crossing's number
    /// among all that there are on the board, seen or not. At each the polarity changes; that given
    /// is the one after the first. Between two whose numbers are no neighbours nothing is measured.
    pub crossings: Vec<(Option<usize>, usize)>,
    /// Where the light cell beside the stretch after each crossing carries a marker: how far from
    /// the cell's edges its dark border begins, over the cell's side; 0 where there is none. Empty
    /// if there are none at all.
    pub rims: Vec<f64>,
    /// Where the dark cell beside the stretch after each crossing is a tag: which of the cells within
    /// its border are light, in rows from the stretch on; empty where it is none, or not known. Empty
    /// if there are none at all.
    pub tags: Vec<Vec<Vec<bool>>>,
    /// Width of the tags' border over their side.
    pub tag_border: f64,
    /// How far from the path, pixels, the picture is the edge's own, on the negative side and on
    /// the other: beyond it something else begins. Infinite where nothing is known of it.
    pub margin: [f64; 2],
    /// Whether other things lie beside the edge, so that the light there changes along it.
    pub is_beside_others: bool,
    /// The far edge of the thin bar that this is an edge of: the span, as an index into the same
    /// slice, at which the light changes again.
    pub far_edge: Option<usize>,
}

impl EdgeSpan {
    /// An edge that meets no other, and of whose surroundings nothing is known.
    #[must_use]
    pub fn new(path: Vec<Vector2<f64>>, polarity: f64) -> Self {
        Self {
            path,
            polarity,
            bounds: [None; 2],
            crossings: Vec::new(),
            rims: Vec::new(),
            tags: Vec::new(),
            tag_border: 0.0,
            margin: [f64::INFINITY; 2],
            is_beside_others: false,
            far_edge: None,
        }
    }

    /// What of it no picture could make right; `count` spans are given together.
    pub(super) fn fault(&self, count: usize) -> Option<&'static str> {
        let crossings = self.crossings.iter().filter_map(|crossing| crossing.0);
        let beside = self.bounds.into_iter().flatten().chain(self.far_edge);
        let mut met = beside.chain(crossings);
        if self.polarity == 0.0 || self.polarity.is_nan() {
            Some("its polarity must be 1 or -1")
        } else if met.any(|other| other >= count) {
            Some(
                "its bounds, crossings and far edge must be indices of the spans that are given with it",
            )
        } else if !self.crossings.is_empty() && self.crossings.len() != self.path.len() {
            Some("its crossings must be one for each point of its path, or none")
        } else if !self.margin.iter().all(|margin| *margin >= 0.0) {
            Some("its margins must be numbers that are not negative")
        } else {
            None
        }
    }
}

/// The samples of one span, and what was found about the picture along it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SpanEdges {
    /// Points of the edge in order along the path, pixels.
    pub points: Vec<Vector2<f64>>,
    /// Standard deviation of each point along the edge's normal, pixels.
    pub std: Vec<f64>,
    /// Standard deviation `w` of the blur, the pixel's own box included, pixels.
    pub blur: f64,
    /// Coded grey beside the middle of the span, on its dark side, 1 being the largest value.
    pub dark: f64,
    /// The same on its light side.
    pub light: f64,
    /// Standard deviation of the pixels about the model where the edge is, coded.
    pub noise: f64,
    /// How far one standard deviation of the picture's tone curve displaces each point, all points
    /// of the picture together; empty if the curve is known.
    pub tone_drift: Vec<Vector2<f64>>,
}

/// Why a span gave no samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoEdge {
    /// An argument that no picture could make right: the span's, or the tone curve.
    #[error("an argument is invalid: {0}")]
    InvalidArgument(&'static str),
    /// Fewer than two points, or points that coincide or are not finite.
    #[error("its outline is no line to follow")]
    NoPath,
    /// Too little of the path has its surroundings inside the picture.
    #[error("it lies outside the picture")]
    OutsidePicture,
    /// No smooth curve of the expected polarity near the path.
    #[error("no smooth edge runs along its outline, dark on the side where it should be")]
    Inconsistent,
    /// Something else is so near that its blur would be taken for this edge's.
    #[error(
        "something else is too close to it, such as the other edge of a line thinner than 5 blurs or 4 pixels"
    )]
    Cramped,
    /// There is something, but its contrast is lost in the noise, or it is not a step.
    #[error("its edge is too faint, too blurred or too short to be measured")]
    Unmeasurable,
}
