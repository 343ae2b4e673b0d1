//! The image of a straight line over a chord: a smooth curve, interpolated from a few of its
//! pixels.

use nalgebra::{Vector2, Vector3};

use super::Lens;
use crate::geometry::Line;
use crate::numeric::{LANES, NODES, coefficients, node_places};

/// Maximum number of Newton steps that move a node onto the image of the line; from a chord two or
/// three suffice.
const MAX_STEPS: usize = 8;

/// Minimum cosine of the angle between the image of the line and the chord.
const MIN_COSINE: f64 = 0.3;

/// Coordinates of up to `LANES` pixels; unused lanes repeat the first pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelLanes {
    x: [f64; LANES],
    y: [f64; LANES],
}

impl PixelLanes {
    #[inline]
    pub fn of(pixels: impl ExactSizeIterator<Item = Vector2<f64>> + Clone) -> Self {
        let first = pixels.clone().next().unwrap_or_default();
        let mut lanes = Self {
            x: [first.x; LANES],
            y: [first.y; LANES],
        };
        for (i, pixel) in pixels.take(LANES).enumerate() {
            (lanes.x[i], lanes.y[i]) = (pixel.x, pixel.y);
        }
        lanes
    }
}

/// The image of a line over a chord.
#[derive(Debug, Clone)]
pub(crate) struct LineImage {
    /// Pixels of the curve, at the nodes of the chord.
    pub nodes: [Vector2<f64>; NODES],
    chord: Line,
    along: Vector2<f64>,
    middle: f64,
    /// Reciprocal of half the chord's length.
    inverse_half_length: f64,
    /// Polynomial coefficients of the height of the curve over the chord, pixels.
    heights: [f64; NODES],
}

impl LineImage {
    /// Computes the image of a line that a lens sees near a chord. The chord spans the given pixels
    /// and extends `beyond` (px) at either end. `None` where the image is no polynomial to the
    /// tolerance (px), or is not seen.
    pub fn over<L: Lens>(
        (lens, line): (&L, &Vector3<f64>),
        chord: Line,
        pixels: impl Iterator<Item = Vector2<f64>>,
        (beyond, tolerance): (f64, f64),
    ) -> Option<Self> {
        let across = chord.normal();
        let along = Vector2::new(-across.y, across.x);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for pixel in pixels {
            let place = along.dot(&pixel);
            (low, high) = (low.min(place), high.max(place));
        }
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low) + beyond);
        let mut nodes = [Vector2::zeros(); NODES];
        for (node, place) in nodes.iter_mut().zip(node_places()) {
            let at = along * (middle + half * place);
            let start = at - across * chord.distance(&at);
            *node = pixel_on_image((lens, line), start, across, tolerance)?;
        }
        let heights = coefficients(&nodes.map(|node| [chord.distance(&node)])).map(|[term]| term);
        let is_smooth = heights[NODES - 2..]
            .iter()
            .all(|term| term.abs() <= tolerance);
        is_smooth.then_some(Self {
            nodes,
            chord,
            along,
            middle,
            inverse_half_length: 1.0 / half,
            heights,
        })
    }

    /// The direction across the chord.
    pub fn across(&self) -> Vector2<f64> {
        self.chord.normal()
    }

    /// Position of a pixel along the chord, from -1 to 1.
    #[inline]
    pub fn place(&self, pixel: &Vector2<f64>) -> f64 {
        (self.along.dot(pixel) - self.middle) * self.inverse_half_length
    }

    /// Positions of several pixels along the chord.
    #[inline]
    pub fn places(&self, PixelLanes { x, y }: &PixelLanes) -> [f64; LANES] {
        let (along, middle, inverse_half_length) =
            (self.along, self.middle, self.inverse_half_length);
        std::array::from_fn(|i| (along.x * x[i] + along.y * y[i] - middle) * inverse_half_length)
    }

    /// Signed distances (px) of pixels from the curve across the chord, given the polynomials at
    /// their positions.
    #[inline]
    pub fn distances(
        &self,
        PixelLanes { x, y }: &PixelLanes,
        terms: &[[f64; LANES]; NODES],
    ) -> [f64; LANES] {
        let [a, b, c] = self.chord.coefficients().into();
        let mut distances: [f64; LANES] = std::array::from_fn(|i| a * x[i] + b * y[i] + c);
        for (height, term) in self.heights.iter().zip(terms) {
            for i in 0..LANES {
                distances[i] -= height * term[i];
            }
        }
        distances
    }
}

/// Returns the pixel of a line's image that lies across from a start. The last step starts within
/// the tolerance, and leaves an error of its square.
fn pixel_on_image<L: Lens>(
    (lens, line): (&L, &Vector3<f64>),
    start: Vector2<f64>,
    across: Vector2<f64>,
    tolerance: f64,
) -> Option<Vector2<f64>> {
    let mut pixel = start;
    for _ in 0..MAX_STEPS {
        let ray = lens.unproject_with_jacobian(&pixel)?;
        let (distance, normal) = lens.line_distance_and_normal(&ray, line);
        let cosine = normal.dot(&across);
        if cosine.abs() < MIN_COSINE {
            return None;
        }
        pixel -= across * (distance / cosine);
        if distance.abs() <= tolerance {
            return Some(pixel);
        }
    }
    None
}
