//! Fraction of a pixel that a blurred square covers.

use crate::numeric::{BivariateNormal, cdf, cdf_and_pdf};

/// Distance, in blurs, beyond which an edge is at its plateau: Phi(-3.8) is 7e-5 of the contrast, a
/// hundredth of a grey level.
pub(crate) const PLATEAU: f64 = 3.8;

/// Coverage of a pixel by a square with the near sides: the covered part `C` and its derivatives by
/// the distances, in blurs, to the (at most two) sides that cut it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Coverage {
    pub value: f64,
    /// Index of the cutting side and the derivative, for up to two sides.
    pub cuts: [(usize, f64); 2],
    pub cut_count: usize,
    /// Derivative by the logarithm of the blur at constant distances in blurs: the blur's kurtosis
    /// changes with it.
    pub by_log_blur: f64,
    /// Derivative by the kurtosis of the blur across the cutting side, if that is the only one.
    pub by_kurtosis: f64,
}

/// The kurtosis of the blur across the sides.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kurtosis {
    /// Of the pixel's own box, across each side.
    pub of_box: [f64; 4],
    /// Contribution of the lens, the same across all of them.
    pub of_lens: f64,
}

/// Two blurred sides that meet at a corner: their correlation is the cosine between their inward
/// normals.
#[derive(Debug, Clone)]
pub(crate) struct Corner {
    correlation: f64,
    /// Standard deviation of one given the other.
    across: f64,
    joint: BivariateNormal,
}

impl Corner {
    /// The corner of sides with this cosine between their inward normals.
    pub fn new(correlation: f64) -> Self {
        Self {
            correlation,
            across: (1.0 - correlation * correlation).sqrt().max(0.1),
            joint: BivariateNormal::new(correlation),
        }
    }

    /// The part inside both sides at distances in blurs, and its derivatives by these.
    fn coverage(&self, [a, b]: [f64; 2]) -> (f64, [f64; 2]) {
        let conditional = |h: f64, k: f64| {
            let (_, density) = cdf_and_pdf(h);
            density * cdf((k - self.correlation * h) / self.across)
        };
        (self.joint.cdf(a, b), [conditional(a, b), conditional(b, a)])
    }
}

/// Full or no coverage.
#[inline]
pub(crate) fn plateau(inside: bool) -> Coverage {
    Coverage {
        value: f64::from(u8::from(inside)),
        ..Coverage::default()
    }
}

/// The covered part at distances `z` (in blurs, positive inside) to the sides of `near`.
///
/// A side alone covers `Phi(z) - k (z^3 - 3 z) phi(z)`, with `k` the kurtosis of its blur (the
/// first term of Edgeworth's series). Two that meet at a corner cover the bivariate normal
/// distribution with the correlation of their inward normals: a Gaussian-blurred wedge.
/// `corners[i]` is that of sides `i - 1` and `i`. A pixel between two opposite sides takes their
/// product.
#[inline(always)]
pub(crate) fn coverage(
    near: u8,
    z: &[f64; 4],
    kurtosis: &Kurtosis,
    corners: &[Corner; 4],
) -> Coverage {
    let mut cutting = [0; 4];
    let mut count = 0;
    for side in 0..4 {
        if near & (1 << side) == 0 || z[side] > PLATEAU {
            continue;
        }
        if z[side] < -PLATEAU {
            return plateau(false);
        }
        cutting[count] = side;
        count += 1;
    }
    match count {
        0 => plateau(true),
        1 => {
            let (z, of_box) = (z[cutting[0]], kurtosis.of_box[cutting[0]]);
            let (value, density) = cdf_and_pdf(z);
            let square = z * z;
            let by_kurtosis = z * (3.0 - square) * density;
            let kurtosis = of_box + kurtosis.of_lens;
            let slope = 1.0 + kurtosis * (square * (square - 6.0) + 3.0);
            Coverage {
                value: value + kurtosis * by_kurtosis,
                cuts: [(cutting[0], density * slope), (0, 0.0)],
                cut_count: 1,
                by_log_blur: -4.0 * of_box * by_kurtosis,
                by_kurtosis,
            }
        }
        // With three sides at one pixel the square is as small as its blur: the first two are used,
        // and the robust loss absorbs the rest.
        _ => coverage_by_two([cutting[0], cutting[1]], z, corners),
    }
}

/// The coverage of two sides.
#[inline(never)]
fn coverage_by_two([a, b]: [usize; 2], z: &[f64; 4], corners: &[Corner; 4]) -> Coverage {
    let pair = [z[a], z[b]];
    let (value, [by_a, by_b]) = match (a, b) {
        (0, 3) => corners[0].coverage(pair),
        (a, b) if b == a + 1 => corners[b].coverage(pair),
        _ => {
            let [(part_a, density_a), (part_b, density_b)] = pair.map(cdf_and_pdf);
            (part_a * part_b, [density_a * part_b, density_b * part_a])
        }
    };
    Coverage {
        value,
        cuts: [(a, by_a), (b, by_b)],
        cut_count: 2,
        ..Coverage::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::box_kurtosis;
    use nalgebra::Vector2;

    fn corners(correlation: f64) -> [Corner; 4] {
        std::array::from_fn(|_| Corner::new(correlation))
    }

    fn of_box(of_box: [f64; 4]) -> Kurtosis {
        Kurtosis {
            of_box,
            of_lens: 0.0,
        }
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        for (near, rho) in [
            (0b0001, 0.0),
            (0b0011, 0.4),
            (0b1001, -0.5),
            (0b0110, 0.2),
            (0b0101, 0.3),
        ] {
            let z = [0.3, -0.6, 0.9, 0.2];
            let kurtosis = Kurtosis {
                of_box: [-0.003, 0.002, -0.001, 0.004],
                of_lens: -0.002,
            };
            let corners = corners(rho);
            let value = |z: &[f64; 4]| coverage(near, z, &kurtosis, &corners).value;
            let found = coverage(near, &z, &kurtosis, &corners);
            for (side, derivative) in &found.cuts[..found.cut_count] {
                let h = 1e-4;
                let (mut up, mut down) = (z, z);
                up[*side] += h;
                down[*side] -= h;
                let expected = (value(&up) - value(&down)) / (2.0 * h);
                assert!((derivative - expected).abs() < 1e-6, "{near:b} {side}");
            }
        }
    }

    /// Compares with the exact convolution of a box with a normal blur.
    #[test]
    fn the_box_of_a_pixel_is_modelled() {
        let lens = 0.5;
        let blur = f64::sqrt(lens * lens + 1.0 / 12.0);
        let kurtosis = box_kurtosis(&Vector2::new(1.0, 0.0), blur);
        let (mut worst, mut worst_normal) = (0.0_f64, 0.0_f64);
        for step in -12_i32..=12 {
            let distance = 0.15 * f64::from(step);
            // The mean of a normal edge over the pixel, by the midpoint rule.
            let parts = 200;
            let exact = (0..parts)
                .map(|i| cdf((distance + (f64::from(i) + 0.5) / f64::from(parts) - 0.5) / lens))
                .sum::<f64>()
                / f64::from(parts);
            let mut z = [0.0; 4];
            z[0] = distance / blur;
            let modelled = coverage(1, &z, &of_box([kurtosis; 4]), &corners(0.0)).value;
            worst = worst.max((modelled - exact).abs());
            worst_normal = worst_normal.max((cdf(z[0]) - exact).abs());
        }
        // The next term of the series, that of the sixth cumulant, is a fifth of this one here.
        assert!(worst_normal > 2e-3 && worst < 0.2 * worst_normal, "{worst}");
    }

    #[test]
    fn plateaus_are_flat() {
        let inside = coverage(
            0b0011,
            &[4.0, 6.0, 0.0, 0.0],
            &of_box([0.0; 4]),
            &corners(0.0),
        );
        assert_eq!((inside.value, inside.cut_count), (1.0, 0));
        let outside = coverage(
            0b0011,
            &[-5.0, 0.0, 0.0, 0.0],
            &of_box([0.0; 4]),
            &corners(0.0),
        );
        assert_eq!((outside.value, outside.cut_count), (0.0, 0));
    }
}
