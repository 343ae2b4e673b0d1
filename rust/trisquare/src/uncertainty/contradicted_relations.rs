//! Test of stated relations between planes, by the poses of a calibration without the relations.

use nalgebra::{DMatrix, DVector};

use super::projection::ProjectionUncertainty;
use crate::lens::Lens;
use crate::numeric::normal_deviate;
use crate::observations::Related;
use crate::result::{Calibration, Warning};

/// Normal deviate above which a relation is contradicted: one in thirty thousand.
const EVIDENT: f64 = 4.0;

/// Warns of planes that contradict their stated relation, given a calibration without the
/// relations.
pub(crate) fn contradicted_relations<L: Lens>(
    found: &Calibration<L>,
    relations: &[Related],
) -> Vec<Warning> {
    let relations = relations.iter();
    relations
        .filter_map(|related| contradicted(found, related))
        .collect()
}

fn contradicted<L: Lens>(found: &Calibration<L>, related: &Related) -> Option<Warning> {
    let [first, second] = related.planes.map(|plane| &found.planes[plane]);
    let (names, covariance) = (&found.parameters, found.covariance.clone());
    let camera =
        ProjectionUncertainty::new(&found.camera, names, found.aspect_fixed, covariance).ok()?;
    let equations = related.equations([&first.pose, &second.pose]);
    let (gaps, rows): (Vec<f64>, Vec<_>) = equations
        .map(|equation| (equation.gap, equation.by_turn))
        .unzip();
    let by_turn = DMatrix::from_fn(rows.len(), 3, |i, j| rows[i][j]);
    let gaps = DVector::from_vec(gaps);
    let [first, second] = [first.uncertainty.as_ref()?, second.uncertainty.as_ref()?];
    let given_camera = first.given_camera + second.given_camera;
    let given_camera = given_camera.fixed_view::<3, 3>(0, 0);
    let relative_pose = camera.free().of(&(&first.by_camera - &second.by_camera));
    let by_camera = &by_turn * relative_pose.rows(0, 3);
    let covariance = &by_turn * given_camera * by_turn.transpose()
        + &by_camera * camera.free().covariance() * by_camera.transpose();
    let square = gaps.dot(&covariance.clone().cholesky()?.solve(&gaps));
    let std = covariance.trace().sqrt().to_degrees();
    (normal_deviate(square, gaps.len() as f64) > EVIDENT).then(|| Warning::RelationContradicted {
        planes: related.planes,
        stand: related.relation.words().into(),
        degrees: gaps.norm().min(1.0).asin().to_degrees(),
        std,
    })
}
