//! What a fit to the pixels looks at, and why it may not be taken.

use crate::image::{Picture, PictureTone};

/// The pictures that show the figures, and how they were coded.
#[derive(Debug, Clone, Copy)]
pub struct Photographs<'a> {
    /// One picture per image index of the figures.
    pub pictures: &'a [&'a Picture],
    /// How each was coded.
    pub tones: &'a [PictureTone],
}

/// Why the fit to the pixels is not taken.
pub(super) enum Refusal {
    /// The figures are not squares of known polarity in known pictures.
    NotApplicable,
    Reason(&'static str),
}
