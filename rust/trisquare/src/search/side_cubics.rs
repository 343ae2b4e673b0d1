//! Cubics through points along sides, regularised to the distortion of lenses, and robust against
//! strays.

use nalgebra::{Matrix4, Vector4};

use crate::numeric::median;

/// Standard deviation of an edge position, pixels.
const POINT_NOISE: f64 = 0.2;

/// Distance of contour points from their side's first cubic above which they follow an object that
/// hides the edge, in medians and at least in pixels. The cubic is fitted again without them, at
/// most the given number of times, since at first they bias it.
const STRAY_MEDIANS: f64 = 2.5;
const STRAY_PIXELS: f64 = 1.5;
const TRIMMINGS: usize = 4;

/// Expected size of a side's offset, slope, quadratic and cubic term, over the chord: the first two
/// are free, the others those of strong distortion.
const EXPECTED_TERMS: Vector4<f64> = Vector4::new(1e3, 1e3, 0.02, 0.003);

/// Same while the points may include a piece of contour that is not on the edge, so that the curve
/// does not follow it.
const STIFF_TERMS: Vector4<f64> = Vector4::new(1e3, 1e3, 0.002, 0.0003);

/// Points along one side.
#[derive(Debug, Clone)]
pub struct SidePoints {
    /// Powers, 0 to 3, of their positions along the chord.
    pub basis: Vec<Vector4<f64>>,
    /// Offsets from the chord, pixels.
    pub offsets: Vec<f64>,
    /// Whether each point is used.
    pub used: Vec<bool>,
    /// Length of the chord, pixels.
    pub length: f64,
}

impl SidePoints {
    /// The coefficients of the cubic through the points that are used, by least squares.
    ///
    /// A lens bends short sides little, and a free curvature would diverge at their ends, where
    /// nothing was measured; hence each coefficient has a prior with its expected size.
    #[must_use]
    pub fn cubic(&self) -> Vector4<f64> {
        self.fitted(&self.used, EXPECTED_TERMS)
    }

    fn fitted(&self, used: &[bool], terms: Vector4<f64>) -> Vector4<f64> {
        let prior = terms.map(|term| (POINT_NOISE / (term * self.length)).powi(2));
        let (mut normal, mut right) = (Matrix4::from_diagonal(&prior), Vector4::zeros());
        let points = self.basis.iter().zip(&self.offsets).zip(used);
        for ((basis, offset), _) in points.filter(|(_, used)| **used) {
            normal += basis * basis.transpose();
            right += basis * *offset;
        }
        let undetermined = Vector4::repeat(f64::NAN);
        normal.lu().solve(&right).unwrap_or(undetermined)
    }

    fn residuals(&self, cubic: &Vector4<f64>) -> Vec<f64> {
        let points = self.basis.iter().zip(&self.offsets);
        points.map(|(b, o)| (o - b.dot(cubic)).abs()).collect()
    }

    fn has_strays(&self, cubic: &Vector4<f64>) -> bool {
        let residuals = self.residuals(cubic);
        let mut used = residuals.iter().zip(&self.used).filter(|(_, used)| **used);
        !used.all(|(gap, _)| *gap < STRAY_PIXELS)
    }

    fn trimmed_cubic(&self) -> Vector4<f64> {
        let mut kept = self.used.clone();
        let mut cubic = Vector4::zeros();
        for terms in [STIFF_TERMS, EXPECTED_TERMS] {
            cubic = self.fitted(&kept, terms);
            for _ in 0..TRIMMINGS {
                let residuals = self.residuals(&cubic);
                let limit =
                    (STRAY_MEDIANS * median(residuals.clone()).unwrap_or(0.0)).max(STRAY_PIXELS);
                let near = self.used.iter().zip(&residuals);
                let next: Vec<bool> = near.map(|(used, gap)| *used && *gap < limit).collect();
                if next == kept {
                    break;
                }
                kept = next;
                cubic = self.fitted(&kept, terms);
            }
        }
        cubic
    }
}

/// Cubics through the points of several sides, without those that stray from most of their side's
/// points; if no side has any strays, all points are used.
#[must_use]
pub fn trimmed_cubics(sides: &[SidePoints]) -> Vec<Vector4<f64>> {
    let cubics: Vec<_> = sides.iter().map(SidePoints::cubic).collect();
    let mut pairs = sides.iter().zip(&cubics);
    if pairs.any(|(side, cubic)| side.has_strays(cubic)) {
        sides.iter().map(SidePoints::trimmed_cubic).collect()
    } else {
        cubics
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTH: f64 = 100.0;
    /// The prior on a lens's bending reduces the cubic term, and changes the slope with it, so that
    /// the term is zero here.
    const TRUTH: Vector4<f64> = Vector4::new(1.0, -2.0, 1.5, 0.0);

    fn side() -> SidePoints {
        let place = |index: i32| -1.0 + 2.0 * f64::from(index) / 31.0;
        let basis: Vec<_> = (0..32)
            .map(|index| Vector4::from_fn(|k, _| place(index).powi(k as i32)))
            .collect();
        SidePoints {
            offsets: basis.iter().map(|b| b.dot(&TRUTH)).collect(),
            basis,
            used: vec![true; 32],
            length: LENGTH,
        }
    }

    #[test]
    fn points_on_a_cubic_give_it() {
        assert!((side().cubic() - TRUTH).amax() < 0.01);
        assert_eq!(trimmed_cubics(&[side()]), [side().cubic()]);
    }

    #[test]
    fn a_run_of_strays_does_not_pull_the_cubic() {
        let mut bitten = side();
        for offset in &mut bitten.offsets[8..13] {
            *offset += 6.0;
        }
        let [found, other] = trimmed_cubics(&[bitten.clone(), side()])[..] else {
            unreachable!()
        };
        assert!((found - TRUTH).amax() < 0.1 && (other - TRUTH).amax() < 0.1);
        assert!((bitten.cubic() - TRUTH).amax() > 0.5);
    }

    #[test]
    fn unused_points_and_no_points_are_no_harm() {
        let mut few = side();
        few.offsets[3] = f64::NAN;
        few.used[3] = false;
        assert!((few.cubic() - TRUTH).amax() < 0.01);
        few.used.fill(false);
        assert!(few.cubic().amax() < 1e-9);
        assert!(trimmed_cubics(&[]).is_empty());
    }
}
