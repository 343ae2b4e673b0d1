//! How much of a pixel a blurred square covers.

use crate::normal::{bivariate_cdf, cdf, cdf_and_pdf};

/// Beyond so many blurs an edge is at its plateau: Phi(-3.8) is 7e-5 of the contrast, a hundredth
/// of a grey level.
pub(crate) const PLATEAU: f64 = 3.8;

/// What the near sides make of a pixel: the covered part `C` and its derivatives by the
/// distances, in blurs, to the (at most two) sides that cut it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Coverage {
    pub value: f64,
    /// Index of the cutting side and the derivative, for up to two sides.
    pub cuts: [(usize, f64); 2],
    pub cut_count: usize,
}

/// All or nothing.
pub(crate) fn plateau(inside: bool) -> Coverage {
    Coverage {
        value: f64::from(u8::from(inside)),
        ..Coverage::default()
    }
}

/// The covered part at distances `z` (in blurs, positive inside) to the sides of `near`.
///
/// A side alone covers `Phi(z)`. Two that meet at a corner cover the bivariate normal
/// distribution with the correlation of their inward normals: a Gaussian-blurred wedge.
/// `corner_correlation(i)` is that of sides `i - 1` and `i`. A pixel between two opposite sides
/// takes their product.
pub(crate) fn coverage(
    near: u8,
    z: &[f64; 4],
    corner_correlation: impl Fn(usize) -> f64,
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
            let (value, density) = cdf_and_pdf(z[cutting[0]]);
            Coverage {
                value,
                cuts: [(cutting[0], density), (0, 0.0)],
                cut_count: 1,
            }
        }
        // With three sides at one pixel the square is as small as its blur: the first two stand
        // for it, and the robust loss takes the rest.
        _ => {
            let (a, b) = (cutting[0], cutting[1]);
            let rho = match (a, b) {
                (0, 3) => corner_correlation(0),
                (a, b) if b == a + 1 => corner_correlation(b),
                _ => 0.0,
            };
            let across = (1.0 - rho * rho).sqrt().max(0.1);
            let (za, zb) = (z[a], z[b]);
            let (_, density_a) = cdf_and_pdf(za);
            let (_, density_b) = cdf_and_pdf(zb);
            Coverage {
                value: bivariate_cdf(za, zb, rho),
                cuts: [
                    (a, density_a * cdf((zb - rho * za) / across)),
                    (b, density_b * cdf((za - rho * zb) / across)),
                ],
                cut_count: 2,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_central_differences() {
        for (near, rho) in [(0b0001, 0.0), (0b0011, 0.4), (0b1001, -0.5), (0b0110, 0.2)] {
            let z = [0.3, -0.6, 0.9, 0.2];
            let value = |z: &[f64; 4]| coverage(near, z, |_| rho).value;
            let found = coverage(near, &z, |_| rho);
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

    #[test]
    fn plateaus_are_flat() {
        let inside = coverage(0b0011, &[4.0, 6.0, 0.0, 0.0], |_| 0.0);
        assert_eq!((inside.value, inside.cut_count), (1.0, 0));
        let outside = coverage(0b0011, &[-5.0, 0.0, 0.0, 0.0], |_| 0.0);
        assert_eq!((outside.value, outside.cut_count), (0.0, 0));
    }
}
