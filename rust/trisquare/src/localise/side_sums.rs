//! Sums over the pixels of a side of products of derivatives that are polynomials along it.

use nalgebra::{SMatrix, SVector};

use super::curve::COEFFICIENTS;
use crate::numeric::add_rank_one;

/// Number of coefficients of light and blur along a side, in powers of `s`.
pub(super) const LIGHT: usize = 3;
/// Length of a bin along a side, pixels.
pub(super) const BIN_LENGTH: f64 = 8.0;
const POWERS: usize = 2 * COEFFICIENTS - 1;

/// The degrees in `s` of a side's parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Degrees {
    pub curve: usize,
    pub light: usize,
    pub blur: usize,
}

/// Degree in `s` of the factors of a basic derivative: height, base, contrast, blur, and any other.
const fn degree(column: usize) -> usize {
    match column {
        0 => COEFFICIENTS - 1,
        1..=3 => LIGHT - 1,
        _ => 0,
    }
}

/// Sums of the products of `N` columns: the basic derivatives with respect to height, base,
/// contrast, blur and any others, and last the residual.
///
/// Every parameter's derivative is a basic one times a power of `s`, which hardly varies within a
/// bin. The sums of the bins' products times the powers contain each distinct entry once.
pub(super) struct SideSums<const N: usize> {
    /// The lower triangle, for each power of `s`.
    products: [[[f64; POWERS]; N]; N],
}

/// Sums over a few columns of pixels.
struct Bin<const N: usize> {
    number: i32,
    count: f64,
    s: f64,
    products: [[f64; N]; N],
}

impl<const N: usize> Bin<N> {
    fn empty(number: i32) -> Self {
        Self {
            number,
            count: 0.0,
            s: 0.0,
            products: [[0.0; N]; N],
        }
    }
}

impl<const N: usize> SideSums<N> {
    /// The sums over pixels, each with its `s`, a weight and its row, in bins that are numbered
    /// from `first`, which is before any pixel.
    #[inline(always)]
    pub fn of(
        pixels: impl Iterator<Item = (f64, f64, [f64; N])>,
        bins_per_s: f64,
        first: f64,
    ) -> Self {
        let mut sums = Self {
            products: [[[0.0; POWERS]; N]; N],
        };
        // Pixels are nearly in order along the side, so that one open bin suffices.
        let mut open = Bin::empty(i32::MIN);
        for (s, weight, row) in pixels {
            let number = (s * bins_per_s - first) as i32;
            if number != open.number {
                sums.add(&open);
                open = Bin::empty(number);
            }
            open.count += 1.0;
            open.s += s;
            add_rank_one(&mut open.products, &row, weight);
        }
        sums.add(&open);
        sums
    }

    fn add(&mut self, bin: &Bin<N>) {
        if bin.count == 0.0 {
            return;
        }
        let s = bin.s / bin.count;
        let mut powers = [1.0; POWERS];
        for k in 1..POWERS {
            powers[k] = powers[k - 1] * s;
        }
        for i in 0..N {
            for j in 0..=i {
                let (sums, product) = (&mut self.products[i][j], bin.products[i][j]);
                let sums = &mut sums[..=degree(i) + degree(j)];
                for (sum, power) in sums.iter_mut().zip(&powers) {
                    *sum += product * power;
                }
            }
        }
    }

    /// The sums of products of all parameters' derivatives, in their order, and of each with the
    /// residual. Coefficients beyond their degrees have rows and columns of the identity.
    pub fn assembled<const M: usize>(
        &self,
        degrees: Degrees,
    ) -> (SMatrix<f64, M, M>, SVector<f64, M>) {
        let mut sources = [(N - 1, 0); M];
        let all = (0..N - 1).flat_map(|column| (0..=degree(column)).map(move |k| (column, k)));
        sources.iter_mut().zip(all).for_each(|(own, of)| *own = of);
        let is_unused = |parameter: usize| match sources[parameter] {
            (0, power) => power > degrees.curve,
            (1 | 2, power) => power > degrees.light,
            (3, power) => power > degrees.blur,
            _ => false,
        };
        let product = |(i, k): (usize, usize), (j, l): (usize, usize)| {
            self.products[i.max(j)][i.min(j)][k + l]
        };
        let matrix = SMatrix::from_fn(|i, j| match is_unused(i) || is_unused(j) {
            true => f64::from(u8::from(i == j)),
            false => product(sources[i], sources[j]),
        });
        let right = SVector::from_fn(|i, _| match is_unused(i) {
            true => 0.0,
            false => product(sources[i], (N - 1, 0)),
        });
        (matrix, right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sums_are_those_of_each_parameter_s_derivative() {
        const PARAMETERS: usize = 15;
        let mut pixels = Vec::new();
        let mut normal = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        let mut right = SVector::<f64, PARAMETERS>::zeros();
        for index in 0..9000 {
            let s = f64::from(index) / 4500.0 - 1.0;
            let row: [f64; 6] = std::array::from_fn(|k| (0.7 * f64::from(index) + k as f64).sin());
            let weight = 1.0 + 0.5 * s;
            pixels.push((s, weight, row));
            let [height, base, contrast, blur, other, residual] = row;
            let mut all: [f64; PARAMETERS] = [0.0; PARAMETERS];
            for k in 0..COEFFICIENTS {
                all[k] = height * s.powi(k as i32);
            }
            all[COEFFICIENTS..].copy_from_slice(&[
                base,
                base * s,
                base * s * s,
                contrast,
                contrast * s,
                contrast * s * s,
                blur,
                blur * s,
                blur * s * s,
                other,
            ]);
            let all = SVector::from(all);
            normal += weight * all * all.transpose();
            right += weight * residual * all;
        }
        let sums = SideSums::of(pixels.into_iter(), 60.0, -240.0);
        let (found, found_right) = sums.assembled::<PARAMETERS>(Degrees {
            curve: COEFFICIENTS - 1,
            light: LIGHT - 1,
            blur: LIGHT - 1,
        });
        // Up to the error from the length of a bin.
        assert!((found - normal).abs().max() < 1e-3 * normal.abs().max());
        assert!((found_right - right).abs().max() < 1e-3 * right.abs().max());
    }
}
