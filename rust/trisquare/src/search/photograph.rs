//! The photograph behind a searched picture, which is a reduced one.

use nalgebra::Vector2;

use crate::image::GreyBytes;

/// A photograph, and how many times as fine as the searched picture it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Photograph<'a> {
    pub grey: GreyBytes<'a>,
    pub scale: f64,
}

impl Photograph<'_> {
    /// Its grey level at a point of the searched picture, as a whole number: what differs by less is
    /// as good as equal.
    pub fn level(&self, point: Vector2<f64>) -> f64 {
        self.grey.level(point * self.scale)
    }
}
