//! A square outline with the pixels around it.

use nalgebra::Vector2;

use super::coverage::PLATEAU;
use crate::geometry::Line;

/// Maximum distance (px) from an outline of the pixels used: pixels up to there still contribute to
/// the plateaus' light.
const REACH: f64 = 12.0;

/// Limit on the reach as a fraction of the outline's size, and the lower bound (px) of that limit.
const REACH_PART: f64 = 0.03;
const MIN_FULL_REACH: f64 = 5.0;

/// Minimum reach (px): with less, no plateau shows beside the outline's blur.
pub(super) const MIN_REACH: f64 = 3.0;

/// Fraction of the widest blur of the usual band below which a measured blur surely fits into it:
/// the blur of a figure's sides, fitted together, differs from that of a single side.
const SURELY_HELD: f64 = 0.65;

/// Width of a band along the outlines. The lengths above apply to the usual one.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Width {
    Usual,
    /// Twice as wide, for a blur that does not fit into the usual one.
    Wide,
}

impl Width {
    /// Factor by which the lengths are multiplied.
    pub fn factor(self) -> f64 {
        match self {
            Self::Usual => 1.0,
            Self::Wide => 2.0,
        }
    }

    /// The narrowest width that surely contains edges of this blur (px), measured on each side
    /// alone.
    pub fn of_blur(blur: f64) -> Self {
        match blur < SURELY_HELD * Self::Usual.widest_blur() {
            true => Self::Usual,
            false => Self::Wide,
        }
    }

    /// The largest blur (px) that fits into a band: an edge extends over 3.8 of it.
    pub fn widest_blur(self) -> f64 {
        self.factor() * REACH / PLATEAU
    }

    /// Distance (px) to which a band extends from an isolated outline of this size (px).
    pub fn reach(self, size: f64) -> f64 {
        self.factor() * (REACH_PART * size).clamp(MIN_FULL_REACH, REACH)
    }
}

/// A pixel near an outline, stored compactly: a photograph has some hundred thousand of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BandPixel {
    pub column: u32,
    pub row: u32,
    /// Coded grey, 1 being white.
    pub value: f64,
    pub depth: f32,
    /// The nearest stretch of the outline.
    pub stretch: u16,
    /// Bit mask of the sides that may blur it.
    pub near: u8,
    /// Whether the value is only a lower bound of the light.
    pub is_clipped: bool,
}

impl BandPixel {
    #[inline]
    pub fn place(&self) -> Vector2<f64> {
        Vector2::new(f64::from(self.column), f64::from(self.row))
    }

    /// Distance to the initial outline, px, positive inside; accurate to half a pixel.
    #[inline]
    pub fn depth(&self) -> f64 {
        f64::from(self.depth)
    }
}

/// A square outline with the pixels around it.
#[derive(Debug, Clone)]
pub(crate) struct PixelFigure {
    /// Index of the picture that shows it.
    pub image: usize,
    pub plane: usize,
    pub figure: usize,
    /// The four sides with their normals turned inward, in cyclic order.
    pub sides: [Line; 4],
    /// The corners in the figure's coordinates; corner `i` is where sides `i - 1` and `i` meet.
    pub corners: [Vector2<f64>; 4],
    pub dark_inside: bool,
    /// Centre and size (px) of the outline, for the linear terms of the exposure.
    pub centre: Vector2<f64>,
    pub size: f64,
    /// Width of its band.
    pub width: Width,
    /// Maximum distance (px) of its pixels from the outline.
    pub reach: f64,
    /// Empty if they are read again for every use: see
    /// [`PixelFit::pixel_source`](super::fit::PixelFit::pixel_source).
    pub pixels: Vec<BandPixel>,
    /// The side that each stretch of the outline belongs to.
    pub stretch_sides: Vec<u8>,
    /// Whether the pixels of each stretch are dropped; empty if none are.
    pub dropped: Vec<bool>,
}

impl PixelFigure {
    /// A copy with about one pixel in `stride`, spread evenly.
    pub fn subsampled(&self, stride: u32) -> Self {
        self.with_some_of(&self.pixels, stride)
    }

    /// A copy with about one in `stride` of these pixels.
    pub fn with_some_of(&self, pixels: &[BandPixel], stride: u32) -> Self {
        // Neighbours along rows, columns and diagonals fall into different classes.
        let class = |p: &BandPixel| 3 * u64::from(p.column) + 5 * u64::from(p.row);
        let keep = |p: &&BandPixel| class(p).is_multiple_of(u64::from(stride));
        Self {
            pixels: pixels.iter().filter(keep).copied().collect(),
            stretch_sides: self.stretch_sides.clone(),
            dropped: self.dropped.clone(),
            ..*self
        }
    }

    /// Drops the pixels farther away than `reach` (px), or than `MIN_REACH` if that is more.
    pub fn limit_reach(&mut self, reach: f64) {
        if reach < self.reach {
            self.reach = reach.max(MIN_REACH);
            let limit = self.reach;
            self.pixels.retain(|pixel| pixel.depth().abs() <= limit);
        }
    }

    /// Drops the pixels along marked stretches.
    pub fn drop_stretches(&mut self, marked: Vec<bool>) {
        if marked.contains(&true) {
            retain_used(&mut self.pixels, &marked);
            self.dropped = marked;
        }
    }
}

pub(super) fn retain_used(pixels: &mut Vec<BandPixel>, dropped: &[bool]) {
    pixels.retain(|pixel| !dropped[usize::from(pixel.stretch)]);
}
