//! The stages, in order, and nothing else.

use std::rc::Rc;
use std::slice;

use crate::error::{Error, ErrorKind};
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::lines::add_lines;
use crate::noise::check_drift_count;
use crate::observations::{
    Method, ObservedPlane, Options, PlaneEdges, View, check_relations, lines_of_scene,
    relations_of, samples_outside, sort_by_plane,
};
use crate::photometric::{Photographs, improve};
use crate::result::{Calibration, Stage, Warning};
use crate::solver::{
    Failure, JointProblem, NestedOptima, Solution, Work, agreed_by_all, reject_outliers,
};
use crate::uncertainty::{
    LensVerdict, assumed_centre, check_plane_equations, contradicted_relations, held_skew,
    poorly_known, unchecked_targets, unlikely_camera,
};

/// Calibrates a camera from edge samples of planes with known lines.
///
/// The paper's three steps (Zhou et al. 2013) and, unless `options.method` is linear, joint
/// maximum likelihood over all of them. Pixels; standard deviations are one sigma.
///
/// Two planes in different directions are the least that determine focal lengths and principal point,
/// three tell them well; one does where the principal point or the focal length is held. Figures in
/// several pictures of one camera, all of one size, have the index of theirs as
/// [`image`](PlaneEdges::image).
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
/// Every variant of [`Error`] says what is wrong and what would help. Where the geometry is refused
/// and a figure lies wholly outside the picture, that is said instead: its size is mistaken.
pub fn calibrate<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Result<Calibration<L>, Error> {
    calibrate_photographs(edges, size, options, None)
}

/// As [`calibrate`], with the photographs themselves: the refined model is then fitted to the
/// pixels around the edges, corners included, and taken where that improves the answer.
///
/// It needs maximum likelihood, and figures that are all outlines of four sides with their
/// [`polarity`](PlaneEdges::polarity); otherwise the answer is that of the edges
/// ([`Calibration::stage`] says which it is).
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
/// As [`calibrate`]; [`Error::InvalidArgument`] if the photographs are not those of the figures:
/// fewer than the figures name, not one tone for each, or another size.
pub fn calibrate_photographs<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    photographs: Option<&Photographs<'_>>,
) -> Result<Calibration<L>, Error> {
    calibrate_beside(edges, size, options, photographs, NestedOptima::default())
}

/// The same where models nested in each other were compared before, and optima of theirs are known.
pub(crate) fn calibrate_beside<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    photographs: Option<&Photographs<'_>>,
    nested: NestedOptima<L>,
) -> Result<Calibration<L>, Error> {
    let found = run(edges, size, options, photographs, Purpose::Answer(nested));
    found.map_err(|error| {
        if !is_of_geometry(&error) {
            return error;
        }
        if let Some(mistaken) = mistaken_size(edges, size) {
            return mistaken;
        }
        let contradicted = match sort_by_plane(edges) {
            Ok(planes) => contradicted(edges, &planes, size, options),
            Err(_) => Vec::new(),
        };
        match contradicted.first() {
            Some(warning) => Error::ContradictedRelation(warning.to_string()),
            None => error,
        }
    })
}

/// As [`calibrate`], without a judgement of the geometry: to compare models, the richest first, of
/// which the chosen one is judged. They share their work, which the first one bounds.
pub(crate) fn calibrate_unjudged<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    shared: &mut Comparison<L>,
) -> Result<Calibration<L>, Error> {
    run(edges, size, options, None, Purpose::Comparison(shared))
}

/// As [`calibrate`], of planes and sides of which none has to be rejected.
///
/// # Errors
/// As [`calibrate`], without what would help, and if one has to be.
pub(crate) fn calibrate_agreeing<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Result<Calibration<L>, Error> {
    run(edges, size, options, None, Purpose::Agreement)
}

/// What one fit of a lens to all planes leaves.
pub(crate) struct FirstFit {
    /// Whether the planes agree.
    pub agrees: bool,
    /// Of the residuals, in pixels.
    pub rms: f64,
}

impl FirstFit {
    /// Without the search for false planes; `None` where the fit fails, which that search may mend.
    pub(crate) fn of<L: Lens>(
        edges: &[PlaneEdges],
        size: ImageSize,
        options: &Options<L>,
    ) -> Option<Self> {
        let planes = sort_by_plane(edges).ok()?;
        let work = Rc::new(Work::for_planes(&planes));
        let nested = &mut NestedOptima::default();
        let problem = JointProblem::of_planes(&planes, size, options, &work, nested);
        let found = problem.solve(&planes).ok()?;
        Some(Self {
            agrees: found.agrees(&problem),
            rms: found.refined.rms(),
        })
    }
}

/// What models that are compared share, and tell beside their calibration.
pub(crate) struct Comparison<L: Lens> {
    work: Option<Rc<Work>>,
    nested: NestedOptima<L>,
    /// Column and standard deviation of what the last one was held near zero by.
    pub priors: Vec<(usize, f64)>,
    /// The planes with the outliers of the first one, and the view of the last one. Models that are
    /// too poor would reject what they do not describe, side by side.
    richer: Option<(Vec<ObservedPlane>, View<L>)>,
}

impl<L: Lens> Default for Comparison<L> {
    fn default() -> Self {
        Self {
            work: None,
            nested: NestedOptima::default(),
            priors: Vec::new(),
            richer: None,
        }
    }
}

impl<L: Lens> Comparison<L> {
    /// Optima that were found, unless work ran out before they were found as they are without
    /// others.
    pub fn into_nested(self) -> NestedOptima<L> {
        match self.work {
            Some(work) if !work.is_spent() => self.nested,
            _ => NestedOptima::default(),
        }
    }
}

/// What a calibration is for.
enum Purpose<'a, L: Lens> {
    /// Where some optima may be known already.
    Answer(NestedOptima<L>),
    /// With other models, all of which share their work.
    Comparison(&'a mut Comparison<L>),
    /// To see whether all planes agree with a lens: none is rejected.
    Agreement,
}

fn run<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    photographs: Option<&Photographs<'_>>,
    purpose: Purpose<'_, L>,
) -> Result<Calibration<L>, Error> {
    size.check()?;
    options.check()?;
    if let Some(photographs) = photographs {
        photographs.check(edges, size)?;
    }
    let planes = sort_by_plane(edges)?;
    let lines = lines_of_scene(edges)?;
    check_lines((planes.len(), lines.len()), options.method)?;
    check_drift_count(&planes)?;
    check_relations::<L>(&planes)?;
    let own = || Rc::new(Work::for_planes(&planes));
    let rejecting = !matches!(purpose, Purpose::Agreement);
    let (work, mut comparison, mut nested) = match purpose {
        Purpose::Answer(nested) => (own(), None, nested),
        Purpose::Agreement => (own(), None, NestedOptima::default()),
        Purpose::Comparison(shared) => {
            let work = Rc::clone(shared.work.get_or_insert_with(own));
            let nested = std::mem::take(&mut shared.nested);
            (work, Some(shared), nested)
        }
    };
    let judging = comparison.is_none();
    let problem = JointProblem::of_planes(&planes, size, options, &work, &mut nested);
    if let Some(comparison) = &mut comparison {
        comparison.nested = nested;
    }
    let richer = comparison.as_ref().and_then(|it| it.richer.as_ref());
    check_plane_equations(&planes, &problem.free)?;

    // Nobody asks what would help planes to agree: that takes longer than to see that they do not.
    let advised = |failure: Failure<L>| match rejecting {
        true => problem.advised(&planes, failure),
        false => failure.into_error(),
    };
    let (stage, found) = match options.method {
        Method::Linear => (
            Stage::Linear,
            problem.solve(&planes).map(|s| (s, Vec::new())),
        ),
        Method::MaximumLikelihood => (
            Stage::Edges,
            match richer {
                Some((planes, view)) => problem.solve_below(planes, view).map(|s| (s, Vec::new())),
                None if rejecting => reject_outliers(&problem, &planes),
                None => agreed_by_all(&problem, &planes),
            },
        ),
    };
    let (mut solution, outliers) = found.map_err(advised)?;
    if let Some(comparison) = comparison {
        comparison.priors = problem.free.priors().to_vec();
        let view = solution.refined.view.clone();
        match &mut comparison.richer {
            Some((_, last)) => *last = view,
            first => *first = Some((solution.with_its_outliers(&planes), view)),
        }
    }
    if judging {
        problem.judge(&solution).map_err(advised)?;
    }
    if stage == Stage::Edges {
        problem.check_reach(&solution.refined.view.lens)?;
    }
    let verdict = match judging {
        true => problem.lens_verdict(&solution),
        false => None,
    };
    if let Some(LensVerdict::NotFlat) = verdict
        && let Some(found) = problem.with_relief(&planes, &solution)
    {
        solution = found;
    }
    let mut calibration = Calibration::assemble(&problem, &solution, stage);
    let fitted = match (stage, photographs) {
        (Stage::Edges, Some(photographs)) => {
            improve(edges, &problem, &solution, photographs, &mut calibration)
        }
        _ => None,
    };
    if calibration.stage == stage {
        calibration.state_poses(&solution);
    }
    calibration.warnings.splice(0..0, outliers);
    let causes = match &verdict {
        Some(verdict) => problem.heed(verdict, (&planes, &solution), &mut calibration),
        None => Vec::new(),
    };
    if !lines.is_empty() {
        let optimum = (&solution, fitted.as_ref());
        add_lines(&problem, optimum, &lines, &mut calibration);
        problem.check_reach(&calibration.camera)?;
    }
    if judging {
        let given = (edges, planes.as_slice(), size, options);
        add_doubts(given, (&problem, &solution), causes, &mut calibration);
    }
    calibration.sort_warnings();
    Ok(calibration)
}

/// Warns of what may make the answer wrong, and of how well it is known. What explains other warnings
/// comes before them, a consequence after its causes.
fn add_doubts<L: Lens>(
    (edges, planes, size, options): (&[PlaneEdges], &[ObservedPlane], ImageSize, &Options<L>),
    (problem, solution): (&JointProblem<'_, L>, &Solution<L>),
    causes: Vec<Warning>,
    calibration: &mut Calibration<L>,
) {
    let focal = |edges: &[PlaneEdges], options: &Options<L>| {
        let found = calibrate_unjudged(edges, size, options, &mut Comparison::default());
        Some(found.ok()?.camera.focal().x)
    };
    let refined = &solution.refined;
    let conditioning = problem.conditioning(&solution.planes, refined);
    let found = &*calibration;
    let mut warnings = Vec::from_iter(outside_picture(edges, size));
    warnings.extend(contradicted(edges, planes, size, options));
    warnings.extend(assumed_centre(
        &conditioning,
        found,
        refined.covariance_factor,
    ));
    warnings.extend(causes);
    warnings.extend(held_skew(&solution.planes, refined, options, |fixed| {
        let options = Options { fixed, ..*options };
        calibrate_unjudged(edges, size, &options, &mut Comparison::default()).ok()
    }));
    warnings.extend(unlikely_camera(found, options.fixed, |fixed| {
        focal(edges, &Options { fixed, ..*options })
    }));
    warnings.extend(found.warnings.iter().cloned());
    warnings.extend(unchecked_targets(edges, &solution.planes, found, |edges| {
        focal(edges, options)
    }));
    warnings.extend(poorly_known(found, options.fixed));
    calibration.warnings = warnings;
}

/// Samples outside the picture, where there are any.
fn outside_picture(edges: &[PlaneEdges], size: ImageSize) -> Option<Warning> {
    let (figure, samples, first) = samples_outside(edges, size)?;
    Some(Warning::OutsidePicture {
        figure,
        samples,
        first: first.into(),
        size: [size.width, size.height],
    })
}

/// Of figures of which one is wholly outside the picture: no camera has seen them in it.
fn mistaken_size(edges: &[PlaneEdges], size: ImageSize) -> Option<Error> {
    let is_outside = |figure: &PlaneEdges| {
        let outside = samples_outside(slice::from_ref(figure), size);
        outside.is_some_and(|(_, samples, _)| samples == figure.sample_count())
    };
    let figure = edges.iter().position(is_outside)?;
    let ImageSize { width, height } = size;
    Some(Error::InvalidArgument(format!(
        "figure {figure} lies wholly outside the picture of {width} x {height} pixels: is that its \
         size, width before height?"
    )))
}

/// Whether planes that do not stand as they are said to may be why there is no camera.
fn is_of_geometry(error: &Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::DegenerateGeometry | ErrorKind::Convergence
    )
}

/// Relations between the planes that a calibration without them contradicts.
fn contradicted<L: Lens>(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    size: ImageSize,
    options: &Options<L>,
) -> Vec<Warning> {
    let relations = relations_of(planes);
    if relations.is_empty() {
        return Vec::new();
    }
    let untold = edges.iter().map(|edges| PlaneEdges {
        relations: Vec::new(),
        ..edges.clone()
    });
    let untold: Vec<PlaneEdges> = untold.collect();
    let untold = calibrate_unjudged(&untold, size, options, &mut Comparison::default());
    untold.map_or_else(
        |_| Vec::new(),
        |untold| contradicted_relations(&untold, &relations),
    )
}

/// Lines tell of the lens beside planes, which the linear steps do not know how to join.
fn check_lines((planes, lines): (usize, usize), method: Method) -> Result<(), Error> {
    if lines == 0 {
        return Ok(());
    }
    if planes == 0 {
        return Err(Error::LinesAlone { lines });
    }
    match method {
        Method::MaximumLikelihood => Ok(()),
        Method::Linear => Err(Error::InvalidArgument(
            "lines of the scene need maximum likelihood: the linear steps have no place for them"
                .into(),
        )),
    }
}
