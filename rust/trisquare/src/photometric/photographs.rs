//! What a fit to the pixels looks at, and why it may not be taken.

use crate::image::{KeptPixels, PictureTone};

/// The pictures that show the figures, and how they were coded.
#[derive(Debug, Clone, Copy)]
pub struct Photographs<'a> {
    /// Of one picture per image index of the figures, what
    /// [`pixels_to_keep`](crate::pixels_to_keep) gives.
    pub pictures: &'a [&'a KeptPixels],
    /// How each was coded.
    pub tones: &'a [PictureTone],
}

/// Why the fit to the pixels is not taken.
pub(super) enum Refusal {
    /// The figures are not squares of known polarity in known pictures.
    NotApplicable,
    Reason(&'static str),
}
