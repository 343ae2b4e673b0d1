//! Displacement of the edges between two parts of a picture's pixels: the odd rows of an interlaced
//! picture, or the colours of a lens with lateral chromatic aberration.

use nalgebra::{SMatrix, SVector, Vector2};

use super::band::Pixel;
use super::prediction::Prediction;
use super::preview::Preview;
use super::side::SideModel;
use crate::image::GreyReader;

/// Number of parameters from a side's pixels: base (constant and linear along the side), contrast
/// and offset.
const TERMS: usize = 4;
const CONTRAST: usize = 2;
const OFFSET: usize = 3;
/// Number of parameters from all sides: a shift in x and y, a magnification about the picture's
/// middle, and a shift towards the dark by the coding.
const DISPLACEMENTS: usize = 4;
const MAGNIFICATION: usize = 2;
/// Minimum number of sides to determine these.
const MIN_SIDES: usize = 6;

/// Displacement of one part of the pixels against another.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PartDisplacement {
    /// Shift in x and y, pixels.
    pub shift: Vector2<f64>,
    /// The shift, in standard deviations.
    pub shift_deviations: f64,
    /// Relative enlargement of the part about the middle of the picture.
    pub magnification: f64,
    /// Standard deviation of the magnification.
    pub magnification_std: f64,
}

/// Sums of the normal equations over one side's pixels of one part.
#[derive(Clone, Copy, Default)]
struct PartSums {
    normal: SMatrix<f64, TERMS, TERMS>,
    right: SVector<f64, TERMS>,
    squares: f64,
    count: f64,
}

impl PartSums {
    fn add(&mut self, terms: &SVector<f64, TERMS>, value: f64) {
        self.normal += terms * terms.transpose();
        self.right += terms * value;
        self.squares += value * value;
        self.count += 1.0;
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            normal: self.normal + other.normal,
            right: self.right + other.right,
            squares: self.squares + other.squares,
            count: self.count + other.count,
        }
    }

    fn offset(&self) -> Option<Offset> {
        let (solution, variance) = self.solve()?;
        let value = solution[OFFSET];
        Some(Offset { value, variance })
    }

    /// The parameters, and the variance of the last one, the offset.
    fn solve(&self) -> Option<(SVector<f64, TERMS>, f64)> {
        let factor = self.normal.cholesky()?;
        let solution = factor.solve(&self.right);
        let freedom = self.count - TERMS as f64;
        if freedom < 1.0 {
            return None;
        }
        let noise = ((self.squares - solution.dot(&self.right)) / freedom).max(0.0);
        Some((solution, noise * factor.inverse()[(OFFSET, OFFSET)]))
    }
}

/// Position of an edge along its normal as one part of the pixels shows it, px, and its variance.
#[derive(Clone, Copy)]
struct Offset {
    value: f64,
    variance: f64,
}

/// Comparison of a side in two parts of its pixels.
struct SideOffset {
    normal: Vector2<f64>,
    /// Position relative to the picture's middle.
    place: Vector2<f64>,
    /// Offset along the normal of the second part relative to the first, px, and its variance.
    offset: f64,
    variance: f64,
    dark_sign: f64,
}

/// Displacement of the odd columns, as a fraction of that of the odd rows, above which the cause is
/// not interlacing, which displaces only rows, but enlargement or strong compression.
const MAX_COLUMN_RATIO: f64 = 0.5;
/// Number of standard deviations above which the columns are displaced.
const MIN_COLUMN_DEVIATIONS: f64 = 3.0;

/// Displacement of the odd rows against the even ones; `None` if there are too few sides, or if the
/// odd columns are displaced as well.
pub(super) fn rows<'a>(
    reader: &GreyReader<'_>,
    previews: impl Iterator<Item = &'a Preview>,
) -> Option<PartDisplacement> {
    let (mut by_row, mut by_column) = (Vec::new(), Vec::new());
    for preview in previews {
        let side = &preview.side;
        let [even, odd] = parity_sums(preview);
        let compared = |first: &[PartSums; 2], second: &[PartSums; 2]| {
            let offset = |parts: &[PartSums; 2]| parts[0].plus(&parts[1]).offset();
            SideOffset::of(reader, side, offset(first)?, offset(second)?)
        };
        by_column.extend(compared(&[even[0], odd[0]], &[even[1], odd[1]]));
        by_row.extend(compared(&even, &odd));
    }
    let rows = displacement(by_row.into_iter())?;
    let columns = displacement(by_column.into_iter());
    let are_displaced = |columns: PartDisplacement| {
        columns.shift_deviations > MIN_COLUMN_DEVIATIONS
            && columns.shift.norm() > MAX_COLUMN_RATIO * rows.shift.norm()
    };
    (!columns.is_some_and(are_displaced)).then_some(rows)
}

/// Sums over the pixels of even and of odd rows, each for even and for odd columns.
fn parity_sums(preview: &Preview) -> [[PartSums; 2]; 2] {
    let mut parts = [[PartSums::default(); 2]; 2];
    for (pixel, p) in single_pixels(preview) {
        // The remaining errors of the side's model, to first order.
        let terms = [p.by_base, p.by_base * pixel.s, p.by_contrast, p.by_offset];
        let [x, y] = pixel_place(&preview.side, pixel);
        parts[y % 2][x % 2].add(&SVector::from(terms), p.residual);
    }
    parts
}

/// Displacements of blue and of red against green, and the contrast in green as a fraction of the
/// largest; `None` for a grey picture, or if there are too few sides.
pub(super) fn colours<'a>(
    reader: &GreyReader<'_>,
    previews: impl Iterator<Item = &'a Preview>,
) -> Option<ColourDisplacements> {
    if reader.picture().channels() != 3 {
        return None;
    }
    let mut contrasts = [0.0; 3];
    let mut sides = [Vec::new(), Vec::new()];
    for preview in previews {
        let side = &preview.side;
        let mut parts = [(); 3].map(|()| PartSums::default());
        for (pixel, p) in single_pixels(preview) {
            let [x, y] = pixel_place(side, pixel);
            // Each colour's light has its own base and contrast.
            let (step, by_offset) = side.step_fraction(pixel, p);
            let terms = SVector::from([1.0, pixel.s, step, by_offset]);
            for (part, light) in parts.iter_mut().zip(reader.lights(x, y)) {
                part.add(&terms, light);
            }
        }
        let offsets = [0, 1, 2].map(|colour| {
            let (solution, variance) = parts[colour].solve()?;
            let contrast = solution[CONTRAST];
            contrasts[colour] += contrast.abs();
            let value = solution[OFFSET] / contrast;
            let variance = variance / (contrast * contrast);
            Some(Offset { value, variance })
        });
        let [Some(blue), Some(green), Some(red)] = offsets else {
            continue;
        };
        for (sides, offset) in sides.iter_mut().zip([blue, red]) {
            sides.extend(SideOffset::of(reader, side, green, offset));
        }
    }
    let [blue, red] = sides.map(|sides| displacement(sides.into_iter()));
    let greatest = contrasts.iter().copied().fold(0.0, f64::max);
    Some(ColourDisplacements {
        blue: blue?,
        red: red?,
        green_contrast: contrasts[1] / greatest,
    })
}

/// Displacements of blue and of red against green.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ColourDisplacements {
    /// Displacement of blue relative to green.
    pub blue: PartDisplacement,
    /// Displacement of red relative to green.
    pub red: PartDisplacement,
    /// Contrast of the edges in green, as a fraction of that in the colour where it is largest.
    pub green_contrast: f64,
}

/// The pixels of a preview that are neither averages nor clipped.
fn single_pixels(preview: &Preview) -> impl Iterator<Item = (&Pixel, &Prediction)> {
    let pixels = preview.pixels.iter().zip(&preview.predictions);
    pixels.filter(|(pixel, _)| pixel.count == 1.0 && !pixel.is_clipped)
}

/// Column and row of a single pixel.
fn pixel_place(side: &SideModel, pixel: &Pixel) -> [usize; 2] {
    let curve = &side.curve;
    let place = curve.origin + curve.along * (pixel.s * curve.half_length) + curve.across * pixel.y;
    [place.x.round() as usize, place.y.round() as usize]
}

impl SideOffset {
    fn of(
        reader: &GreyReader<'_>,
        side: &SideModel,
        first: Offset,
        second: Offset,
    ) -> Option<Self> {
        let middle = side.curve.point(0.0, 0.0);
        let picture = reader.picture();
        let size = Vector2::new(picture.width() as f64, picture.height() as f64);
        let offset = second.value - first.value;
        let variance = first.variance + second.variance;
        (variance > 0.0 && offset.is_finite()).then(|| Self {
            normal: side.curve.point(0.0, 1.0) - middle,
            place: middle - 0.5 * (size - Vector2::repeat(1.0)),
            offset,
            variance,
            dark_sign: -side.contrast[0].signum(),
        })
    }
}

/// The displacement that fits the offsets of all sides best.
fn displacement(sides: impl Iterator<Item = SideOffset>) -> Option<PartDisplacement> {
    let mut normal = SMatrix::<f64, DISPLACEMENTS, DISPLACEMENTS>::zeros();
    let mut right = SVector::<f64, DISPLACEMENTS>::zeros();
    let (mut squares, mut count) = (0.0, 0_u32);
    for side in sides {
        let row = SVector::from([
            side.normal.x,
            side.normal.y,
            side.normal.dot(&side.place),
            side.dark_sign,
        ]);
        normal += row * row.transpose() / side.variance;
        right += row * (side.offset / side.variance);
        squares += side.offset * side.offset / side.variance;
        count += 1;
    }
    if (count as usize) < MIN_SIDES {
        return None;
    }
    let factor = normal.cholesky()?;
    let solution = factor.solve(&right);
    let freedom = f64::from(count) - DISPLACEMENTS as f64;
    let misfit = ((squares - solution.dot(&right)) / freedom).max(1.0);
    let covariance = factor.inverse() * misfit;
    let shift = Vector2::new(solution[0], solution[1]);
    let shift_covariance = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    Some(PartDisplacement {
        shift,
        shift_deviations: shift
            .dot(&shift_covariance.cholesky()?.solve(&shift))
            .sqrt(),
        magnification: solution[MAGNIFICATION],
        magnification_std: covariance[(MAGNIFICATION, MAGNIFICATION)].sqrt(),
    })
}
