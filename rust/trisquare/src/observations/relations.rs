//! Planes of one picture that are known to be at right angles to each other, or parallel.
//!
//! Either relation means that axes of one plane are perpendicular to the normal of another: its
//! normal, or both axes that lie in it. The planes' rotations satisfy these equations exactly.

use std::collections::HashSet;

use nalgebra::{DMatrix, DVector, Vector3};

use super::observed::ObservedPlane;
use super::plane_edges::{Freedom, PlaneEdges};
use super::relation::{Equation, Related, Relation};
use super::view::{PlaneState, View};
use crate::error::Error;
use crate::geometry::Pose;
use crate::lens::Lens;
use crate::numeric::{ArrowSystem, pseudo_inverse};

/// Adds a relation between two planes, which are counted in the order of their first figures.
///
/// # Errors
/// [`Error::InvalidArgument`] if a plane does not exist, or both are the same.
pub fn relate_planes(
    edges: &mut [PlaneEdges],
    planes: [usize; 2],
    relation: Relation,
) -> Result<(), Error> {
    let mut first_figures = Vec::new();
    let mut known = HashSet::new();
    for (index, figure) in edges.iter().enumerate() {
        let is_on_plane = figure.freedom != Freedom::Line;
        if is_on_plane && figure.plane.is_none_or(|key| known.insert(key)) {
            first_figures.push(index);
        }
    }
    let count = first_figures.len();
    let figure = |plane: usize| {
        let found = first_figures.get(plane).copied();
        let problem = || format!("plane {plane} cannot be related: only {count} planes are given");
        found.ok_or_else(|| Error::InvalidArgument(problem()))
    };
    let [first, second] = [figure(planes[0])?, figure(planes[1])?];
    if first == second {
        return Err(Error::InvalidArgument(format!(
            "plane {} cannot be related to itself",
            planes[0]
        )));
    }
    edges[first].relations.push((second, relation));
    Ok(())
}

/// Maximum number of steps that rotate planes into their relations; each squares the remaining
/// error.
const MAX_TURNS: usize = 50;

/// Cosine below which the remaining error of a relation is rounding.
const SATISFIED: f64 = 1e-12;

/// Starting directions of the planes in the test whether relations can be satisfied at all: a
/// single start may lie halfway between two solutions.
const STARTS: [f64; 4] = [1.0, 2.3, 3.9, 5.2];

/// Returns the relations among some planes, without those to other planes.
pub(crate) fn relations_of(planes: &[ObservedPlane]) -> Vec<Related> {
    let mut found = Vec::new();
    for (first, plane) in planes.iter().enumerate() {
        for (figure, relation) in &plane.relations {
            let shows = |plane: &ObservedPlane| plane.figures.iter().any(|f| f.index == *figure);
            if let Some(second) = planes.iter().position(shows) {
                let planes = [first, second];
                let relation = *relation;
                found.push(Related { planes, relation });
            }
        }
    }
    found
}

impl<L: Lens> View<L> {
    /// Adds the relations as ties between the blocks of the planes, whose first parameters are
    /// rotations.
    pub fn tie(&self, system: &mut ArrowSystem) {
        let equations: Vec<Equation> = self.equations().collect();
        if equations.is_empty() {
            return;
        }
        for block in &mut system.blocks {
            block.ties = DMatrix::zeros(block.hessian.nrows(), equations.len());
        }
        for (i, equation) in equations.iter().enumerate() {
            for (plane, sign) in equation.planes.into_iter().zip([1.0, -1.0]) {
                let mut tie = system.blocks[plane].ties.fixed_view_mut::<3, 1>(0, i);
                tie += equation.by_turn * sign;
            }
        }
    }

    /// Rotates the planes as little as possible so that they satisfy their relations; returns
    /// whether they do.
    pub fn hold_relations(&mut self) -> bool {
        if self.relations.is_empty() {
            return true;
        }
        for _ in 0..MAX_TURNS {
            let equations: Vec<Equation> = self.equations().collect();
            let gaps = DVector::from_iterator(equations.len(), equations.iter().map(|e| e.gap));
            if gaps.amax() < SATISFIED {
                return true;
            }
            let mut by_turn = DMatrix::zeros(equations.len(), 3 * self.planes.len());
            for (i, equation) in equations.iter().enumerate() {
                let [first, second] = equation.planes.map(|plane| 3 * plane);
                let row = equation.by_turn.transpose();
                by_turn.fixed_view_mut::<1, 3>(i, first).copy_from(&row);
                by_turn.fixed_view_mut::<1, 3>(i, second).copy_from(&-row);
            }
            let square = &by_turn * by_turn.transpose();
            let turns = -by_turn.tr_mul(&(pseudo_inverse(square).0 * gaps));
            for (plane, turn) in self.planes.iter_mut().zip(turns.as_slice().chunks(3)) {
                let turn = Vector3::from_column_slice(turn);
                plane.pose = plane.pose.moved(&turn, &Vector3::zeros());
            }
        }
        false
    }

    /// Returns the same view without a plane and its relations.
    pub fn without_plane(mut self, index: usize) -> Self {
        self.planes.remove(index);
        self.relations
            .retain(|related| !related.planes.contains(&index));
        for plane in self.related_planes() {
            *plane -= usize::from(*plane > index);
        }
        self
    }

    /// Returns the same view with one more plane, which has no relations.
    pub fn with_plane(mut self, index: usize, plane: PlaneState) -> Self {
        self.planes.insert(index, plane);
        for plane in self.related_planes() {
            *plane += usize::from(*plane >= index);
        }
        self
    }

    fn related_planes(&mut self) -> impl Iterator<Item = &mut usize> {
        self.relations
            .iter_mut()
            .flat_map(|related| &mut related.planes)
    }

    fn equations(&self) -> impl Iterator<Item = Equation> + '_ {
        let related = self.relations.iter();
        let poses = |planes: [usize; 2]| planes.map(|plane| &self.planes[plane].pose);
        related.flat_map(move |related| related.equations(poses(related.planes)))
    }
}

/// Refuses relations that no planes can satisfy.
///
/// # Errors
/// [`Error::InvalidArgument`].
pub(crate) fn check_relations<L: Lens>(planes: &[ObservedPlane]) -> Result<(), Error> {
    let relations = relations_of(planes);
    let rotated_plane = |start: f64, plane: usize| {
        let angle = start * (plane + 1) as f64;
        let axis = Vector3::new(angle.sin(), (1.7 * angle).cos(), (2.6 * angle).sin());
        let pose = Pose {
            rotation: nalgebra::Matrix3::identity(),
            translation: Vector3::z(),
        };
        PlaneState {
            pose: pose.moved(&axis, &Vector3::zeros()),
            figures: Vec::new(),
        }
    };
    let is_satisfiable = |start: &f64| {
        let mut view = View {
            lens: L::from_camera_matrix(&nalgebra::Matrix3::identity()),
            planes: (0..planes.len())
                .map(|p| rotated_plane(*start, p))
                .collect(),
            relations: relations.clone(),
        };
        view.hold_relations()
    };
    match relations.is_empty() || STARTS.iter().any(is_satisfiable) {
        true => Ok(()),
        false => Err(Error::InvalidArgument(
            "the orthogonal and parallel relations contradict each other: no arrangement of planes \
             satisfies all of them"
                .into(),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::DefaultLens;
    use crate::observations::sort_by_plane;
    use crate::synthetic::{Scene, SceneOptions};

    const ORTHOGONAL: Relation = Relation::Orthogonal;
    const PARALLEL: Relation = Relation::Parallel;

    /// Four planes with the given relations, or the error.
    fn related(asked: &[([usize; 2], Relation)]) -> Result<Vec<ObservedPlane>, Error> {
        let scene = Scene::random(1, SceneOptions::default());
        let mut edges = scene.edges(1, 0.1, 20.0);
        edges.extend(scene.edges(2, 0.1, 20.0).into_iter().take(1));
        for (planes, relation) in asked {
            relate_planes(&mut edges, *planes, *relation)?;
        }
        let planes = sort_by_plane(&edges)?;
        check_relations::<DefaultLens>(&planes)?;
        Ok(planes)
    }

    #[test]
    fn planes_that_can_stand_so_are_turned_by_as_little_as_needed() {
        let corner = [
            ([0, 1], ORTHOGONAL),
            ([1, 2], ORTHOGONAL),
            ([2, 0], ORTHOGONAL),
        ];
        let planes = related(&[&corner[..], &[([0, 3], PARALLEL)]].concat()).unwrap();
        let scene = Scene::random(1, SceneOptions::default());
        let poses = scene.poses.iter().chain(&scene.poses[..1]);
        let mut view = View {
            lens: scene.camera,
            planes: poses
                .map(|pose| PlaneState {
                    pose: *pose,
                    figures: Vec::new(),
                })
                .collect(),
            relations: relations_of(&planes),
        };
        assert!(view.hold_relations());
        let normal = |plane: usize| view.planes[plane].pose.normal();
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            assert!(normal(a).dot(&normal(b)).abs() < 1e-11);
        }
        assert!(normal(0).cross(&normal(3)).norm() < 1e-11);
        let before = view.planes[1].pose;
        assert!(view.hold_relations());
        assert_eq!(view.planes[1].pose, before);
    }

    #[test]
    fn relations_that_no_planes_can_have_are_refused() {
        let all = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
        let refused = [
            all.map(|pair| (pair, ORTHOGONAL)).to_vec(),
            vec![([0, 1], PARALLEL), ([1, 0], ORTHOGONAL)],
            vec![([0, 1], PARALLEL), ([1, 2], ORTHOGONAL), ([0, 2], PARALLEL)],
            vec![([0, 4], PARALLEL)],
            vec![([2, 2], ORTHOGONAL)],
        ];
        for asked in refused {
            let found = related(&asked);
            assert!(matches!(found, Err(Error::InvalidArgument(_))), "{asked:?}");
        }
    }
}
