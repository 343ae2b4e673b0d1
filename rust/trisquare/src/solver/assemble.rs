//! Assembly of the calibration of an optimum.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::problem::JointProblem;
use super::solve::Solution;
use crate::lens::Lens;
use crate::observations::{Curve, Figure, ObservedPlane, Placement, View};
use crate::refine::{Residual, Residuals, root_mean_square};
use crate::result::{
    Aspect, Calibration, CircleRadius, FigureResiduals, Plane, SideResiduals, Stage, Warning,
};
use crate::uncertainty::{Correlated, pose_uncertainties};

impl<L: Lens> Calibration<L> {
    /// Sets the uncertainties of the poses of the optimum it was assembled from.
    pub(crate) fn set_pose_uncertainties(&mut self, solution: &Solution<L>) {
        let independent = &self.covariance - &self.residual_correlation.added;
        let (planes, refined) = (&solution.planes, &solution.refined);
        let shown = self.residual_correlation.displacements.iter();
        let displacements: Vec<f64> = shown
            .zip(planes)
            .map(|(displacement, plane)| displacement.max(plane.side_error))
            .collect();
        let names = L::parameter_names();
        let place = |name: &&str| names.iter().position(|known| known == name);
        let columns: Vec<usize> = self.parameters.iter().filter_map(place).collect();
        let poses = pose_uncertainties(planes, refined, (&independent, &columns), &displacements);
        for (i, found) in poses.into_iter().enumerate() {
            let Some(found) = found else { continue };
            let stds: Vec<f64> = found
                .shape
                .iter()
                .map(|parameter| parameter.std(self))
                .collect();
            let first = &refined.view.planes[i].figures[0];
            let has_aspect = planes[i].has_any_aspect();
            self.planes[i].uncertainty = Some(found.pose);
            self.planes[i].aspect = has_aspect.then(|| Aspect {
                value: first.stretch,
                std: stds[0],
            });
            self.planes[i].radii = circle_radii(&planes[i].figures[0], first, &stds);
        }
    }

    /// The results of an optimum, except the uncertainties of its poses.
    pub(crate) fn assemble(
        problem: &JointProblem<'_, L>,
        solution: &Solution<L>,
        stage: Stage,
    ) -> Self {
        let Solution {
            planes,
            refined,
            correlated,
            ..
        } = solution;
        let free = &problem.free;
        let Correlated {
            mut covariance,
            known,
            disagreement,
            mut residual_correlation,
        } = correlated.clone();
        let one_picture = planes.iter().all(|plane| plane.image == planes[0].image);
        let correlation_warnings =
            residual_correlation.warnings(&covariance, &known, free, one_picture);
        let disagreement = disagreement.map(|(found, change)| {
            // It is unknown which of the planes is right.
            let doubt = &change * change.transpose();
            covariance += &doubt;
            residual_correlation.added += doubt;
            Warning::Disagreement(found)
        });
        let residuals = &refined.residuals;
        Self {
            camera: refined.view.lens,
            image_size: problem.size,
            parameters: free.names(),
            covariance,
            aspect_fixed: free.aspect_is_fixed(),
            planes: planes
                .iter()
                .zip(residuals)
                .enumerate()
                .map(|(i, (plane, plane_residuals))| Plane {
                    figure: plane.figures[0].index,
                    image: plane.image,
                    pose: refined.view.planes[i].pose,
                    corners: observed_corners(plane, &refined.view, i),
                    rms: root_mean_square(plane_residuals.iter()),
                    samples: plane_residuals.len(),
                    uncertainty: None,
                    aspect: None,
                    radii: Vec::new(),
                })
                .collect(),
            lines: Vec::new(),
            residuals: figure_residuals(planes, residuals),
            rms: refined.rms(),
            noise_scale: refined.noise_scale,
            iterations: refined.iterations,
            warnings: correlation_warnings
                .into_iter()
                .chain(disagreement)
                .collect(),
            residual_correlation,
            stage,
            tones: Vec::new(),
            tone_growth: None,
        }
    }
}

/// The residuals of every figure and line, in the order given.
fn figure_residuals(planes: &[ObservedPlane], residuals: &Residuals) -> Vec<FigureResiduals> {
    let mut sorted = BTreeMap::new();
    for (number, (plane, plane_residuals)) in planes.iter().zip(residuals).enumerate() {
        let mut remaining = plane_residuals.iter();
        for (figure, side) in plane.sides_by_figure() {
            let (_, curves) = sorted
                .entry(plane.figures[figure].index)
                .or_insert_with(|| (number, BTreeMap::<usize, Vec<(usize, &Residual)>>::new()));
            let indices = side.samples.iter().map(|sample| sample.index);
            let side_residuals = indices.zip(remaining.by_ref().take(side.samples.len()));
            // The arcs of a circle form one curve.
            curves
                .entry(side.number)
                .or_default()
                .extend(side_residuals);
        }
    }
    let side = |mut curve: Vec<(usize, &Residual)>| {
        curve.sort_by_key(|(index, _)| *index);
        let (distances, normals) = curve.iter().map(|(_, r)| (r.distance, r.normal)).unzip();
        SideResiduals { distances, normals }
    };
    let figures = sorted.into_values().map(|(plane, curves)| FigureResiduals {
        plane,
        sides: curves.into_values().map(side).collect(),
    });
    figures.collect()
}

/// The radii of circles, if some are estimated, with their standard deviations.
fn circle_radii(figure: &Figure, placement: &Placement, stds: &[f64]) -> Vec<CircleRadius> {
    let mut radii = Vec::new();
    for side in &figure.sides {
        if let Curve::Circle(radius) = side.curve
            && side.number == radii.len()
            && !stds.is_empty()
        {
            let (value, index) = placement.radius(radius);
            let std = index.map_or(0.0, |index| stds[index]);
            radii.push(CircleRadius { value, std });
        }
    }
    radii
}

/// The images of a plane's corners: of a square where sides `i - 1` and `i` meet, of a lattice the
/// corners of the rectangle spanned by its lines' crossings, of circles those of a square about the
/// first.
fn observed_corners<L: Lens>(
    plane: &ObservedPlane,
    view: &View<L>,
    index: usize,
) -> [Vector2<f64>; 4] {
    let sides = &plane.figures[0].sides;
    let state = &view.planes[index];
    let crossing = |i: usize, j: usize| sides[i].line()?.intersection(&sides[j].line()?);
    let square = || -> Option<[Vector2<f64>; 4]> {
        (sides.len() == 4).then_some(())?;
        Some([
            crossing(3, 0)?,
            crossing(0, 1)?,
            crossing(1, 2)?,
            crossing(2, 3)?,
        ])
    };
    let corners = square().unwrap_or_else(|| {
        let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
        if let Curve::Circle(radius) = sides[0].curve {
            high = Vector2::repeat(state.figures[0].radius(radius).0);
            low = -high;
        }
        for i in 0..sides.len() {
            for j in 0..i {
                // Crossings of nearly parallel lines lie far outside and are ignored.
                let normal = |i: usize| sides[i].line().map_or_else(Vector2::zeros, |l| l.normal());
                let turn = normal(i).perp(&normal(j)).abs();
                if let Some(point) = crossing(i, j).filter(|_| turn > 0.1) {
                    low = low.inf(&point);
                    high = high.sup(&point);
                }
            }
        }
        [
            (low.x, low.y),
            (high.x, low.y),
            (high.x, high.y),
            (low.x, high.y),
        ]
        .map(|(x, y)| Vector2::new(x, y))
    });
    corners.map(|corner| {
        let point = state.figures[0].point(corner);
        view.lens.project_extended(&state.pose.transform(&point))
    })
}
