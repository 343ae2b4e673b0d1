//! The curve of one side: a polynomial of low degree over the chord of its coarse path.

use nalgebra::{SMatrix, SVector, Vector2};

/// Number of coefficients for the highest degree in use, 4: the image of a line through a lens with
/// two or three distortion terms departs from such a polynomial by less than the noise of the
/// samples.
pub(super) const COEFFICIENTS: usize = 5;

/// `y(x)` in the frame of a chord: `x` along it from its middle, `y` along the normal.
#[derive(Debug, Clone)]
pub(super) struct ChordCurve {
    pub origin: Vector2<f64>,
    pub along: Vector2<f64>,
    /// The right-hand normal on the screen, `(-along.y, along.x)`.
    pub across: Vector2<f64>,
    /// Half the length of the chord, pixels; the polynomial's variable is `s = x / half_length`.
    pub half_length: f64,
    pub degree: usize,
    pub coefficients: [f64; COEFFICIENTS],
}

impl ChordCurve {
    /// The straight chord between two points; `None` if they coincide or are not finite.
    pub fn chord(start: Vector2<f64>, end: Vector2<f64>) -> Option<Self> {
        let length = (end - start).norm();
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let along = (end - start) / length;
        Some(Self {
            origin: 0.5 * (start + end),
            along,
            across: Vector2::new(-along.y, along.x),
            half_length: 0.5 * length,
            degree: 0,
            coefficients: [0.0; COEFFICIENTS],
        })
    }

    pub fn length(&self) -> f64 {
        2.0 * self.half_length
    }

    /// A point in the frame of the chord, `(s, y)`.
    #[inline]
    pub fn local(&self, point: Vector2<f64>) -> (f64, f64) {
        let offset = point - self.origin;
        (
            offset.dot(&self.along) / self.half_length,
            offset.dot(&self.across),
        )
    }

    #[inline]
    pub fn height(&self, s: f64) -> f64 {
        let [c0, c1, c2, c3, c4] = self.coefficients;
        c0 + s * (c1 + s * (c2 + s * (c3 + s * c4)))
    }

    /// The largest `|y|` between the ends, to within a few percent: the steps are too short to miss
    /// a bend.
    pub fn greatest_height(&self) -> f64 {
        const STEPS: i32 = 12;
        (-STEPS..=STEPS)
            .map(|step| self.height(f64::from(step) / f64::from(STEPS)).abs())
            .fold(0.0, f64::max)
    }

    /// `y` and `dy/dx` at `s`.
    #[inline]
    pub fn height_and_slope(&self, s: f64) -> (f64, f64) {
        let [_, c1, c2, c3, c4] = self.coefficients;
        let slope = c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * 4.0 * c4));
        (self.height(s), slope / self.half_length)
    }

    /// The point at `s`, moved by `offset` pixels along the curve's normal.
    pub fn point(&self, s: f64, offset: f64) -> Vector2<f64> {
        let (height, slope) = self.height_and_slope(s);
        let normal = self.across - slope * self.along;
        self.origin
            + self.along * (s * self.half_length)
            + self.across * height
            + normal * (offset / normal.norm())
    }

    /// Derivatives of the displacement of a point of the curve along its normal with respect to
    /// each coefficient, and that normal.
    pub fn displacement_derivatives(
        &self,
        point: Vector2<f64>,
    ) -> (SVector<f64, COEFFICIENTS>, Vector2<f64>) {
        let (s, _) = self.local(point);
        let normal = self.point(s, 1.0) - self.point(s, 0.0);
        // A height is a distance times the secant of the curve's angle with its chord.
        let cosine = normal.dot(&self.across);
        let powers = SVector::from_fn(|k, _| s.powi(k as i32));
        (powers * cosine, normal)
    }

    /// Signed distance of a point, positive along the normal. Beyond its ends the curve is
    /// continued straight, as the polynomial would diverge.
    pub fn signed_distance(&self, point: Vector2<f64>) -> f64 {
        let (height, slope) = self.height_above(point);
        height / (1.0 + slope * slope).sqrt()
    }

    /// Whether a point's [`signed_distance`](Self::signed_distance), times a sign, exceeds a bound.
    #[inline]
    pub fn is_beyond(&self, point: Vector2<f64>, sign: f64, bound: f64) -> bool {
        let (height, slope) = self.height_above(point);
        sign * height > bound * (1.0 + slope * slope).sqrt()
    }

    /// Height of a point above the curve, in the frame of the chord, and the curve's slope there.
    #[inline]
    fn height_above(&self, point: Vector2<f64>) -> (f64, f64) {
        let offset = point - self.origin;
        let (x, y) = (offset.dot(&self.along), offset.dot(&self.across));
        let per_length = 1.0 / self.half_length;
        let s = x * per_length;
        let end = s.clamp(-1.0, 1.0);
        let [_, c1, c2, c3, c4] = self.coefficients;
        let by_s = c1 + end * (2.0 * c2 + end * (3.0 * c3 + end * 4.0 * c4));
        let tangent_height = self.height(end) + by_s * (s - end);
        (y - tangent_height, by_s * per_length)
    }

    /// Fits the polynomial of the given degree to `(s, y, weight)`; false if they do not determine
    /// it.
    pub fn fit(&mut self, samples: impl Iterator<Item = (f64, f64, f64)>, degree: usize) -> bool {
        let mut normal = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::identity();
        let mut right = SVector::<f64, COEFFICIENTS>::zeros();
        let used = degree + 1;
        normal.view_mut((0, 0), (used, used)).fill(0.0);
        for (s, y, weight) in samples {
            let mut powers = [weight; COEFFICIENTS];
            for k in 1..COEFFICIENTS {
                powers[k] = powers[k - 1] * s;
            }
            let mut s_to_row = 1.0;
            for row in 0..used {
                for column in 0..used {
                    normal[(row, column)] += s_to_row * powers[column];
                }
                right[row] += y * powers[row];
                s_to_row *= s;
            }
        }
        let Some(factor) = normal.cholesky() else {
            return false;
        };
        self.degree = degree;
        self.coefficients = factor.solve(&right).into();
        self.coefficients
            .iter()
            .all(|coefficient| coefficient.is_finite())
    }
}
