//! Arguments from arbitrary bytes; zeros where the bytes run out.

use arbitrary::Unstructured;
use nalgebra::{Matrix3, Vector2};
use trisquare::{Brown, BrownModel, Fixed, ImageSize, Line, Method, Options, PowerCurve, Tone};

/// Magnitude far outside every picture, but small enough that squares do not overflow.
const LARGE: f64 = 1e6;

/// A reader of arguments.
pub struct Bytes<'a>(Unstructured<'a>);

impl<'a> Bytes<'a> {
    pub fn new(data: &'a [u8]) -> Self {
        Self(Unstructured::new(data))
    }

    /// Returns a number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        self.0.int_in_range(0..=end - 1).unwrap_or(0)
    }

    /// Returns true once in `times`.
    pub fn once_in(&mut self, times: usize) -> bool {
        self.below(times) == times - 1
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// Returns a number uniform in `0..1`, in 65,536 steps.
    pub fn unit(&mut self) -> f64 {
        f64::from(self.0.arbitrary::<u16>().unwrap_or(0)) / 65_536.0
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns a number between two powers of ten.
    pub fn power(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.between(low, high))
    }

    pub fn seed(&mut self) -> u64 {
        self.0.arbitrary().unwrap_or(0)
    }

    /// Returns any bits: NaN, infinities, subnormals.
    pub fn any(&mut self) -> f64 {
        self.0.arbitrary().unwrap_or(0.0)
    }

    pub fn byte(&mut self) -> u8 {
        self.0.arbitrary().unwrap_or(0)
    }

    /// Mostly a coordinate within a picture, some of them equal; at times far outside, or any bits.
    pub fn coordinate(&mut self, extent: f64) -> f64 {
        match self.below(16) {
            0..10 => self.between(0.0, extent),
            10..13 => self.below(4) as f64,
            13..15 => self.between(-LARGE, LARGE),
            _ => self.any(),
        }
    }

    /// Mostly a small number; at times zero, a power of ten, or any bits.
    pub fn coefficient(&mut self) -> f64 {
        match self.below(16) {
            0..11 => self.between(-2.0, 2.0),
            11..13 => 0.0,
            13..15 => self.power(-12.0, 12.0),
            _ => self.any(),
        }
    }

    pub fn point(&mut self, size: ImageSize) -> Vector2<f64> {
        let [width, height] = [size.width, size.height].map(f64::from);
        Vector2::new(self.coordinate(width), self.coordinate(height))
    }

    pub fn points(&mut self, size: ImageSize, at_most: usize) -> Vec<Vector2<f64>> {
        (0..self.below(at_most + 1))
            .map(|_| self.point(size))
            .collect()
    }

    /// Returns lines; invalid ones are left out.
    pub fn lines(&mut self, at_most: usize) -> Vec<Line> {
        (0..self.below(at_most + 1))
            .filter_map(|_| {
                let [a, b, c] = std::array::from_fn(|_| self.coefficient());
                Line::new(a, b, c).ok()
            })
            .collect()
    }

    pub fn matrix(&mut self) -> Matrix3<f64> {
        Matrix3::from_fn(|_, _| self.coefficient())
    }

    /// Mostly a camera that might have taken the picture; at times one of arbitrary numbers.
    pub fn camera(&mut self, size: ImageSize) -> Brown {
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let scale = [width, width, width, height, 1.0, 1.0, 1.0, 0.1, 0.1];
        if self.once_in(4) {
            return Brown::new(scale.map(|unit| unit * self.coefficient()));
        }
        let middle = [1.0, 1.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
        Brown::new(std::array::from_fn(|i| {
            scale[i] * (middle[i] + self.between(-0.4, 0.4))
        }))
    }

    /// Mostly the defaults.
    pub fn options(&mut self, size: ImageSize) -> Options {
        let mut options = Options::default();
        if self.once_in(4) {
            options.method = Method::Linear;
        }
        options.model = self.pick(&[
            BrownModel::Radial2,
            BrownModel::None,
            BrownModel::Radial1,
            BrownModel::Radial3,
            BrownModel::Brown,
        ]);
        if self.once_in(2) {
            options.fixed = Fixed {
                aspect: self.once_in(2),
                principal_point: self.once_in(2),
                focal: self.once_in(4),
                distortion: self.once_in(4),
                skew: !self.once_in(4),
            };
        }
        if options.fixed.focal || self.once_in(4) {
            options.initial = Some(self.camera(size));
        }
        options
    }

    pub fn tone(&mut self) -> Tone {
        match self.below(5) {
            0 | 1 => Tone::Srgb,
            2 => Tone::Linear,
            3 => Tone::Gamma(self.power(-2.0, 2.0)),
            _ => Tone::Power(self.curve()),
        }
    }

    /// Mostly a tone curve as cameras have; at times any valid one.
    pub fn curve(&mut self) -> PowerCurve {
        let usual = PowerCurve {
            gamma: self.between(0.8, 2.8),
            toe: self.between(0.0, 0.1),
        };
        let any = PowerCurve {
            gamma: self.power(-2.0, 2.0),
            toe: self.coefficient(),
        };
        let taken = self.once_in(8) && Tone::Power(any).is_valid();
        if taken { any } else { usual }
    }
}
