//! The error type: each variant carries numbers that a caller can act on.

use crate::ill_conditioning::IllConditioning;

/// Failure of a calibration, or of one of its steps.
///
/// Figures, lines and samples are indices into the arguments, also in messages: the first is 0. A
/// figure under construction, as by [`PlaneEdges::square`](crate::PlaneEdges::square), is figure 0:
/// [`of_figure`](Self::of_figure) sets another index.
///
/// ```
/// use nalgebra::Vector2;
/// use trisquare::{Error, ErrorKind, PlaneEdges};
///
/// let side = vec![Vector2::new(10.0, f64::NAN), Vector2::new(20.0, 5.0)];
/// let error = PlaneEdges::square(vec![side; 4]).unwrap_err();
/// assert_eq!(error.kind(), ErrorKind::InvalidArgument);
/// assert!(matches!(error, Error::SampleNotFinite { line: 0, sample: 0, .. }));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument that is invalid with any data.
    #[error("{0}")]
    InvalidArgument(String),

    /// A coordinate, a standard deviation or a coefficient is NaN or infinite.
    #[error("{what} must be finite")]
    NotFinite {
        /// Name of the quantity.
        what: &'static str,
    },

    /// A sample of an edge has a coordinate that is NaN or infinite, or larger than any picture.
    #[error(
        "sample {sample} of line {line} of figure {figure} is not finite, or beyond 1e9 pixels"
    )]
    SampleNotFinite {
        /// Index of the figure; 0 for a figure under construction, or a line on no figure.
        figure: usize,
        /// Index of the line in the figure.
        line: usize,
        /// Index of the sample on the line.
        sample: usize,
    },

    /// Points outside the domain of the lens model.
    #[error(
        "{} beyond the valid radius: {}",
        points_lie(*.count, *.first),
        limit_of_lens(*.radius, *.degrees)
    )]
    BeyondValidRadius {
        /// Number of such points.
        count: usize,
        /// Index of the first one.
        first: usize,
        /// The valid radius of the lens, in its own measure.
        radius: f64,
        /// Angle from the axis up to which the lens is trusted, degrees.
        degrees: f64,
    },

    /// Points behind the camera, which no camera sees.
    #[error("{} behind the camera (z <= 0)", points_lie(*.count, *.first))]
    BehindCamera {
        /// Number of such points.
        count: usize,
        /// Index of the first one.
        first: usize,
    },

    /// The sides of a square follow each other around it except for one sample.
    #[error(
        "sample {sample} of line {line} of figure {figure} lies far off its line: leave it out, \
         since without it the sides are in order round the square"
    )]
    StraySample {
        /// Index of the figure; 0 for a figure under construction.
        figure: usize,
        /// Index of the side.
        line: usize,
        /// Index of the sample on the side.
        sample: usize,
    },

    /// The sides of a square do not follow each other around it.
    #[error(
        "the sides of figure {figure} are not in order round it: side {side} does not run between its \
         neighbours; give them in order, either way round"
    )]
    CrossedSides {
        /// Index of the figure; 0 for a figure under construction.
        figure: usize,
        /// Index of the first side out of order.
        side: usize,
    },

    /// Lines stated to be parallel meet in the picture.
    #[error(
        "lines {} and {} of figure {figure} cross in the picture, so they are not parallel on one \
         plane: give each line to its own family",
        lines[0], lines[1]
    )]
    CrossedParallels {
        /// Index of the figure.
        figure: usize,
        /// Indices of the lines in the figure.
        lines: [usize; 2],
    },

    /// Fewer planes than the free parameters need.
    #[error(
        "{} given, but the free parameters of the camera ({free}) need {needed}: {}, or fix parameters \
         whose values are known",
        counted(*found, "plane"),
        match found {
            0..3 => "show more targets in different directions (three determine them well)",
            _ => "show more, or state their shape (one of unknown aspect gives one equation, a square two)",
        }
    )]
    NotEnoughPlanes {
        /// Number of planes given.
        found: usize,
        /// Number of planes needed.
        needed: usize,
        /// Names of the free parameters that planes must determine.
        free: String,
    },

    /// Lines of the scene without a plane: [`fit_distortion`](crate::fit_distortion) estimates the
    /// distortion from them.
    #[error(
        "{} of the scene, but no plane: lines determine only the distortion; the other parameters \
         of the camera need squares",
        counted(*lines, "line")
    )]
    LinesAlone {
        /// Number of lines given.
        lines: usize,
    },

    /// A plane is described by too few lines.
    #[error(
        "figure {figure} has {}, but its homography needs {needed}",
        counted(*found, "line")
    )]
    TooFewLines {
        /// Index of the figure.
        figure: usize,
        /// Number of lines given.
        found: usize,
        /// Number of lines needed.
        needed: usize,
    },

    /// A family of parallel lines has too few lines.
    #[error(
        "a family of parallel lines of figure {figure} has {}, but needs {needed}",
        counted(*found, "line")
    )]
    TooFewParallels {
        /// Index of the figure.
        figure: usize,
        /// Number of lines of the smaller family.
        found: usize,
        /// Number of lines needed in each.
        needed: usize,
    },

    /// A line is described by too few samples; coincident ones count as one.
    #[error(
        "line {line} of figure {figure} has {}, but needs at least {needed}",
        counted(*found, "different sample")
    )]
    TooFewSamples {
        /// Index of the figure.
        figure: usize,
        /// Index of the line in the figure.
        line: usize,
        /// Number of different samples given.
        found: usize,
        /// Number of different samples needed.
        needed: usize,
    },

    /// A single circle, with nothing else on its plane that determines its direction.
    #[error(
        "figure {figure} is the only figure on its plane, and a single circle: its image has five \
         parameters, as many as its pose, and gives no equation for the camera. Measure a \
         concentric circle as well, or state that it is on the plane of an earlier figure in the \
         list"
    )]
    LoneCircle {
        /// Index of the figure.
        figure: usize,
    },

    /// Planes contradict their stated relation, so that no camera is found.
    #[error("{0}")]
    ContradictedRelation(String),

    /// The number of all samples does not exceed that of the unknowns.
    #[error("{samples} samples cannot determine {unknowns} unknowns: measure more points per side")]
    TooFewDegreesOfFreedom {
        /// Number of samples given.
        samples: usize,
        /// Number of parameters to be estimated.
        unknowns: usize,
    },

    /// The lines of one figure do not determine its homography.
    #[error("the lines of figure {figure} do not determine a homography: {reason}")]
    DegenerateHomography {
        /// Index of the figure.
        figure: usize,
        /// What is wrong with the lines.
        reason: &'static str,
    },

    /// The planes do not determine the image of the absolute conic.
    #[error(
        "the planes do not determine the camera matrix (ratio of singular values {ratio:.1e}): \
         tilt the squares in different directions, or fix the principal point"
    )]
    UndeterminedConic {
        /// Second smallest singular value of the constraints over the largest.
        ratio: f64,
    },

    /// The estimated image of the absolute conic is not positive definite.
    #[error(
        "the image of the absolute conic is not positive definite: the planes contradict each \
         other or are too weakly tilted; tilt them further apart, or fix the principal point"
    )]
    IndefiniteConic,

    /// The geometry does not determine a parameter of the camera matrix.
    #[error("{0}")]
    IllConditioned(Box<IllConditioning>),

    /// A rich lens model whose best fit turns back inside the picture, as no lens does.
    #[error(
        "the distortion that fits best with this lens model turns back {radius:.0} px from the \
         principal point, inside the picture (its farthest corner is {corner:.0} px away), as no \
         lens does: the edges do not determine that many coefficients. Choose a model with fewer, or \
         show targets nearer the corners"
    )]
    TurnsBack {
        /// Distance from the principal point, in pixels, at which the distortion turns back.
        radius: f64,
        /// Distance of the picture's farthest corner from the principal point, in pixels.
        corner: f64,
    },

    /// A lens of another family has a solution and the requested one has none.
    #[error(
        "the lens is a fisheye: choose the lens model {model}, which fits the edges to {rms:.2} px \
         (fx is {focal:.1}); the requested lens model has no solution"
    )]
    LensOfAnotherFamily {
        /// The model that describes the lens.
        model: String,
        /// Root mean square distance of the edge samples with it, px.
        rms: f64,
        /// `fx` with it, pixels.
        focal: f64,
    },

    /// An iteration did not converge.
    #[error(
        "{stage} did not converge{}: are all targets flat, and of the stated shape?",
        spent(*.iterations, *.rms)
    )]
    NotConverged {
        /// The stage that failed.
        stage: &'static str,
        /// Number of iterations; 0 if it failed before the first.
        iterations: usize,
        /// Root mean square distance of the samples after them, px.
        rms: f64,
    },
}

/// A count with its noun in the singular or plural.
pub(crate) fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Text about the points at invalid places.
fn points_lie(count: usize, first: usize) -> String {
    match count {
        1 => format!("the point of index {first} lies"),
        _ => format!("{count} points (the first has index {first}) lie"),
    }
}

/// Why a lens sees no further.
fn limit_of_lens(radius: f64, degrees: f64) -> String {
    if radius.is_infinite() {
        return "the pixel would not be finite".into();
    }
    let of_pinhole = match degrees > 90.0 {
        true => ", and a pinhole sees less than 90",
        false => "",
    };
    format!(
        "the distortion is monotonic and invertible only up to a radius of {radius:.6}, \
         {degrees:.2} degrees from the axis{of_pinhole}"
    )
}

/// Text about the iterations used, and the residual reached.
fn spent(iterations: usize, rms: f64) -> String {
    match iterations {
        0 => String::new(),
        _ => format!(" in {iterations} iterations (rms {rms:.3} px)"),
    }
}

/// The families of [`Error`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// An argument is invalid in itself.
    InvalidArgument,
    /// Fewer planes than the unknowns need.
    NotEnoughPlanes,
    /// Fewer lines, samples or degrees of freedom than the unknowns need.
    NotEnoughData,
    /// Enough data, but of a geometry that does not determine the camera.
    DegenerateGeometry,
    /// An iteration that did not converge.
    Convergence,
}

impl Error {
    /// The error with the figure's index replaced, if it has one.
    ///
    /// [`PlaneEdges::square`](crate::PlaneEdges::square) and similar constructors do not know the
    /// index of their figure: `PlaneEdges::square(sides).map_err(|error| error.of_figure(index))`.
    #[must_use]
    pub fn of_figure(mut self, index: usize) -> Self {
        match &mut self {
            Error::SampleNotFinite { figure, .. }
            | Error::StraySample { figure, .. }
            | Error::CrossedSides { figure, .. }
            | Error::CrossedParallels { figure, .. }
            | Error::TooFewLines { figure, .. }
            | Error::TooFewParallels { figure, .. }
            | Error::TooFewSamples { figure, .. }
            | Error::LoneCircle { figure }
            | Error::DegenerateHomography { figure, .. } => *figure = index,
            _ => {}
        }
        self
    }

    /// The family this error belongs to.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::InvalidArgument(_)
            | Error::NotFinite { .. }
            | Error::SampleNotFinite { .. }
            | Error::StraySample { .. }
            | Error::BeyondValidRadius { .. }
            | Error::BehindCamera { .. }
            | Error::CrossedSides { .. }
            | Error::CrossedParallels { .. } => ErrorKind::InvalidArgument,
            Error::NotEnoughPlanes { .. } | Error::LinesAlone { .. } => ErrorKind::NotEnoughPlanes,
            Error::TooFewLines { .. }
            | Error::TooFewParallels { .. }
            | Error::TooFewSamples { .. }
            | Error::LoneCircle { .. }
            | Error::TooFewDegreesOfFreedom { .. } => ErrorKind::NotEnoughData,
            Error::DegenerateHomography { .. }
            | Error::UndeterminedConic { .. }
            | Error::IndefiniteConic
            | Error::TurnsBack { .. }
            | Error::LensOfAnotherFamily { .. }
            | Error::ContradictedRelation(_)
            | Error::IllConditioned(_) => ErrorKind::DegenerateGeometry,
            Error::NotConverged { .. } => ErrorKind::Convergence,
        }
    }
}
