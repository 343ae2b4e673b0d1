//! Pictures rendered by numerical integration, whose edges are known exactly, and statistics of
//! measured edges.

use nalgebra::Vector2;
use trisquare::{EdgeSpan, Picture, SpanEdges, Tone, localise};

pub const SIZE: usize = 420;
pub const BLACK: f64 = 40.0 / 255.0;
pub const WHITE: f64 = 215.0 / 255.0;

/// Repeatable noise: SplitMix64 and Box-Muller.
pub struct Noise(pub u64);

impl Noise {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn phi(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// A dark shape with sharp corners, seen through a Gaussian blur.
#[derive(Clone, Copy)]
pub enum Shape {
    Square {
        centre: [f64; 2],
        half: f64,
        degrees: f64,
    },
    Disc {
        centre: [f64; 2],
        radius: f64,
    },
    /// A square with a light square inside it.
    Frame {
        centre: [f64; 2],
        half: f64,
        degrees: f64,
        thickness: f64,
    },
    /// An upright chessboard of 3 x 3 cells with dark corners.
    Board {
        origin: [f64; 2],
        cell: f64,
    },
}

impl Shape {
    /// Returns the covered fraction of a blurred point; exact for straight outlines.
    pub fn cover(&self, x: f64, y: f64, blur: f64) -> f64 {
        match *self {
            Self::Square {
                centre,
                half,
                degrees,
            } => {
                let (sin, cos) = degrees.to_radians().sin_cos();
                let (dx, dy) = (x - centre[0], y - centre[1]);
                let between = |u: f64| phi((half - u) / blur) - phi((-half - u) / blur);
                between(cos * dx + sin * dy) * between(cos * dy - sin * dx)
            }
            Self::Frame {
                centre,
                half,
                degrees,
                thickness,
            } => {
                let outer = Self::Square {
                    centre,
                    half,
                    degrees,
                };
                let inner = Self::Square {
                    centre,
                    half: half - thickness,
                    degrees,
                };
                outer.cover(x, y, blur) - inner.cover(x, y, blur)
            }
            Self::Disc { centre, radius } => {
                let distance = (x - centre[0]).hypot(y - centre[1]);
                // A blur moves a curved edge towards its centre by blur^2 / (2 radius).
                phi((radius - blur * blur / (2.0 * radius) - distance) / blur)
            }
            Self::Board { origin, cell } => {
                let stripe = |u: f64, index: usize| {
                    let start = index as f64 * cell;
                    phi((start + cell - u) / blur) - phi((start - u) / blur)
                };
                let (dx, dy) = (x - origin[0], y - origin[1]);
                (0..9)
                    .filter(|index| index % 2 == 0)
                    .map(|index| stripe(dx, index % 3) * stripe(dy, index / 3))
                    .sum()
            }
        }
    }

    /// Returns the corners, clockwise on the screen.
    pub fn corners(&self) -> Vec<Vector2<f64>> {
        let (Self::Square {
            centre,
            half,
            degrees,
        }
        | Self::Frame {
            centre,
            half,
            degrees,
            ..
        }) = *self
        else {
            panic!("only a square has corners");
        };
        let (sin, cos) = degrees.to_radians().sin_cos();
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[u, v]| {
                let (u, v) = (u * half, v * half);
                Vector2::new(centre[0] + cos * u - sin * v, centre[1] + sin * u + cos * v)
            })
            .to_vec()
    }
}

/// Properties of a photograph of a scene.
#[derive(Clone, Copy)]
pub struct Camera {
    pub blur: f64,
    pub noise: f64,
    pub tone: Tone,
    /// Coded values inside and outside the shape.
    pub inside: f64,
    pub outside: f64,
    /// Relative change of the light over 100 pixels of x.
    pub shading: f64,
}

pub const CAMERA: Camera = Camera {
    blur: 0.7,
    noise: 2.0 / 255.0,
    tone: Tone::Linear,
    inside: BLACK,
    outside: WHITE,
    shading: 0.0,
};

/// Gauss-Legendre nodes and weights over a pixel's box.
const NODES: [(f64, f64); 4] = [
    (-0.430_568_155_797_026_3, 0.173_927_422_568_726_9),
    (-0.169_990_521_792_428_1, 0.326_072_577_431_273_1),
    (0.169_990_521_792_428_1, 0.326_072_577_431_273_1),
    (0.430_568_155_797_026_3, 0.173_927_422_568_726_9),
];

impl Camera {
    /// Returns the coded values before noise.
    pub fn exposure(&self, shape: &Shape) -> Vec<f64> {
        let (inside, outside) = (
            self.tone.decode(self.inside),
            self.tone.decode(self.outside),
        );
        let pixel = |index: usize| {
            let (x, y) = ((index % SIZE) as f64, (index / SIZE) as f64);
            let mut cover = shape.cover(x, y, 0.5 + 2.0 * self.blur);
            if (1e-9..1.0 - 1e-9).contains(&cover) {
                let sum = |dx: f64| -> f64 {
                    NODES
                        .map(|(dy, down)| down * shape.cover(x + dx, y + dy, self.blur))
                        .iter()
                        .sum()
                };
                cover = NODES.map(|(dx, across)| across * sum(dx)).iter().sum();
            }
            let light = outside + (inside - outside) * cover;
            self.tone
                .encode(light * (1.0 + self.shading * (x - 210.0) / 100.0))
        };
        (0..SIZE * SIZE).map(pixel).collect()
    }

    pub fn bytes(&self, exposure: &[f64], seed: u64) -> Picture {
        let mut noise = Noise(seed);
        let values = exposure
            .iter()
            .map(|value| ((value + self.noise * noise.normal()) * 255.0).round() as u8)
            .collect();
        Picture::from_u8(SIZE, SIZE, 1, values).unwrap()
    }

    pub fn floats(&self, exposure: &[f64], seed: u64) -> Picture {
        let mut noise = Noise(seed);
        let values = exposure
            .iter()
            .map(|value| (value + self.noise * noise.normal()) as f32)
            .collect();
        Picture::from_f32(SIZE, SIZE, 1, values).unwrap()
    }
}

/// Returns the four sides of a square as spans that bound each other; `error` displaces the ends of
/// the paths.
pub fn spans(shape: &Shape, rise: f64, error: impl Fn(usize) -> [f64; 2]) -> Vec<EdgeSpan> {
    let corners = shape.corners();
    (0..4)
        .map(|side| {
            let [start, end] = [corners[side], corners[(side + 1) % 4]];
            let along = (end - start).normalize();
            let normal = Vector2::new(-along.y, along.x);
            let [at_start, at_end] = error(side);
            EdgeSpan {
                bounds: [Some((side + 3) % 4), Some((side + 1) % 4)],
                ..EdgeSpan::new(vec![start + normal * at_start, end + normal * at_end], rise)
            }
        })
        .collect()
}

/// Returns signed distances of a square's samples from its true sides, with their standard
/// deviations.
pub fn offsets(shape: &Shape, edges: &[SpanEdges]) -> Vec<Vec<(f64, f64)>> {
    let corners = shape.corners();
    edges
        .iter()
        .enumerate()
        .map(|(side, edges)| {
            let along = (corners[(side + 1) % 4] - corners[side]).normalize();
            let normal = Vector2::new(-along.y, along.x);
            let distance = |point: &Vector2<f64>| (point - corners[side]).dot(&normal);
            edges
                .points
                .iter()
                .map(distance)
                .zip(edges.std.iter().copied())
                .collect()
        })
        .collect()
}

pub fn measured(picture: &Picture, spans: &[EdgeSpan], tone: Tone) -> Vec<SpanEdges> {
    localise(picture, spans, tone)
        .0
        .into_iter()
        .collect::<Result<_, _>>()
        .unwrap()
}

#[derive(Debug)]
pub struct Statistics {
    pub bias: f64,
    pub rms: f64,
    pub normalised: f64,
    pub neighbours: f64,
    pub count: usize,
}

impl Statistics {
    pub fn of(sides: &[Vec<(f64, f64)>]) -> Self {
        let all: Vec<_> = sides.iter().flatten().copied().collect();
        let mean = |value: &dyn Fn(&(f64, f64)) -> f64| {
            all.iter().map(value).sum::<f64>() / all.len() as f64
        };
        let bias = mean(&|sample| sample.0);
        let square = mean(&|sample| sample.0 * sample.0);
        let pairs: Vec<f64> = sides
            .iter()
            .flat_map(|side| side.windows(2).map(|pair| pair[0].0 * pair[1].0))
            .collect();
        Self {
            bias,
            rms: square.sqrt(),
            normalised: mean(&|sample| (sample.0 / sample.1).powi(2)).sqrt(),
            neighbours: pairs.iter().sum::<f64>() / pairs.len() as f64 / square,
            count: all.len(),
        }
    }
}

pub const ANGLES: [f64; 4] = [3.0, 17.0, 31.0, 44.0];

pub fn square(degrees: f64) -> Shape {
    Shape::Square {
        centre: [209.3, 210.8],
        half: 135.2,
        degrees,
    }
}

/// Returns statistics of the samples from pictures of squares at several angles and with several
/// seeds.
pub fn statistics(camera: Camera, tone: Tone, error: [f64; 2]) -> Statistics {
    let rise = (camera.inside - camera.outside).signum();
    let mut sides = Vec::new();
    for degrees in ANGLES {
        let shape = square(degrees);
        let exposure = camera.exposure(&shape);
        for seed in 0..3 {
            let picture = camera.bytes(&exposure, seed);
            let edges = measured(&picture, &spans(&shape, rise, |_| error), tone);
            sides.extend(offsets(&shape, &edges));
        }
    }
    Statistics::of(&sides)
}

/// Returns the lower bound on the standard deviation from a patch of 4 pixels, for the noise,
/// contrast and blur of `camera`.
pub fn patch_bound(camera: &Camera) -> f64 {
    let spread = (camera.blur * camera.blur + 1.0 / 12.0).sqrt();
    let contrast = (camera.outside - camera.inside).abs();
    camera.noise / contrast * (2.0 * std::f64::consts::PI.sqrt() * spread / 4.0).sqrt()
}
