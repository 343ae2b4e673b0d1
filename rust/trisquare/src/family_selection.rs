//! Which family of lenses the data ask for.
//!
//! A distorted pinhole and a fisheye are not nested in each other. The models of each are weighed one
//! by one against those of the other, by the criterion of G. Schwarz (Ann. Statist. 6 (1978) 461-464)
//! on the edge samples, which count as so many independent ones as their correlation leaves.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;

use nalgebra::{DMatrix, DVector, Vector2};

use crate::calibrate::{FirstFit, calibrate_photographs};
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, DistortionModel, Fisheye, INTRINSICS, Lens, SKEW};
use crate::model_selection::{ModelChoice, Weighed, check_comparable, raising_part};
use crate::noise::ORDERS;
use crate::observations::{Fixed, Options, PRIOR_SLACK, PlaneEdges, has_grid, sort_by_plane};
use crate::photometric::Photographs;
use crate::result::Calibration;
use crate::solver::step_of_some;
use crate::uncertainty::{unlikely_camera, widen};

/// Logarithm of the odds by which a fisheye must explain the samples better: one camera in twenty,
/// or fewer, has such a lens.
const PREFERENCE: f64 = 3.0;

/// The angle from the axis, in radians, from which on a fisheye is told from a distorted pinhole.
const WIDE: f64 = 0.7;

/// What a fisheye may leave of the residuals of a distorted pinhole that leaves nothing but noise: with
/// more it has no odds.
const AS_GOOD: f64 = 1.1;

/// A calibration with a lens of the family that the data ask for.
#[derive(Debug, Clone, PartialEq)]
pub enum FamilyChoice {
    /// A distorted pinhole.
    Pinhole(ModelChoice<DefaultLens>),
    /// A fisheye.
    Fisheye(ModelChoice<Fisheye>),
}

/// The best model of a family that was not chosen.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RejectedFamily {
    /// Its name.
    pub model: String,
    /// Natural logarithm of its odds against what was chosen; not positive.
    pub log_evidence: f64,
    /// Root mean square distance of the edge samples with it, in pixels.
    pub rms: f64,
}

/// Calibrates with the lens, of any family, that has the largest evidence.
///
/// As [`calibrate_by_evidence`](crate::calibrate_by_evidence) within each family. A fisheye is only
/// asked about where a distorted pinhole leaves sides that err together, or bends a wide field as a
/// fisheye does. What the other family says of focal length and principal point stays, by its
/// probability, in the covariance.
///
/// ```
/// use trisquare::{Error, FamilyChoice, ImageSize, Options, PlaneEdges, calibrate_by_family};
///
/// fn tell(edges: &[PlaneEdges], size: ImageSize) -> Result<(), Error> {
///     match calibrate_by_family(edges, size, &Options::default(), None)?.0 {
///         FamilyChoice::Pinhole(found) => println!("{:?}", found.calibration.camera),
///         FamilyChoice::Fisheye(found) => println!("{:?}", found.calibration.camera),
///     }
///     Ok(())
/// }
/// ```
///
/// # Errors
/// As [`calibrate_by_evidence`](crate::calibrate_by_evidence) of a distorted pinhole.
// Compiled by its callers alone, as all that is generic: here it would be the one function that
// compiles a calibration with each lens in this crate, too.
#[inline]
pub fn calibrate_by_family(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<DefaultLens>,
    photographs: Option<&Photographs<'_>>,
) -> Result<(FamilyChoice, Option<RejectedFamily>), Error> {
    check_comparable(options)?;
    let wide_options = options.for_family::<Fisheye>();
    let plain = Weighed::of(edges, size, options);
    let may_be_wide = |fit: &Calibration<_>| {
        let limit = AS_GOOD * fit.rms;
        bends_as_a_fisheye(fit)
            && FirstFit::of(&telling(edges), size, &wide_options)
                .is_none_or(|wide| wide.rms < limit)
    };
    let is_enough = |fit: &Calibration<_>| is_clean(fit) && !may_be_wide(fit);
    if let Some(plain) = plain.as_ref().filter(|plain| is_enough(plain.chosen().1)) {
        let choice = plain.answer(edges, size, options, photographs)?;
        return Ok((FamilyChoice::Pinhole(choice), None));
    }
    let wide = Weighed::of(edges, size, &wide_options);
    let (plain, wide) = match (plain, wide) {
        (Some(plain), Some(wide)) => (plain, wide),
        (None, Some(wide)) => {
            let choice = wide.answer(edges, size, &wide_options, photographs)?;
            return Ok((FamilyChoice::Fisheye(choice), None));
        }
        (Some(plain), None) => {
            let choice = plain.answer(edges, size, options, photographs)?;
            return Ok((FamilyChoice::Pinhole(choice), None));
        }
        (None, None) => {
            // No model converges: the error of the one that was asked for tells why.
            let calibration = calibrate_photographs(edges, size, options, photographs)?;
            let choice = ModelChoice::without_alternatives(options.model, calibration);
            return Ok((FamilyChoice::Pinhole(choice), None));
        }
    };
    let best = best_standing(edges, &wide, &plain);
    if best.odds > 0.0 {
        let mut choice = wide.answer(edges, size, &wide_options, photographs)?;
        let found = &mut choice.calibration;
        add_doubt(found, best.plain.1, (&plain, options), -best.odds);
        let rejected = rejected(best.plain, -best.odds);
        return Ok((FamilyChoice::Fisheye(choice), Some(rejected)));
    }
    let mut choice = plain.answer(edges, size, options, photographs)?;
    let found = &mut choice.calibration;
    add_doubt(found, best.wide.1, (&wide, &wide_options), best.odds);
    let rejected = rejected(best.wide, best.odds);
    Ok((FamilyChoice::Pinhole(choice), Some(rejected)))
}

/// Whether the lens is a distorted pinhole, for which another may be looked for under these options.
pub(crate) fn may_be_another<L: Lens>(options: &Options<L>) -> bool {
    let is_fisheye = L::centre_columns().is_empty();
    !is_fisheye && check_comparable(options).is_ok()
}

/// Samples of a line that tell one family from another. A fisheye is asked sample by sample.
const SAMPLES_PER_LINE: usize = 100;

/// Edges that tell one family from another: of many planes some, unless they stand in relations.
pub(crate) fn telling(edges: &[PlaneEdges]) -> Vec<PlaneEdges> {
    let mut planes = HashMap::new();
    let number = |(index, own): (usize, &PlaneEdges)| {
        let next = planes.len();
        // A figure that shares no plane has one of its own.
        *planes.entry(own.plane.ok_or(index)).or_insert(next)
    };
    let numbers: Vec<usize> = edges.iter().enumerate().map(number).collect();
    let is_related = edges.iter().any(|own| !own.relations.is_empty());
    let step = step_of_some(planes.len())
        .filter(|_| !is_related)
        .unwrap_or(1);
    let some = edges
        .iter()
        .zip(numbers)
        .filter(|(_, plane)| plane % step == 0);
    some.map(|(own, _)| own.thinned(SAMPLES_PER_LINE)).collect()
}

/// Where sides err together under a fisheye as well, it leaves at most this part of the residuals of
/// every distorted pinhole: of the many lines of boards, ...
const MOST_LEFT_OF_BOARDS: f64 = 0.5;

/// ... and of squares, whose few sides its coefficients follow more easily.
pub(crate) const MOST_LEFT_OF_SQUARES: f64 = 0.25;

/// A model of a lens, and its fit to the edge samples.
pub(crate) type Fit<'a, L> = (<L as Lens>::Model, &'a Calibration<L>);

/// How the fisheye's models stand against those of a distorted pinhole: the best against the best.
pub(crate) struct Standing<'a, A: Lens, B: Lens> {
    pub wide: Fit<'a, A>,
    plain: Fit<'a, B>,
    /// Logarithm of the odds for the fisheye.
    pub odds: f64,
}

/// The fisheye that stands best; of equals the one with the largest evidence within its family. That
/// does not count what is unlikely of a fit, and need not be the best.
pub(crate) fn best_standing<'a, A: Lens, B: Lens>(
    edges: &[PlaneEdges],
    wide: &'a Weighed<A>,
    plain: &'a Weighed<B>,
) -> Standing<'a, A, B> {
    let has_boards = have_boards(edges);
    let start = standing(has_boards, wide.chosen(), plain);
    let of_all = wide.fits().map(|own| standing(has_boards, own, plain));
    of_all.fold(start, |best, next| match next.odds > best.odds {
        true => next,
        false => best,
    })
}

/// One fisheye against every distorted pinhole: the odds are less the preference and what is unlikely
/// of it beforehand. Where sides err together under it as well (targets that are not flat), its
/// coefficients follow these, and it has to leave much less than every one.
///
/// Targets that are no squares are followed by coefficients that no lens has, or by a camera as
/// hardly any is: then they are the likelier cause, unless there are boards, whose many lines hold
/// their shape.
fn standing<'a, A: Lens, B: Lens>(
    has_boards: bool,
    wide: Fit<'a, A>,
    plain: &'a Weighed<B>,
) -> Standing<'a, A, B> {
    let fit = wide.1;
    let odds = |other| log_odds(wide, other);
    let against = plain.fits();
    let against = against.min_by(|one, other| odds(*one).total_cmp(&odds(*other)));
    let against = against.unwrap_or(plain.chosen());
    let odds = odds(against) - PREFERENCE - improbability(fit);
    let least = plain.fits().map(|(_, other)| other.rms);
    let most_left = match has_boards {
        true => MOST_LEFT_OF_BOARDS,
        false => MOST_LEFT_OF_SQUARES,
    };
    let explains = is_clean(fit) || fit.rms < most_left * least.fold(f64::INFINITY, f64::min);
    let follows_targets =
        || !unlikely_camera(fit, Fixed::default(), |_| None).is_empty() && !has_boards;
    let odds = match explains && !follows_targets() {
        true => odds,
        false => odds.min(0.0),
    };
    Standing {
        wide,
        plain: against,
        odds,
    }
}

fn have_boards(edges: &[PlaneEdges]) -> bool {
    let planes = sort_by_plane(edges).unwrap_or_default();
    planes.iter().flat_map(|plane| &plane.figures).any(has_grid)
}

/// Minus the logarithm of the prior density of a lens's coefficients, over that of none: normal, as
/// wide as where a calibration is held by it.
fn improbability<L: Lens>(fit: &Calibration<L>) -> f64 {
    let usual = fit.camera.coefficient_priors(fit.image_size);
    let values = fit.camera.parameters();
    let squares = values[INTRINSICS..].iter().zip(&usual);
    squares
        .map(|(value, std)| 0.5 * (value / (PRIOR_SLACK * std)).powi(2))
        .sum()
}

/// Whether the residuals of the samples show no sides that err together.
pub(crate) fn is_clean<L: Lens>(fit: &Calibration<L>) -> bool {
    fit.residual_correlation.probability < 0.5
}

/// Whether the picture's corners are imaged as far out as a fisheye would, rather than a pinhole, and
/// see so far from the axis that both are told apart by more than noise.
///
/// The radius is the angle for one and its tangent for the other.
pub(crate) fn bends_as_a_fisheye<L: Lens>(fit: &Calibration<L>) -> bool {
    let lens = &fit.camera;
    let bends = |corner: &Vector2<f64>| {
        lens.unproject(corner).is_none_or(|ray| {
            let radius = (lens.inverse_focal_matrix() * (corner - lens.principal_point())).norm();
            let angle = ray.xy().norm().atan2(ray.z);
            // What lies beside the camera or behind it no pinhole sees.
            angle > WIDE && radius < 0.5 * (angle + angle.min(FRAC_PI_2).tan())
        })
    };
    fit.image_size.corners().iter().any(bends)
}

/// Logarithm of the odds of one model's fit against another's. Where sides err together under the
/// better one, they count by their smooth displacements, however many samples show them.
fn log_odds<A: Lens, B: Lens>((model, one): Fit<'_, A>, (other_model, other): Fit<'_, B>) -> f64 {
    let samples: usize = one.planes.iter().map(|plane| plane.samples).sum();
    let sides: usize = one.residuals.iter().map(|figure| figure.sides.len()).sum();
    let count_of = |neighbours: f64, is_clean: bool| {
        let independent = samples as f64 / neighbours.max(1.0);
        match is_clean {
            true => independent,
            false => independent.min((ORDERS * sides) as f64),
        }
    };
    let independent = match one.rms < other.rms {
        true => count_of(one.residual_correlation.neighbours, is_clean(one)),
        false => count_of(other.residual_correlation.neighbours, is_clean(other)),
    };
    let independent = independent.max(1.0);
    let [count, others] = [model.columns(), other_model.columns()].map(|own| own.iter().count());
    let further = count as f64 - others as f64;
    independent * (other.rms / one.rms).ln() - 0.5 * further * independent.ln()
}

/// Parameters that mean the same in both families.
const SHARED: [&str; 5] = ["fx", "fy", "cx", "cy", SKEW];

/// Adds to a covariance what another family's answer is off by, and by how much it is less certain,
/// times that one's probability. How certain it is, the model says that its family chose.
fn add_doubt<A: Lens, B: Lens>(
    found: &mut Calibration<A>,
    other: &Calibration<B>,
    (family, options): (&Weighed<B>, &Options<B>),
    odds: f64,
) {
    let probability = 1.0 / (1.0 + (-odds).exp());
    let apart = other.camera.camera_matrix() - found.camera.camera_matrix();
    let entries = [apart.m11, apart.m22, apart.m13, apart.m23, apart.m12];
    let chosen = family.chosen().1;
    let mut difference = DVector::zeros(found.parameters.len());
    let (mut own, mut others) = (Vec::new(), Vec::new());
    for (name, entry) in SHARED.into_iter().zip(entries) {
        let Some(place) = found.position(name) else {
            continue;
        };
        difference[place] = entry;
        if let Some(same) = chosen.position(name) {
            own.push(place);
            others.push(same);
        }
    }
    let mut doubt = &difference * difference.transpose();
    let part =
        |all: &DMatrix<f64>, places: &[usize]| all.select_rows(places).select_columns(places);
    let (to, from) = (family.covariance(options), &found.covariance);
    if let Some(raised) = raising_part(part(&to, &others), &part(from, &own)) {
        let size = difference.len();
        let spread = DMatrix::<f64>::identity(size, size).select_columns(&own);
        doubt += &spread * raised * spread.transpose();
    }
    widen(found, doubt * probability, options.fixed);
}

fn rejected<L: Lens>((model, fit): Fit<'_, L>, log_evidence: f64) -> RejectedFamily {
    RejectedFamily {
        model: model.name(),
        log_evidence,
        rms: fit.rms,
    }
}
