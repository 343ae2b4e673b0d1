//! The stages of a calibration, in order.

use std::rc::Rc;
use std::slice;

use super::comparison::Comparison;
use crate::error::{Error, ErrorKind};
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::lines::add_lines;
use crate::noise::check_drift_count;
use crate::observations::{
    Method, ObservedPlane, Options, PlaneEdges, check_relations, lines_of_scene, relations_of,
    samples_outside, sort_by_plane,
};
use crate::photometric::{Photographs, improve};
use crate::result::{Calibration, Stage, Warning};
use crate::solver::{
    Failure, JointProblem, NestedOptima, Solution, Work, reject_outliers, solution_if_agreed,
};
use crate::uncertainty::{
    LensVerdict, assumed_centre, camera_known_to, check_plane_equations, contradicted_relations,
    held_skew, poorly_known, unchecked_targets, unlikely_camera,
};

/// The checked input of a calibration, sorted by plane.
pub(super) struct CheckedInput<'a, L: Lens> {
    edges: &'a [PlaneEdges],
    planes: Vec<ObservedPlane>,
    lines: Vec<ObservedPlane>,
    size: ImageSize,
    options: &'a Options<L>,
    photographs: Option<&'a Photographs<'a>>,
}

/// A solution, and warnings about the sides and planes that it rejects.
type Solved<L> = (Solution<L>, Vec<Warning>);

impl<'a, L: Lens> CheckedInput<'a, L> {
    pub(super) fn check(
        edges: &'a [PlaneEdges],
        size: ImageSize,
        options: &'a Options<L>,
        photographs: Option<&'a Photographs<'_>>,
    ) -> Result<Self, Error> {
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
        Ok(Self {
            edges,
            planes,
            lines,
            size,
            options,
            photographs,
        })
    }

    fn work(&self) -> Rc<Work> {
        Rc::new(Work::for_planes(&self.planes))
    }

    fn problem(
        &self,
        work: &Rc<Work>,
        nested: &mut NestedOptima<L>,
    ) -> Result<JointProblem<'_, L>, Error> {
        let problem = JointProblem::of_planes(&self.planes, self.size, self.options, work, nested);
        check_plane_equations(&self.planes, &problem.free)?;
        Ok(problem)
    }

    /// The calibration with checks of the geometry; `nested` may contain optima of nested models.
    pub(super) fn answer(&self, mut nested: NestedOptima<L>) -> Result<Calibration<L>, Error> {
        let problem = self.problem(&self.work(), &mut nested)?;
        let advised = |failure| problem.advised(&self.planes, failure);
        let found = self.solve(&problem).map_err(advised)?;
        problem.judge(&found.0).map_err(advised)?;
        self.with_warnings(&problem, found)
    }

    /// The calibration without checks of the geometry, in a comparison with richer models fitted
    /// before.
    pub(super) fn compared(&self, shared: &mut Comparison<L>) -> Result<Calibration<L>, Error> {
        let work = Rc::clone(shared.work.get_or_insert_with(|| self.work()));
        let problem = self.problem(&work, &mut shared.nested)?;
        let found = match (&shared.richer, self.options.method) {
            (Some((planes, view)), Method::MaximumLikelihood) => problem
                .solve_from_richer(planes, view)
                .map(|s| (s, Vec::new())),
            _ => self.solve(&problem),
        };
        let (solution, outliers) =
            found.map_err(|failure| problem.advised(&self.planes, failure))?;
        shared.priors = problem.free.priors().to_vec();
        let view = solution.refined.view.clone();
        match &mut shared.richer {
            Some((_, last)) => *last = view,
            first => *first = Some((solution.with_outliers_marked(&self.planes), view)),
        }
        if self.stage() == Stage::Edges {
            problem.check_reach(&solution.refined.view.lens)?;
        }
        let (mut calibration, _) = self.assembled(&problem, (&solution, outliers));
        self.join_lines(&problem, (&solution, None), &mut calibration)?;
        calibration.sort_warnings();
        Ok(calibration)
    }

    /// The calibration of edges without checks of the geometry, and without a comparison.
    fn calibration_alone(
        edges: &[PlaneEdges],
        size: ImageSize,
        options: &Options<L>,
    ) -> Result<Calibration<L>, Error> {
        let input = CheckedInput::check(edges, size, options, None)?;
        input.compared(&mut Comparison::default())
    }

    /// The calibration if no plane or side has to be rejected; `None` if one has, or if there is no
    /// solution.
    pub(super) fn agreeing(&self) -> Option<Calibration<L>> {
        let problem = self.problem(&self.work(), &mut NestedOptima::default());
        let problem = problem.ok()?;
        let found = solution_if_agreed(&problem, &self.planes)?;
        problem.judge(&found.0).ok()?;
        self.with_warnings(&problem, found).ok()
    }

    fn solve(&self, problem: &JointProblem<'_, L>) -> Result<Solved<L>, Failure<L>> {
        match self.options.method {
            Method::Linear => problem.solve(&self.planes).map(|s| (s, Vec::new())),
            Method::MaximumLikelihood => reject_outliers(problem, &self.planes),
        }
    }

    /// The calibration of a solution whose geometry determines the camera, with warnings about
    /// everything that may make it wrong.
    fn with_warnings(
        &self,
        problem: &JointProblem<'_, L>,
        (mut solution, outliers): Solved<L>,
    ) -> Result<Calibration<L>, Error> {
        if self.stage() == Stage::Edges {
            problem.check_reach(&solution.refined.view.lens)?;
        }
        let verdict = problem.lens_verdict(&solution);
        if let Some(LensVerdict::Deformed) = verdict
            && let Some(found) = problem.with_deformation(&self.planes, &solution)
        {
            solution = found;
        }
        let (mut calibration, fitted) = self.assembled(problem, (&solution, outliers));
        let causes = match &verdict {
            Some(verdict) => {
                problem.apply_verdict(verdict, (&self.planes, &solution), &mut calibration)
            }
            None => Vec::new(),
        };
        let optimum = (&solution, fitted.as_ref());
        self.join_lines(problem, optimum, &mut calibration)?;
        self.add_doubts((problem, &solution), causes, &mut calibration);
        calibration.sort_warnings();
        Ok(calibration)
    }

    /// Stage of the solutions without the pixels.
    fn stage(&self) -> Stage {
        match self.options.method {
            Method::Linear => Stage::Linear,
            Method::MaximumLikelihood => Stage::Edges,
        }
    }

    /// A solution as a calibration, improved by the pixels if there are any, and their optimum.
    fn assembled(
        &self,
        problem: &JointProblem<'_, L>,
        (solution, outliers): (&Solution<L>, Vec<Warning>),
    ) -> (Calibration<L>, Option<Solution<L>>) {
        let stage = self.stage();
        let mut calibration = Calibration::assemble(problem, solution, stage);
        let fitted = match (stage, self.photographs) {
            (Stage::Edges, Some(photographs)) => {
                improve(self.edges, problem, solution, photographs, &mut calibration)
            }
            _ => None,
        };
        if calibration.stage == stage {
            calibration.set_pose_uncertainties(solution);
        }
        calibration.warnings.splice(0..0, outliers);
        (calibration, fitted)
    }

    /// Adds the lines of the scene, if any, to the optimum of the edges or of the pixels.
    fn join_lines(
        &self,
        problem: &JointProblem<'_, L>,
        optimum: (&Solution<L>, Option<&Solution<L>>),
        calibration: &mut Calibration<L>,
    ) -> Result<(), Error> {
        if self.lines.is_empty() {
            return Ok(());
        }
        add_lines(problem, optimum, &self.lines, calibration);
        problem.check_reach(&calibration.camera)
    }

    /// Adds warnings about possible errors of the result and about its uncertainty. Causes come
    /// before their consequences.
    fn add_doubts(
        &self,
        (problem, solution): (&JointProblem<'_, L>, &Solution<L>),
        causes: Vec<Warning>,
        calibration: &mut Calibration<L>,
    ) {
        let options = self.options;
        let compared = |edges: &[PlaneEdges], fixed| {
            let options = Options { fixed, ..*options };
            CheckedInput::calibration_alone(edges, self.size, &options).ok()
        };
        let focal = |edges: &[PlaneEdges], fixed| Some(compared(edges, fixed)?.camera.focal().x);
        let refined = &solution.refined;
        let conditioning = problem.conditioning(&solution.planes, refined);
        let found = &*calibration;
        let mut warnings = Vec::from_iter(self.outside_picture());
        warnings.extend(self.contradicted());
        warnings.extend(assumed_centre(
            &conditioning,
            found,
            refined.covariance_factor,
        ));
        let parameters = (&problem.free, &problem.judged);
        let sheared = held_skew(refined, parameters, options, |fixed| {
            let options = Options { fixed, ..*options };
            let input = CheckedInput::check(self.edges, self.size, &options, None).ok()?;
            input.answer(NestedOptima::default()).ok()
        });
        // One skew for all planes is a simpler cause than errors of targets or of the lens.
        warnings.extend(sheared);
        warnings.extend(causes);
        warnings.extend(unlikely_camera(found, options.fixed, |fixed| {
            focal(self.edges, fixed)
        }));
        let known_to = camera_known_to(found);
        let known = found.warnings.iter().cloned();
        warnings.extend(known.map(|warning| warning.with_camera_known_to(known_to)));
        warnings.extend(unchecked_targets(
            self.edges,
            &solution.planes,
            found,
            |edges| focal(edges, options.fixed),
        ));
        warnings.extend(poorly_known(found, options.fixed));
        calibration.warnings = warnings;
    }

    /// Warning about samples outside the picture, if any.
    fn outside_picture(&self) -> Option<Warning> {
        let (figure, samples, first) = samples_outside(self.edges, self.size)?;
        Some(Warning::OutsidePicture {
            figure,
            samples,
            first: first.into(),
            size: [self.size.width, self.size.height],
        })
    }

    /// The error to report: an error of the geometry is replaced by its cause, a mistaken size of
    /// the picture or a relation contradicted by the planes.
    pub(super) fn cause_of(&self, error: Error) -> Error {
        if !matches!(
            error.kind(),
            ErrorKind::DegenerateGeometry | ErrorKind::Convergence
        ) {
            return error;
        }
        if let Some(mistaken) = self.mistaken_size() {
            return mistaken;
        }
        match self.contradicted().first() {
            Some(warning) => Error::ContradictedRelation(warning.to_string()),
            None => error,
        }
    }

    /// The error for a figure wholly outside the picture, which no camera can have seen in it.
    fn mistaken_size(&self) -> Option<Error> {
        let is_outside = |figure: &PlaneEdges| {
            let outside = samples_outside(slice::from_ref(figure), self.size);
            outside.is_some_and(|(_, samples, _)| samples == figure.sample_count())
        };
        let figure = self.edges.iter().position(is_outside)?;
        let ImageSize { width, height } = self.size;
        Some(Error::InvalidArgument(format!(
            "figure {figure} lies wholly outside the picture of {width} x {height} pixels: is that \
             the picture's size, width before height?"
        )))
    }

    /// Warnings about relations between the planes that contradict a calibration without them.
    fn contradicted(&self) -> Vec<Warning> {
        let relations = relations_of(&self.planes);
        if relations.is_empty() {
            return Vec::new();
        }
        let unrelated = self.edges.iter().map(|edges| PlaneEdges {
            relations: Vec::new(),
            ..edges.clone()
        });
        let unrelated: Vec<PlaneEdges> = unrelated.collect();
        match CheckedInput::calibration_alone(&unrelated, self.size, self.options) {
            Ok(free) => contradicted_relations(&free, &relations),
            Err(_) => Vec::new(),
        }
    }
}

/// Checks that lines of the scene are given with planes, and not for the linear steps, which cannot
/// use them.
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
            "lines of the scene need the maximum-likelihood method: the linear steps cannot use \
             them"
                .into(),
        )),
    }
}
