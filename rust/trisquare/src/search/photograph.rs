//! The photograph of which a searched picture is a reduced version.

use nalgebra::Vector2;

use crate::image::GreyBytes;

/// A photograph, and the ratio of its resolution to that of the searched picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Photograph<'a> {
    pub grey: GreyBytes<'a>,
    pub scale: f64,
}

impl Photograph<'_> {
    /// Its grey level at a point of the searched picture, as a whole number: smaller differences do
    /// not count.
    pub fn level(&self, point: Vector2<f64>) -> f64 {
        self.grey.level(point * self.scale)
    }
}
