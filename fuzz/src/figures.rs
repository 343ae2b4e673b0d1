//! Figures to calibrate from: squares and frames seen by a camera, and damage to them.

use nalgebra::{Rotation3, Unit, Vector2, Vector3};
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{Brown, Freedom, ImageSize, Lens, PlaneEdges, Polarity, Pose};

use crate::bytes::Bytes;

/// Maximum number of squares in a picture.
const MAX_PLANES: usize = 5;
/// Maximum number of samples per side: enough for every stage, few enough for a million cases.
const MAX_SAMPLES: usize = 12;
/// Size of a frame's inner outline, as a fraction of that of the outer one.
const INNER: f64 = 0.6;

/// Number of scenes to start from; a case's other bytes vary them.
const SCENES: u64 = 256;

/// Draws scenes in pictures of a given size: some without distortion, some with parallel planes.
pub fn scenes(size: ImageSize) -> Vec<Scene> {
    let drawn = (0..SCENES).map(|seed| {
        let options = SceneOptions {
            size,
            distortion: seed % 4 > 0,
            parallel: seed % 8 == 1,
        };
        Scene::random(seed, options)
    });
    drawn.collect()
}

/// A camera, and planes in front of it.
pub struct View {
    pub camera: Brown,
    pub size: ImageSize,
    pub poses: Vec<Pose>,
}

impl View {
    /// Picks one of `scenes`, which are drawn as in the tests; drawing one takes longer than a
    /// case.
    pub fn sound(bytes: &mut Bytes<'_>, scenes: &[Scene]) -> Self {
        let scene = &scenes[bytes.below(scenes.len())];
        Self {
            camera: scene.camera,
            size: scene.size,
            poses: scene.poses.clone(),
        }
    }

    /// Returns planes anywhere: edge-on, behind the camera, far away, intersecting each other.
    pub fn wild(bytes: &mut Bytes<'_>, size: ImageSize) -> Self {
        let poses = (0..bytes.below(MAX_PLANES + 1)).map(|_| wild_pose(bytes));
        Self {
            poses: poses.collect(),
            camera: bytes.camera(size),
            size,
        }
    }

    /// Returns the pixel of a point of a plane, or the point itself where the lens does not see it.
    pub fn see(&self, plane: usize, point: Vector2<f64>) -> Vector2<f64> {
        let seen = self.camera.project(&self.poses[plane].transform(&point));
        seen.unwrap_or(point)
    }

    /// Returns the sides of every square, or of a frame's two outlines, with noise.
    pub fn figures(&self, bytes: &mut Bytes<'_>) -> Vec<PlaneEdges> {
        let noise = bytes.power(-12.0, 1.5);
        let count = 2 + bytes.below(MAX_SAMPLES - 1);
        let mut figures = Vec::new();
        for plane in 0..self.poses.len() {
            let frame = bytes.once_in(4);
            for half in if frame {
                vec![0.5, 0.5 * INNER]
            } else {
                vec![0.5]
            } {
                let sides = (0..4).map(|side| self.side(plane, side, half, count, noise, bytes));
                let Ok(mut figure) = PlaneEdges::square(sides.collect()) else {
                    continue;
                };
                figure.plane = frame.then_some(plane as u64);
                figure.freedom = if half < 0.5 {
                    Freedom::Size
                } else {
                    Freedom::Auto
                };
                let inner = half < 0.5;
                figure.polarity = Some(if inner {
                    Polarity::LightInside
                } else {
                    Polarity::DarkInside
                });
                figures.push(figure);
            }
        }
        figures
    }

    fn side(
        &self,
        plane: usize,
        side: usize,
        half: f64,
        count: usize,
        noise: f64,
        bytes: &mut Bytes<'_>,
    ) -> Vec<Vector2<f64>> {
        let (a, b) = (corner(side, half), corner(side + 1, half));
        let mut state = bytes.seed();
        let mut disturbance = || {
            // Uniform numbers from a linear congruential generator: one seed takes fewer bytes.
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            noise * ((state >> 40) as f64 / (1u64 << 24) as f64 - 0.5)
        };
        (0..count)
            .map(|i| {
                let along = (i as f64 + 0.5) / count as f64;
                let seen = self.see(plane, a.lerp(&b, along));
                seen + Vector2::new(disturbance(), disturbance())
            })
            .collect()
    }
}

/// Returns corner `i` of the square with half side `half` at the origin.
pub fn corner(i: usize, half: f64) -> Vector2<f64> {
    let [x, y] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]][i % 4];
    Vector2::new(x, y) * half
}

fn wild_pose(bytes: &mut Bytes<'_>) -> Pose {
    let mut rotation = |low: f64, high: f64| {
        let axis = Vector3::from_fn(|_, _| bytes.between(-1.0, 1.0));
        let axis = Unit::try_new(axis, 1e-6).unwrap_or_else(Vector3::z_axis);
        Rotation3::from_axis_angle(&axis, bytes.between(low, high))
    };
    Pose {
        rotation: *rotation(-3.2, 3.2).matrix(),
        translation: Vector3::new(
            bytes.between(-2.0, 2.0),
            bytes.between(-2.0, 2.0),
            bytes.between(-1.0, 8.0) * bytes.power(-2.0, 2.0),
        ),
    }
}

/// Damages figures in several ways.
pub fn damage(figures: &mut [PlaneEdges], size: ImageSize, bytes: &mut Bytes<'_>) {
    for _ in 0..bytes.below(5) {
        if figures.is_empty() {
            return;
        }
        let number = bytes.below(figures.len());
        let count = figures.len() as u64;
        let figure = &mut figures[number];
        match bytes.below(14) {
            0 => figure.std = Some(stds(figure, bytes)),
            1 => figure.plane = Some(bytes.below(count as usize) as u64),
            2 => {
                let any = [
                    Freedom::Auto,
                    Freedom::Fixed,
                    Freedom::Size,
                    Freedom::Similarity,
                ];
                figure.freedom = bytes.pick(&any);
            }
            3 => figure.lines.reverse(),
            4 => figure.lines = bytes.lines(6),
            5 => figure.image = bytes.below(3),
            6 => {
                let (scale, shift) = (bytes.coefficient(), bytes.point(size));
                for p in figure.points.iter_mut().flatten() {
                    *p = *p * scale + shift;
                }
            }
            // A picture's number is a label and may be any integer.
            7 => figure.image = bytes.seed() as usize >> bytes.below(64),
            8 => figure.tone_drift = Some(drifts(figure, bytes)),
            _ => damage_side(figure, size, bytes),
        }
    }
}

fn drifts(figure: &PlaneEdges, bytes: &mut Bytes<'_>) -> Vec<Vec<Vector2<f64>>> {
    let drift = Vector2::new(bytes.between(-1.0, 1.0), bytes.between(-1.0, 1.0));
    let own = figure.points.iter().map(|side| vec![drift; side.len()]);
    own.collect()
}

fn stds(figure: &PlaneEdges, bytes: &mut Bytes<'_>) -> Vec<Vec<f64>> {
    let (common, odd) = (bytes.power(-6.0, 6.0), bytes.coefficient());
    let own = figure.points.iter().map(|side| vec![common; side.len()]);
    let mut all: Vec<Vec<f64>> = own.collect();
    if let Some(first) = all.first_mut().and_then(|side| side.first_mut()) {
        *first = odd;
    }
    all
}

fn damage_side(figure: &mut PlaneEdges, size: ImageSize, bytes: &mut Bytes<'_>) {
    if figure.points.is_empty() {
        return;
    }
    let number = bytes.below(figure.points.len());
    let (wrong, side) = (bytes.point(size), &mut figure.points[number]);
    if side.is_empty() {
        return;
    }
    let at = bytes.below(side.len());
    match bytes.below(6) {
        0 => side[at] = wrong,
        1 => side.iter_mut().for_each(|p| *p = wrong),
        2 => side.truncate(at),
        3 => side[at..].iter_mut().for_each(|p| *p += wrong * 0.01),
        4 => {
            let first = side[0];
            side[at..].iter_mut().for_each(|p| *p = first);
        }
        _ => side.iter_mut().for_each(|p| p.y = wrong.y),
    }
}
