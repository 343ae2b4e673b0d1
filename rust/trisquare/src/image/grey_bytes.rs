//! A grey picture of 8 bits.

use nalgebra::Vector2;

/// A grey picture of 8 bits in row order, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct GreyBytes<'a> {
    width: usize,
    height: usize,
    values: &'a [u8],
}

impl<'a> GreyBytes<'a> {
    /// Wraps the values; `None` if the picture is empty or the number of values is not
    /// `width * height`.
    #[must_use]
    pub fn new(width: usize, height: usize, values: &'a [u8]) -> Option<Self> {
        let is_complete =
            width > 0 && height > 0 && width.checked_mul(height) == Some(values.len());
        is_complete.then_some(Self {
            width,
            height,
            values,
        })
    }

    /// Width and height.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The values in row order.
    pub(crate) fn values(&self) -> &[u8] {
        self.values
    }

    /// The result of `bilinear` rounded to the nearest grey level, for coordinates rounded to `f32`.
    pub(crate) fn level(&self, point: Vector2<f64>) -> f64 {
        self.bilinear(point.map(|x| f64::from(x as f32)))
            .round_ties_even()
    }

    /// Bilinear interpolation; outside the picture, the value at the nearest point of the border.
    pub(crate) fn bilinear(&self, point: Vector2<f64>) -> f64 {
        let x = point.x.clamp(0.0, (self.width - 1) as f64);
        let y = point.y.clamp(0.0, (self.height - 1) as f64);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = (
            (left + 1).min(self.width - 1),
            (top + 1).min(self.height - 1),
        );
        let (u, v) = (x - left as f64, y - top as f64);
        let value = |row: usize, column: usize| f64::from(self.values[row * self.width + column]);
        let above = value(top, left) * (1.0 - u) + value(top, right) * u;
        let below = value(bottom, left) * (1.0 - u) + value(bottom, right) * u;
        above * (1.0 - v) + below * v
    }
}
