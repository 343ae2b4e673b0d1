//! Calibration from edges and the photographs that show them.

mod comparison;
mod stages;
mod unjudged;

pub(crate) use comparison::Comparison;
pub(crate) use unjudged::{FirstFit, calibrate_agreeing, calibrate_unjudged};

use stages::CheckedInput;

use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::observations::{Options, PlaneEdges};
use crate::photometric::Photographs;
use crate::result::Calibration;
use crate::solver::NestedOptima;

/// Calibrates a camera from edge samples of planes with known lines.
///
/// The paper's three steps (Zhou et al. 2013) and, unless `options.method` is linear, joint
/// maximum likelihood over all of them. Pixels; standard deviations are one sigma.
///
/// At least two planes in different directions are needed for focal lengths and principal point,
/// and three determine them well; one suffices if the principal point or the focal length is fixed.
/// Figures may be in several pictures of one camera, all of one size, with the index of their
/// picture as [`image`](PlaneEdges::image).
///
/// ```
/// use nalgebra::{Rotation3, Vector2, Vector3};
/// use trisquare::{Brown, ImageSize, Lens, Options, PlaneEdges, Pose, calibrate};
///
/// // What a camera sees of three squares that are tilted in different directions.
/// let camera = Brown::new([900.0, 900.0, 630.0, 475.0, -0.1, 0.0, 0.0, 0.0, 0.0]);
/// let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(Vector2::from);
/// let mut edges = Vec::new();
/// let squares = [
///     ([0.6, 0.0, 0.1], -0.8, -0.5),
///     ([-0.3, 0.5, 0.0], 0.8, -0.5),
///     ([-0.3, -0.5, 0.2], 0.0, 0.7),
/// ];
/// for (tilt, x, y) in squares {
///     let pose = Pose {
///         rotation: *Rotation3::new(Vector3::from(tilt)).matrix(),
///         translation: Vector3::new(x, y, 3.0),
///     };
///     let seen = |side: usize, part: f64| {
///         let point = corners[side].lerp(&corners[(side + 1) % 4], part);
///         camera.project(&pose.transform(&point)).unwrap()
///     };
///     let side = |side| (1..20).map(|i| seen(side, f64::from(i) / 20.0)).collect();
///     edges.push(PlaneEdges::square((0..4).map(side).collect())?);
/// }
///
/// let size = ImageSize { width: 1280, height: 960 };
/// let found = calibrate(&edges, size, &Options::default())?;
/// for (found, truth) in found.camera.parameters().iter().zip(camera.parameters()) {
///     assert!((found - truth).abs() < 1e-6 * truth.abs().max(1.0));
/// }
/// # Ok::<(), trisquare::Error>(())
/// ```
///
/// # Errors
/// Every variant of [`Error`] says what is wrong and what would help. If the geometry is degenerate
/// and a figure lies wholly outside the picture, the error is about the size of the picture
/// instead.
pub fn calibrate<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Result<Calibration<L>, Error> {
    calibrate_photographs(edges, size, options, None)
}

/// As [`calibrate`], with the photographs themselves: the refined model is then fitted to the
/// pixels around the edges, corners included, and used if that improves the result.
///
/// It needs maximum likelihood, and figures that are all outlines of four sides with their
/// [`polarity`](PlaneEdges::polarity); otherwise the result is that of the edges (see
/// [`Calibration::stage`]).
///
/// ```
/// use trisquare::{
///     Calibration, EdgeSpan, ImageSize, Options, Photographs, Picture, PlaneEdges, Polarity,
///     calibrate_photographs, localise_with_unknown_tone, pixels_to_keep,
/// };
///
/// /// From the sides of dark squares, four spans each in order round it.
/// fn camera_of(
///     picture: &Picture,
///     spans: &[EdgeSpan],
///     size: ImageSize,
/// ) -> Result<Calibration, Box<dyn std::error::Error>> {
///     let (sides, tone, faults) = localise_with_unknown_tone(picture, spans);
///     if let Some(mended) = faults.mended(picture) {
///         return camera_of(&mended, spans, size);
///     }
///     let sides: Vec<_> = sides.into_iter().collect::<Result<_, _>>()?;
///     let mut edges = Vec::new();
///     for sides in sides.chunks(4) {
///         let points = sides.iter().map(|side| side.points.clone()).collect();
///         let mut square = PlaneEdges::square(points)?;
///         square.std = Some(sides.iter().map(|side| side.std.clone()).collect());
///         square.tone_drift = Some(sides.iter().map(|side| side.tone_drift.clone()).collect());
///         square.side_error = faults.side_error;
///         square.polarity = Some(Polarity::DarkInside);
///         edges.push(square);
///     }
///     let blur = sides.iter().map(|side| side.blur).fold(0.0, f64::max);
///     let photographs = Photographs {
///         pictures: &[&pixels_to_keep(picture, &edges, blur)],
///         tones: &[tone.picture_tone()],
///     };
///     Ok(calibrate_photographs(&edges, size, &Options::default(), Some(&photographs))?)
/// }
/// ```
///
/// # Errors
/// As [`calibrate`]; [`Error::InvalidArgument`] if the photographs do not match the figures: if
/// they are fewer than the figures refer to, without one tone for each, or of another size.
pub fn calibrate_photographs<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    photographs: Option<&Photographs<'_>>,
) -> Result<Calibration<L>, Error> {
    calibrate_with_nested(edges, size, options, photographs, NestedOptima::default())
}

/// `calibrate_photographs` with known optima of nested models from a comparison.
pub(crate) fn calibrate_with_nested<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    photographs: Option<&Photographs<'_>>,
    nested: NestedOptima<L>,
) -> Result<Calibration<L>, Error> {
    let input = CheckedInput::check(edges, size, options, photographs)?;
    input.answer(nested).map_err(|error| input.cause_of(error))
}
