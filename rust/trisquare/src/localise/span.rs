//! The edges to measure, and the results.

use nalgebra::Vector2;

/// A stretch of edge between two crossings, coarsely known.
#[derive(Debug, Clone)]
pub struct EdgeSpan {
    /// A polyline along the edge, pixels, of at least two points: the edge is within about 4 pixels
    /// of it, and may end a few pixels sooner or later.
    pub path: Vec<Vector2<f64>>,
    /// +1 if the picture gets lighter towards the right-hand normal `(-e.y, e.x)` of the path's
    /// direction `e` (the normal points inside if the path runs clockwise on the screen); else -1.
    pub polarity: f64,
    /// The spans, as indices into the same slice, that this one meets at its start and its end;
    /// samples keep clear of their blur.
    pub bounds: [Option<usize>; 2],
    /// The crossings of a grid line of a chessboard, one for each point of its path, in its order:
    /// the span that crosses it, if it is in the slice, and the crossing's number among all those
    /// on the board, seen or not. The polarity changes at each crossing; the given one is that
    /// after the first. Nothing is measured between two crossings whose numbers are not
    /// consecutive.
    pub crossings: Vec<(Option<usize>, usize)>,
    /// For the light cell beside the stretch after each crossing, the distance of its marker's dark
    /// border from the cell's edges, over the cell's side; 0 if it has no marker. Empty if there
    /// are no markers at all.
    pub rims: Vec<f64>,
    /// For the dark cell beside the stretch after each crossing, if it is a tag, whether the cells
    /// within its border are light, in rows starting at the stretch; empty if it is not a tag, or
    /// not known. Empty if there are no tags at all.
    pub tags: Vec<Vec<Vec<bool>>>,
    /// Width of the tags' border over their side.
    pub tag_border: f64,
    /// Distance from the path, pixels, at which another object begins, on the negative side and on
    /// the other. Infinite if unknown.
    pub margin: [f64; 2],
    /// Whether other objects are beside the edge, so that the light there changes along it.
    pub is_beside_others: bool,
    /// For an edge of a thin bar, the bar's other edge, at which the light changes back: the span
    /// as an index into the same slice.
    pub far_edge: Option<usize>,
}

impl EdgeSpan {
    /// An edge that meets no other and has unknown surroundings.
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

    /// The reason why the span is invalid for any picture, if it is; `count` is the number of spans
    /// given together.
    pub(super) fn fault(&self, count: usize) -> Option<&'static str> {
        let crossings = self.crossings.iter().filter_map(|crossing| crossing.0);
        let neighbours = self.bounds.into_iter().flatten().chain(self.far_edge);
        let mut met = neighbours.chain(crossings);
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

/// The samples of one span, and measurements of the picture along it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SpanEdges {
    /// Points of the edge in order along the path, pixels.
    pub points: Vec<Vector2<f64>>,
    /// Standard deviation of each point along the edge's normal, pixels.
    pub std: Vec<f64>,
    /// Standard deviation `w` of the blur, including the pixel's own box, pixels.
    pub blur: f64,
    /// Coded grey beside the middle of the span, on its dark side; 1 is the largest value.
    pub dark: f64,
    /// The same on its light side.
    pub light: f64,
    /// Standard deviation of the pixels' residuals at the edge, coded.
    pub noise: f64,
    /// Displacement of each point by one standard deviation of the picture's tone curve, which
    /// moves all points of the picture together; empty if the curve is known.
    pub tone_drift: Vec<Vector2<f64>>,
}

/// Reason why a span has no samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoEdge {
    /// An argument is invalid for any picture: the span, or the tone curve.
    #[error("an argument is invalid: {0}")]
    InvalidArgument(&'static str),
    /// The path has fewer than two points, or its points coincide or are not finite.
    #[error("its outline has fewer than two different points, or one that is not finite")]
    NoPath,
    /// Too little of the path has its surroundings inside the picture.
    #[error("it lies outside the picture")]
    OutsidePicture,
    /// There is no smooth curve of the expected polarity near the path.
    #[error("no smooth edge with the dark on the expected side runs along its outline")]
    Inconsistent,
    /// Another object is so near that its blur would be taken for this edge's.
    #[error(
        "something else is too close to it, such as the other edge of a line that is thinner than \
         4 pixels, or than 5 times the blur"
    )]
    Cramped,
    /// There is an edge, but its contrast is lost in the noise, or it is not a step.
    #[error("its edge is too faint, too blurred or too short to be measured")]
    Unmeasurable,
}
