//! Input of a fit to the pixels, and the reasons to reject its result.

use crate::error::Error;
use crate::image::{KeptPixels, PictureTone};
use crate::image_size::ImageSize;
use crate::observations::PlaneEdges;

/// The pictures that show the figures, and how they were coded.
#[derive(Debug, Clone, Copy)]
pub struct Photographs<'a> {
    /// The result of [`pixels_to_keep`](crate::pixels_to_keep) for the picture of each image index
    /// of the figures.
    pub pictures: &'a [&'a KeptPixels],
    /// Coding of each.
    pub tones: &'a [PictureTone],
}

impl Photographs<'_> {
    /// Checks that pictures, tones and figures are consistent.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] unless every picture has a tone curve and the given size, and
    /// every figure a picture.
    pub(crate) fn check(&self, edges: &[PlaneEdges], size: ImageSize) -> Result<(), Error> {
        let [pictures, tones] = [self.pictures.len(), self.tones.len()];
        if pictures != tones {
            return Err(Error::InvalidArgument(format!(
                "{pictures} pictures are given with {tones} tone curves: each picture needs one"
            )));
        }
        if !self.tones.iter().all(PictureTone::is_valid) {
            return Err(Error::InvalidArgument(
                "the gamma of a tone curve, and the deviation of a shift, must be positive and \
                 finite"
                    .into(),
            ));
        }
        for (figure, edges) in edges.iter().enumerate() {
            if edges.image >= pictures {
                return Err(Error::InvalidArgument(format!(
                    "figure {figure} is in the picture of index {}, but only {pictures} pictures \
                     are given",
                    edges.image
                )));
            }
        }
        let stated = [size.width as usize, size.height as usize];
        for (index, picture) in self.pictures.iter().enumerate() {
            let [width, height] = [picture.width(), picture.height()];
            if [width, height] != stated {
                return Err(Error::InvalidArgument(format!(
                    "the picture of index {index} has {width} x {height} pixels, not {} x {}",
                    size.width, size.height
                )));
            }
        }
        Ok(())
    }
}

/// Why the result of the fit to the pixels is not used.
pub(super) enum Refusal {
    /// The figures are not squares of known polarity in known pictures.
    NotApplicable,
    Reason(&'static str),
}
