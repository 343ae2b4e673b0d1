//! Distances of pixels to the sides of a figure, and their derivatives, interpolated from a few
//! nodes per side.
//!
//! Along the image of a side they are polynomials through its nodes. Across it, over the few pixels
//! that it blurs, the distance is a parabola through zero, and its derivatives hardly change.

use nalgebra::{DMatrix, Vector2};

use super::band_pixels::{BandPixel, PixelFigure};
use super::coverage::PLATEAU;
use super::scene::Scene;
use crate::geometry::Line;
use crate::lens::{Lens, LineImage, MAX_LENS_COLUMNS, PixelLanes};
use crate::numeric::{LANES, NODES, coefficients, polynomials};
use crate::observations::FreeParameters;

/// Number of polynomial terms of the derivatives along a side and of the slopes across it. The
/// error is one part in ten thousand of them, and changes a step by as little.
pub(super) const TERMS: usize = 6;

/// Maximum error (px) of a polynomial from the image of a side.
const TOLERANCE: f64 = 0.01;

/// Margin (px) beyond the blur within which pixels may be queried.
const SLACK: f64 = 2.0;

/// The sides of a figure under one camera and pose.
pub(super) struct FigureChart {
    sides: [SideChart; 4],
    /// Offset added to all distances, px.
    shift: f64,
}

struct SideChart {
    image: LineImage,
    /// Coefficients of the distance, which is zero on the curve: its slope and half its curvature
    /// across.
    slopes: [[f64; 2]; TERMS],
}

impl SideChart {
    /// Signed distances (px) of some pixels, positive inside.
    #[inline(never)] // inlined, it is not vectorised
    fn distances(&self, pixels: &PixelLanes) -> [f64; LANES] {
        let terms = polynomials::<NODES>(&self.image.places(pixels));
        let heights = self.image.distances(pixels, &terms);
        let mut sums = [[0.0; LANES]; 2];
        for (coefficients, term) in self.slopes.iter().zip(&terms) {
            for (sum, coefficient) in sums.iter_mut().zip(coefficients) {
                for i in 0..LANES {
                    sum[i] += coefficient * term[i];
                }
            }
        }
        std::array::from_fn(|i| heights[i] * (sums[0][i] + heights[i] * sums[1][i]))
    }
}

impl FigureChart {
    /// `None` if the lens does not see the sides, or bends them more than the polynomials can
    /// follow.
    pub fn of<L: Lens>(scene: &Scene<'_, L>) -> Option<Self> {
        let height = PLATEAU * scene.widest_blur();
        let side = |i: usize| {
            let line = (scene.lens, &scene.lines[i]);
            let ends = [i, (i + 1) % 4].map(|k| scene.corner_pixels[k]);
            let along = (ends[1] - ends[0]).normalize();
            let chord = Line::with_unit_normal(Vector2::new(-along.y, along.x), ends[0]);
            let beyond = PLATEAU * scene.figure.width.widest_blur() + SLACK;
            let image = LineImage::over(line, chord, ends.into_iter(), (beyond, TOLERANCE))?;
            let across = image.across();
            let mut slopes = [[0.0; 2]; NODES];
            for (slope, node) in slopes.iter_mut().zip(&image.nodes) {
                let distance_at = |offset: f64| {
                    let ray = scene
                        .lens
                        .unproject_with_jacobian(&(node + across * offset))?;
                    Some(scene.lens.line_distance(&ray, line.1))
                };
                let [low, high] = [distance_at(-height)?, distance_at(height)?];
                *slope = [
                    (high - low) / (2.0 * height),
                    (high + low) / (2.0 * height * height),
                ];
            }
            let slopes = coefficients(&slopes);
            Some(SideChart {
                image,
                slopes: std::array::from_fn(|m| slopes[m]),
            })
        };
        Some(Self {
            sides: [side(0)?, side(1)?, side(2)?, side(3)?],
            shift: scene.shift(),
        })
    }

    /// Signed distances (px) of some pixels to the sides near them, positive inside.
    #[inline]
    pub fn distances(&self, pixels: &[BandPixel]) -> [[f64; 4]; LANES] {
        let mut found = [[0.0; 4]; LANES];
        let lanes = PixelLanes::of(pixels.iter().map(BandPixel::place));
        for (s, side) in self.sides.iter().enumerate() {
            if pixels.iter().all(|pixel| pixel.near & (1 << s) == 0) {
                continue;
            }
            let distances = side.distances(&lanes);
            for (pixel_distances, distance) in found.iter_mut().zip(distances) {
                pixel_distances[s] = distance + self.shift;
            }
        }
        found
    }

    /// Position of a pixel along a side: the argument of its polynomials.
    #[inline]
    pub fn place(&self, side: usize, pixel: &BandPixel) -> f64 {
        self.sides[side].image.place(&pixel.place())
    }

    /// Coefficients of the distance's derivatives along a side, by the line's three parameters and
    /// those of the camera.
    pub fn jacobian<L: Lens>(
        &self,
        scene: &Scene<'_, L>,
        side: usize,
        free: &FreeParameters,
    ) -> Option<DMatrix<f64>> {
        let mut rows = [[0.0; 3 + MAX_LENS_COLUMNS]; NODES];
        for (row, node) in rows.iter_mut().zip(&self.sides[side].image.nodes) {
            let ray = scene.lens.unproject_with_jacobian(node)?;
            let line = &scene.lines[side];
            let distance = scene
                .lens
                .line_distance_jacobian(&ray, line, free.columns());
            row[..3].copy_from_slice(distance.wrt_line.as_slice());
            free.gather(&distance.wrt_lens, &mut row[3..3 + free.len()]);
        }
        let found = coefficients(&rows);
        Some(DMatrix::from_fn(TERMS, 3 + free.len(), |m, c| found[m][c]))
    }
}

/// Distances (px) of the pixels of a figure to the sides near them; may be zero where `is_needed`
/// is false.
pub(super) fn all_distances<L: Lens>(
    scene: &Scene<'_, L>,
    figure: &PixelFigure,
    is_needed: impl Fn(&BandPixel) -> bool,
) -> Option<Vec<[f64; 4]>> {
    let chart = FigureChart::of(scene)?;
    let mut found = Vec::with_capacity(figure.pixels.len());
    for pixels in figure.pixels.chunks(LANES) {
        let distances = match pixels.iter().any(&is_needed) {
            true => chart.distances(pixels),
            false => [[0.0; 4]; LANES],
        };
        found.extend_from_slice(&distances[..pixels.len()]);
    }
    Some(found)
}
