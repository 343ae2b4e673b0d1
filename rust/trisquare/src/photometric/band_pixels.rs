//! A square outline with the pixels around it.

use nalgebra::Vector2;

use super::coverage::PLATEAU;
use crate::geometry::Line;

/// Pixels this near (px) to an outline are used: farther ones still tell the plateaus' light.
const REACH: f64 = 12.0;

/// But no farther than this part of the outline's size, and at least so many px.
const REACH_PART: f64 = 0.03;
const MIN_FULL_REACH: f64 = 5.0;

/// An outline whose reach is cut below this (px) shows no plateau beside its blur.
pub(super) const MIN_REACH: f64 = 3.0;

/// A blur that was measured as less than this part of the widest one fits into the band: the blur of
/// a figure's sides, fitted together, differs from that of a single one.
const SURELY_HELD: f64 = 0.65;

/// How wide a band along the outlines is: the lengths above are of the usual one.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Width {
    Usual,
    /// Twice as wide, where the usual one does not hold the blur.
    Wide,
}

impl Width {
    /// What the lengths are multiplied by.
    pub fn factor(self) -> f64 {
        match self {
            Self::Usual => 1.0,
            Self::Wide => 2.0,
        }
    }

    /// The narrower one that is sure to hold edges of this blur (px), measured by its sides alone.
    pub fn of_blur(blur: f64) -> Self {
        match blur < SURELY_HELD * Self::Usual.widest_blur() {
            true => Self::Usual,
            false => Self::Wide,
        }
    }

    /// The largest blur (px) that a band holds: 3.8 of it are an edge.
    pub fn widest_blur(self) -> f64 {
        self.factor() * REACH / PLATEAU
    }

    /// How far (px) a band reaches from an outline of this size (px) that stands alone.
    pub fn reach(self, size: f64) -> f64 {
        self.factor() * (REACH_PART * size).clamp(MIN_FULL_REACH, REACH)
    }
}

/// A pixel near an outline, in few bytes: there are some hundred thousand in a photograph.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BandPixel {
    pub column: u32,
    pub row: u32,
    /// Coded grey, 1 being white.
    pub value: f64,
    pub depth: f32,
    /// The stretch of the outline that it is nearest to.
    pub stretch: u16,
    /// The sides that may blur it, one bit each.
    pub near: u8,
    /// Whether the value only bounds the light from below.
    pub is_clipped: bool,
}

impl BandPixel {
    #[inline]
    pub fn place(&self) -> Vector2<f64> {
        Vector2::new(f64::from(self.column), f64::from(self.row))
    }

    /// Distance to the outline as first seen, px, positive inside; good to half a pixel.
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
    /// Middle and size (px) of the outline, for the linear terms of the exposure.
    pub centre: Vector2<f64>,
    pub size: f64,
    /// Of its band.
    pub width: Width,
    /// How far (px) from the outline its pixels lie.
    pub reach: f64,
    /// Empty where they are read again for every use: see [`PixelFit::unheld`](super::fit::PixelFit::unheld).
    pub pixels: Vec<BandPixel>,
    /// The side that each stretch of the outline belongs to.
    pub stretch_sides: Vec<u8>,
    /// The stretches whose pixels are dropped; empty if none are.
    pub dropped: Vec<bool>,
}

impl PixelFigure {
    /// The same with about one pixel in `stride`, spread evenly.
    pub fn subsampled(&self, stride: u32) -> Self {
        self.with_some_of(&self.pixels, stride)
    }

    /// The same with about one in `stride` of these pixels.
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

    /// Drops the pixels farther off than `reach` (px), which leaves the edge at least.
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
