//! Approximation of a lens by the nearest lens of a family with fewer or other terms.

use nalgebra::{DMatrix, DVector, Vector2};

use super::distortion::DistortionTerm;
use super::radial::sign_changes;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::numeric::{ArrowStep, ArrowSystem, Limits, Problem, minimise};

/// Number of grid lines over the picture's longer side: enough for polynomials of the 7th degree.
/// The grid includes the borders, where lenses differ most.
const GRID_LINES: f64 = 41.0;

/// Minimum fraction of the picture in which a lens must have a direction for another one to be
/// fitted.
const MIN_SEEN: f64 = 0.5;

/// Limits of the iteration. The problem is nearly linear: a few steps suffice.
const LIMITS: Limits = Limits {
    iterations: 200,
    decrease: 1e-18,
};

/// Family of lenses `f (u + sum c_i s_i(u)) + c` with the terms `s_i`.
#[derive(Debug, Clone, PartialEq)]
pub struct LensFamily {
    /// Name in messages.
    pub name: String,
    /// Whether both axes have the same focal length.
    pub square_pixels: bool,
    /// The terms whose coefficients are free.
    pub terms: Vec<DistortionTerm>,
}

/// The lens of a family that is nearest to another lens.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct NearestLens {
    /// `fx, fy`, pixels.
    pub focal: Vector2<f64>,
    /// Principal point, pixels.
    pub centre: Vector2<f64>,
    /// The coefficients of the family's terms.
    pub coefficients: Vec<f64>,
    /// Root mean square distance of the two projections, pixels.
    pub rms: f64,
    /// Largest distance of the two projections, pixels.
    pub worst: f64,
    /// Fraction of the picture in which the other lens has a direction.
    pub covered: f64,
}

impl LensFamily {
    /// Finds the lens whose projections are nearest to another lens's over the picture, by least
    /// squares of pixels.
    ///
    /// `ideal_point` returns the ideal normalised point that the other lens sees at a pixel. Both
    /// lenses have the same axis: no rotation is fitted, so that poses stay valid. The iteration
    /// starts from `focal` and `centre` (pixels).
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if less than half the picture has directions ahead of the camera,
    /// or the nearest lens folds back within it.
    pub fn nearest(
        &self,
        size: ImageSize,
        focal: Vector2<f64>,
        centre: Vector2<f64>,
        ideal_point: impl Fn(&Vector2<f64>) -> Option<Vector2<f64>>,
    ) -> Result<NearestLens, Error> {
        let pixels = grid(size)?;
        let pairs = pixels
            .iter()
            .filter_map(|pixel| Some((ideal_point(pixel)?, *pixel)));
        let pairs: Vec<_> = pairs.collect();
        let covered = pairs.len() as f64 / pixels.len() as f64;
        if covered < MIN_SEEN {
            return Err(Error::InvalidArgument(format!(
                "only {:.0} % of the picture shows directions in front of the camera: no other \
                 lens model can be fitted to this lens",
                100.0 * covered
            )));
        }
        let start = NearestLens {
            focal: match self.square_pixels {
                true => Vector2::repeat(focal.mean()),
                false => focal,
            },
            centre,
            coefficients: vec![0.0; self.terms.len()],
            rms: 0.0,
            worst: 0.0,
            covered,
        };
        let fit = NearestFit {
            family: self,
            pairs: &pairs,
        };
        let found = minimise(&fit, start, LIMITS).map(|minimum| minimum.state);
        let found = found
            .filter(|lens| !self.may_fold(lens, &pairs))
            .ok_or_else(|| {
                Error::InvalidArgument(format!(
                    "no lens of the model {} is near this lens: the nearest turns back within the \
                     picture",
                    self.name
                ))
            })?;
        let squared_errors = pairs
            .iter()
            .map(|(u, pixel)| (self.project(&found, u).1 - pixel).norm_squared());
        let (sum, largest) =
            squared_errors.fold((0.0, 0.0f64), |(sum, largest), v| (sum + v, largest.max(v)));
        Ok(NearestLens {
            rms: (sum / pairs.len() as f64).sqrt(),
            worst: largest.sqrt(),
            ..found
        })
    }

    /// Returns the observed normalised point and the pixel of an ideal point.
    fn project(&self, lens: &NearestLens, ideal: &Vector2<f64>) -> (Vector2<f64>, Vector2<f64>) {
        let terms = self.terms.iter().zip(&lens.coefficients);
        let observed = terms.fold(*ideal, |sum, (term, c)| sum + term.shift(ideal) * *c);
        (observed, observed.component_mul(&lens.focal) + lens.centre)
    }

    /// Whether the distortion may fold back within the radius of the farthest point: see
    /// [`invertible_radius`](super::invertible_radius).
    fn may_fold(&self, lens: &NearestLens, pairs: &[(Vector2<f64>, Vector2<f64>)]) -> bool {
        let largest = pairs.iter().map(|(u, _)| u.norm()).fold(0.0, f64::max);
        let (mut across, mut along, mut eigenvalue_bound) =
            (vec![1.0, 0.0], vec![1.0, 0.0], 0.0f64);
        for (term, c) in self.terms.iter().zip(&lens.coefficients) {
            if let DistortionTerm::Radial(power) = *term {
                let power = power as usize;
                let degree = across.len().max(power + 1);
                across.resize(degree, 0.0);
                along.resize(degree, 0.0);
                across[power] += c;
                along[power] += (power + 1) as f64 * c;
            } else {
                eigenvalue_bound = eigenvalue_bound.hypot(6.0 * c);
            }
        }
        [across, along].iter_mut().any(|polynomial| {
            polynomial[1] -= eigenvalue_bound;
            !sign_changes(polynomial, largest).is_empty()
        })
    }
}

/// Returns the pixels of a grid over the picture from border to border.
fn grid(size: ImageSize) -> Result<Vec<Vector2<f64>>, Error> {
    size.check()?;
    let extent = size.centre() * 2.0;
    let spacing = extent.max().max(1.0) / (GRID_LINES - 1.0);
    let [x, y] = [extent.x, extent.y].map(|length| {
        let gaps = (length / spacing).round_ties_even().max(1.0);
        (0..=gaps as u32).map(move |i| length * (f64::from(i) / gaps))
    });
    Ok(y.flat_map(|y| x.clone().map(move |x| Vector2::new(x, y)))
        .collect())
}

/// Least-squares problem in pixels. Its parameters are `fx, fy` (or one focal length for both),
/// `cx, cy` and the coefficients.
struct NearestFit<'a> {
    family: &'a LensFamily,
    pairs: &'a [(Vector2<f64>, Vector2<f64>)],
}

impl NearestFit<'_> {
    fn focal_count(&self) -> usize {
        if self.family.square_pixels { 1 } else { 2 }
    }
}

impl Problem for NearestFit<'_> {
    type State = NearestLens;

    fn evaluate(&self, lens: &NearestLens) -> Option<(f64, ArrowSystem)> {
        let focals = self.focal_count();
        let count = focals + 2 + self.family.terms.len();
        let mut system = ArrowSystem::zeros(0, std::iter::once(count));
        let mut cost = 0.0;
        let mut rows = DMatrix::zeros(2, count);
        for (ideal, pixel) in self.pairs {
            let (observed, projected) = self.family.project(lens, ideal);
            let residual = projected - pixel;
            for axis in 0..2 {
                rows[(axis, axis.min(focals - 1))] = observed[axis];
                rows[(axis, focals + axis)] = 1.0;
            }
            for (i, term) in self.family.terms.iter().enumerate() {
                let shift = term.shift(ideal).component_mul(&lens.focal);
                rows.set_column(focals + 2 + i, &shift);
            }
            system.blocks[0].hessian += rows.tr_mul(&rows);
            system.blocks[0].gradient += rows.tr_mul(&residual);
            cost += 0.5 * residual.norm_squared();
        }
        cost.is_finite().then_some((cost, system))
    }

    fn advance(&self, lens: &NearestLens, step: &ArrowStep) -> NearestLens {
        let (family_step, focals): (&DVector<f64>, _) = (&step.blocks[0], self.focal_count());
        let coefficients = lens
            .coefficients
            .iter()
            .zip(family_step.iter().skip(focals + 2));
        NearestLens {
            focal: lens.focal + Vector2::new(family_step[0], family_step[focals - 1]),
            centre: lens.centre + Vector2::new(family_step[focals], family_step[focals + 1]),
            coefficients: coefficients.map(|(c, change)| c + change).collect(),
            ..*lens
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Fisheye, Lens, PointMaps};
    use super::*;

    const SIZE: ImageSize = ImageSize {
        width: 640,
        height: 480,
    };

    fn family(square_pixels: bool, names: &str) -> LensFamily {
        LensFamily {
            name: names.into(),
            square_pixels,
            terms: DistortionTerm::of_names(names).unwrap(),
        }
    }

    fn start() -> (Vector2<f64>, Vector2<f64>) {
        (Vector2::new(500.0, 510.0), Vector2::new(320.0, 240.0))
    }

    #[test]
    fn a_lens_of_the_family_is_found_again() {
        let truth = [520.0, 515.0, 310.0, 250.0, -0.25, 0.08, -0.01, 2e-3, -1e-3];
        let lens = Brown::new(truth);
        let ideal = |pixel: &Vector2<f64>| Some(lens.unproject_with_jacobian(pixel)?.ideal());
        let (focal, centre) = start();
        let found = family(false, "k1 k2 k3 p1 p2")
            .nearest(SIZE, focal, centre, ideal)
            .unwrap();
        let mut all = vec![found.focal.x, found.focal.y, found.centre.x, found.centre.y];
        all.extend(found.coefficients);
        for (found, expected) in all.iter().zip(truth) {
            assert!(
                (found - expected).abs() < 1e-7 * expected.abs().max(1.0),
                "{all:?}"
            );
        }
        assert!(found.worst < 1e-7 && found.covered == 1.0);
    }

    #[test]
    fn the_nearest_lens_has_no_neighbour_that_is_nearer() {
        let (focal, centre) = start();
        let fisheye = Fisheye::new([focal.x, focal.y, centre.x, centre.y, 0.02, -0.01, 0.0, 0.0]);
        let ideal = |pixel: &Vector2<f64>| fisheye.ideal_point(pixel);
        for (square, names) in [(true, "c b a"), (false, "k1 k2"), (true, "")] {
            let family = family(square, names);
            let found = family.nearest(SIZE, focal, centre, ideal).unwrap();
            let pixels = grid(SIZE).unwrap();
            let pairs: Vec<_> = pixels.iter().map(|p| (ideal(p).unwrap(), *p)).collect();
            let fit = NearestFit {
                family: &family,
                pairs: &pairs,
            };
            let (cost, system) = fit.evaluate(&found).unwrap();
            assert!((2.0 * cost / pairs.len() as f64 - found.rms.powi(2)).abs() < 1e-9 * found.rms);
            // No step of a single parameter decreases the cost noticeably.
            for i in 0..system.blocks[0].gradient.len() {
                let pull = system.blocks[0].gradient[i].powi(2) / system.blocks[0].hessian[(i, i)];
                assert!(pull < 1e-12 * cost.max(1e-9), "{names} {i} {pull} {cost}");
            }
        }
    }

    #[test]
    fn jacobian_agrees_with_central_differences() {
        let family = family(false, "k1 p1 p2 a");
        let lens = NearestLens {
            focal: Vector2::new(500.0, 520.0),
            centre: Vector2::new(300.0, 250.0),
            coefficients: vec![-0.1, 2e-3, -1e-3, 0.02],
            rms: 0.0,
            worst: 0.0,
            covered: 1.0,
        };
        let pairs = [(Vector2::new(0.3, -0.4), Vector2::new(500.0, 50.0))];
        let fit = NearestFit {
            family: &family,
            pairs: &pairs,
        };
        let (_, system) = fit.evaluate(&lens).unwrap();
        for i in 0..8 {
            let moved = |sign: f64| {
                let mut own = DVector::zeros(8);
                own[i] = sign * if i < 4 { 1e-3 } else { 1e-6 };
                let step = ArrowStep {
                    shared: DVector::zeros(0),
                    blocks: vec![own],
                    predicted_decrease: 0.0,
                };
                fit.evaluate(&fit.advance(&lens, &step)).unwrap().0
            };
            let numeric = (moved(1.0) - moved(-1.0)) / if i < 4 { 2e-3 } else { 2e-6 };
            let analytic = system.blocks[0].gradient[i];
            assert!(
                (numeric - analytic).abs() < 1e-6 * (1.0 + analytic.abs()),
                "{i}"
            );
        }
    }

    #[test]
    fn what_comes_near_nowhere_is_refused() {
        let (focal, centre) = start();
        let corner = |p: &Vector2<f64>| (p.x < 100.0).then(|| (p - centre).component_div(&focal));
        assert!(
            family(false, "")
                .nearest(SIZE, focal, centre, corner)
                .is_err()
        );
        // A distortion for which the nearest polynomial folds back within the picture.
        let folded = |p: &Vector2<f64>| Some((p - centre).component_div(&focal) * 2.0);
        let squeezed = |p: &Vector2<f64>| folded(p).map(|u| u * (1.0 + 4.0 * u.norm_squared()));
        assert!(
            family(false, "k1")
                .nearest(SIZE, focal, centre, squeezed)
                .is_err()
        );
    }
}
