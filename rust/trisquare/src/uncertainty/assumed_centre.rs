//! Effect on the focal length of a principal point that is held without having been measured.

use nalgebra::{DMatrix, Matrix2, SymmetricEigen, Vector2};

use super::conditioning::{Conditioning, judged_parameters};
use crate::lens::Lens;
use crate::numeric::Problem;
use crate::observations::{Fixed, Options};
use crate::refine::EdgeProblem;
use crate::result::{Calibration, Warning};

/// Standard deviation of cameras' principal points about the centre, of each coordinate, as a
/// fraction of the width.
const CENTRE_SCATTER: f64 = 0.012;

/// Increase of chi-square above which the planes contradict a principal point.
const CONTRADICTED: f64 = 18.0;

/// Maximum number of sweeps of the symmetric eigenvalue iteration; a few suffice.
const MAX_SWEEPS: usize = 100;

/// Warns if `fx` depends on a principal point held at the picture's centre, and the planes could
/// not show that it is elsewhere.
///
/// The centre of distortion is freed from the principal point, as in the judgement of the geometry:
/// a lens polynomial does not determine what the planes leave open. `factor` turns the inverse of
/// the information into a covariance.
pub(crate) fn assumed_centre<L: Lens>(
    conditioning: &Conditioning<'_, L>,
    found: &Calibration<L>,
    factor: f64,
) -> Option<Warning> {
    let options = conditioning.options;
    if !options.fixed.principal_point || options.initial.is_some() {
        return None;
    }
    let std = found.std_of("fx")?;
    let scatter = CENTRE_SCATTER * f64::from(found.image_size.width);
    let (information, response) = centre_information(conditioning, factor)?;
    let directions = SymmetricEigen::try_new(information, f64::EPSILON, MAX_SWEEPS)?;
    let undetermined =
        (0..2).filter(|i| scatter.powi(2) * directions.eigenvalues[*i] < CONTRADICTED);
    let variance =
        undetermined.map(|i| (scatter * response.dot(&directions.eigenvectors.column(i))).powi(2));
    let added = variance.sum::<f64>().sqrt();
    (added > std).then_some(Warning::PrincipalPointAssumed {
        scatter,
        added,
        std,
    })
}

/// Returns the planes' information about a principal point that is held, and the derivative of `fx`
/// with respect to it.
fn centre_information<L: Lens>(
    conditioning: &Conditioning<'_, L>,
    factor: f64,
) -> Option<(Matrix2<f64>, Vector2<f64>)> {
    let options = Options {
        fixed: Fixed {
            principal_point: false,
            ..conditioning.options.fixed
        },
        ..*conditioning.options
    };
    let free = options.free_parameters();
    let judged = judged_parameters(&free);
    let problem = EdgeProblem::new(conditioning.planes, &judged, conditioning.noise_scale);
    let (_, mut system) = problem.evaluate(conditioning.view)?;
    conditioning.add_centre_prior(&mut system, &free, factor);
    let information = system.reduced_information()? / factor;
    let centre = [free.position("cx")?, free.position("cy")?];
    let others = (0..information.nrows()).filter(|i| !centre.contains(i));
    let others: Vec<usize> = others.collect();
    let rows = |rows: &[usize]| information.select_rows(rows);
    let cross: DMatrix<f64> = rows(&others).select_columns(&centre);
    let others_by_centre = rows(&others)
        .select_columns(&others)
        .cholesky()?
        .solve(&cross);
    let centre_block = rows(&centre).select_columns(&centre) - cross.tr_mul(&others_by_centre);
    let fx = others
        .iter()
        .position(|i| Some(*i) == free.position("fx"))?;
    let response = Vector2::new(-others_by_centre[(fx, 0)], -others_by_centre[(fx, 1)]);
    Some((centre_block.fixed_view::<2, 2>(0, 0).into_owned(), response))
}
