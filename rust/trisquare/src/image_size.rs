//! The size of a picture, and points that follow from it.

use nalgebra::Vector2;

use crate::error::Error;

/// Width and height of a picture in pixels; `(0, 0)` is the centre of its top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ImageSize {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
}

#[cfg(feature = "serde")]
crate::stored::read_checked!(ImageSize {
    width: u32,
    height: u32,
});

impl ImageSize {
    /// The image centre, `((W - 1) / 2, (H - 1) / 2)`.
    pub fn centre(&self) -> Vector2<f64> {
        Vector2::new(f64::from(self.width) - 1.0, f64::from(self.height) - 1.0) / 2.0
    }

    /// Half the length of the diagonal.
    pub fn half_diagonal(&self) -> f64 {
        0.5 * f64::from(self.width).hypot(f64::from(self.height))
    }

    /// The centres of the four corner pixels, clockwise from the top left.
    pub fn corners(&self) -> [Vector2<f64>; 4] {
        let extent = self.centre() * 2.0;
        [
            (0.0, 0.0),
            (extent.x, 0.0),
            (extent.x, extent.y),
            (0.0, extent.y),
        ]
        .map(|(x, y)| Vector2::new(x, y))
    }

    /// Whether a point is between the pixels' centres, or within `margin` pixels of them.
    pub(crate) fn contains(&self, point: &Vector2<f64>, margin: f64) -> bool {
        let extent = self.centre() * 2.0;
        (0..2).all(|axis| (-margin..=extent[axis] + margin).contains(&point[axis]))
    }

    /// Checks that the picture is not empty.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an empty picture.
    pub(crate) fn check(&self) -> Result<(), Error> {
        let Self { width, height } = self;
        if *width == 0 || *height == 0 {
            return Err(Error::InvalidArgument(format!(
                "the picture is empty: width {width}, height {height}"
            )));
        }
        Ok(())
    }
}
