//! The pixels around the outlines of a calibration's figures, and the pictures they are read from.

use super::band_pixels::{BandPixel, MIN_REACH, PixelFigure, Width, retain_used};
use super::outline::Outline;
use super::photographs::{Photographs, Refusal};
use crate::image::KeptReader;
use crate::lens::Lens;
use crate::observations::{ObservedPlane, PlaneEdges, Polarity, View};

/// Source of the pixels around the outlines of the figures.
pub(super) struct Bands<'a, L> {
    edges: &'a [PlaneEdges],
    planes: &'a [ObservedPlane],
    /// View under which the outlines are traced.
    view: &'a View<L>,
    readers: Vec<KeptReader<'a>>,
}

impl<'a, L: Lens> Bands<'a, L> {
    pub fn new(
        edges: &'a [PlaneEdges],
        planes: &'a [ObservedPlane],
        view: &'a View<L>,
        photographs: &Photographs<'a>,
    ) -> Self {
        let pictures = photographs.pictures.iter().zip(photographs.tones);
        Self {
            edges,
            planes,
            view,
            readers: pictures.map(|(p, tone)| p.reader(tone.tone())).collect(),
        }
    }

    /// The figures of a plane; empty for an outlier. `Refusal::NotApplicable` unless all are
    /// squares of known polarity.
    pub fn of_plane(&self, p: usize, width: Width) -> Result<Vec<PixelFigure>, Refusal> {
        let plane = &self.planes[p];
        if plane.is_outlier() {
            return Ok(Vec::new());
        }
        let reader = self
            .readers
            .get(plane.image)
            .ok_or(Refusal::NotApplicable)?;
        let outlines: Option<Vec<Outline>> = (0..plane.figures.len())
            .map(|f| self.outline(p, f))
            .collect();
        let outlines = outlines.ok_or(Refusal::NotApplicable)?;
        let figure = |(f, outline): (usize, &Outline)| {
            let polarity = self.edges[plane.figures[f].index].polarity;
            let dark_inside = polarity.ok_or(Refusal::NotApplicable)? == Polarity::DarkInside;
            let reach = outline.reach(&outlines, f, width);
            if reach < MIN_REACH {
                return Err(Refusal::Reason(
                    "two outlines of a plane are too close together",
                ));
            }
            let mut found = outline.figure(reader, (p, f), (reach, width), dark_inside);
            found.image = plane.image;
            Ok(found)
        };
        outlines.iter().enumerate().map(figure).collect()
    }

    fn outline(&self, p: usize, f: usize) -> Option<Outline> {
        let plane = &self.planes[p];
        let border = self.edges[plane.figures[f].index].border;
        Outline::of(plane, &self.view.planes[p], f, (&self.view.lens, border))
    }
}

/// Source of the pixels of a figure that does not store them.
pub(super) trait Pixels: Sync {
    fn read(&self, figure: &PixelFigure) -> Option<Vec<BandPixel>>;
}

impl<L: Lens> Pixels for Bands<'_, L> {
    fn read(&self, figure: &PixelFigure) -> Option<Vec<BandPixel>> {
        let outline = self.outline(figure.plane, figure.figure)?;
        let (mut pixels, ..) =
            outline.pixels(&self.readers[figure.image], figure.reach, figure.width);
        if !figure.dropped.is_empty() {
            retain_used(&mut pixels, &figure.dropped);
        }
        Some(pixels)
    }
}
