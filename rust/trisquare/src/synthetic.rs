//! Seeded scenes with known truth, for tests and benchmarks.
//!
//! Three squares over the picture, tilted 25 to 50 degrees in directions about 120 degrees apart,
//! seen by a random camera with moderate distortion.

use nalgebra::{Matrix3, Rotation3, Unit, Vector2, Vector3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use crate::error::Error;
use crate::geometry::Pose;
use crate::image::{Picture, Tone};
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, INTRINSICS, Lens};
use crate::numeric::cdf;
use crate::observations::{PlaneEdges, rectangle_lines};

/// Positions of the squares, as fractions of the picture.
const PLACES: [(f64, f64); 3] = [(0.23, 0.3), (0.77, 0.3), (0.5, 0.72)];

/// Minimum distance (pixels) of samples from the corners and from the picture's border.
const MARGIN: f64 = 3.0;

/// Maximum number of draws for a scene; a few suffice.
const MAX_DRAWS: usize = 1000;

/// Light of the squares and of the ground in a picture, 1 being white.
const INK: f64 = 0.03;
const GROUND: f64 = 0.6;

/// Variance of a pixel's box, px^2.
const BOX_VARIANCE: f64 = 1.0 / 12.0;

/// A camera and the squares that it sees.
#[derive(Debug, Clone)]
pub struct Scene<L = DefaultLens> {
    /// The true camera.
    pub camera: L,
    /// The picture's size.
    pub size: ImageSize,
    /// `cam_from_plane` of every square, in units of its side.
    pub poses: Vec<Pose>,
}

/// Options of a random scene.
#[derive(Debug, Clone, Copy)]
pub struct SceneOptions {
    /// The picture's size.
    pub size: ImageSize,
    /// Whether the lens distorts.
    pub distortion: bool,
    /// Whether all squares are parallel (equally tilted, with different rotations and positions).
    pub parallel: bool,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            size: ImageSize {
                width: 1280,
                height: 960,
            },
            distortion: true,
            parallel: false,
        }
    }
}

impl Scene {
    /// Draws a scene of three squares; equal seeds give equal scenes.
    ///
    /// # Panics
    /// If no scene inside the picture is found, which does not happen for pictures of ordinary
    /// shape.
    pub fn random(seed: u64, options: SceneOptions) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        Self::draw(&mut rng, options, |rng| random_camera(rng, options))
    }
}

impl<L: Lens> Scene<L> {
    /// Draws a scene of three squares seen by a given camera.
    ///
    /// # Panics
    /// As [`Scene::random`].
    pub fn seen_by(camera: L, seed: u64, options: SceneOptions) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        Self::draw(&mut rng, options, |_| camera)
    }

    /// Draws the scene of another picture of the same camera.
    ///
    /// # Panics
    /// As [`Scene::random`].
    #[must_use]
    pub fn another(&self, seed: u64) -> Self {
        let options = SceneOptions {
            size: self.size,
            ..SceneOptions::default()
        };
        Self::seen_by(self.camera, seed, options)
    }

    fn draw(
        rng: &mut StdRng,
        options: SceneOptions,
        mut camera: impl FnMut(&mut StdRng) -> L,
    ) -> Self {
        for _ in 0..MAX_DRAWS {
            let camera = camera(rng);
            if let Some(poses) = random_poses(rng, &camera, options) {
                return Self {
                    camera,
                    size: options.size,
                    poses,
                };
            }
        }
        panic!("no scene found in {MAX_DRAWS} draws")
    }

    /// Samples of every side, `spacing` pixels apart, with isotropic noise of `noise` pixels.
    ///
    /// # Panics
    /// If the spacing is not positive.
    pub fn edges(&self, seed: u64, noise: f64, spacing: f64) -> Vec<PlaneEdges> {
        let ends: Vec<_> = (0..4).map(|i| (corner(i), corner(i + 1))).collect();
        let squares = self.measured(&ends, seed, noise, spacing).into_iter();
        squares
            .map(|sides| PlaneEdges::new(rectangle_lines(1.0, 1.0).to_vec(), sides))
            .collect()
    }

    /// Samples of lines across every square, as on facades: lines along X at the first values of Y,
    /// then lines along Y at the second values of X; otherwise as [`Scene::edges`].
    ///
    /// # Errors
    /// As [`PlaneEdges::families`].
    ///
    /// # Panics
    /// As [`Scene::edges`].
    pub fn facades(
        &self,
        places: [&[f64]; 2],
        seed: u64,
        noise: f64,
        spacing: f64,
    ) -> Result<Vec<PlaneEdges>, Error> {
        let [along_x, along_y] = places;
        let across = |y: f64| (Vector2::new(-0.5, y), Vector2::new(0.5, y));
        let ends = along_x.iter().map(|y| across(*y));
        let down = along_y.iter().map(|x| across(*x));
        let down = down.map(|(start, end)| (start.yx(), end.yx()));
        let facades = self.measured(&ends.chain(down).collect::<Vec<_>>(), seed, noise, spacing);
        let families = facades.into_iter().map(|mut lines| {
            let along_y = lines.split_off(along_x.len());
            PlaneEdges::families(lines, along_y)
        });
        families.collect()
    }

    /// The picture of the squares, dark on light ground: 8-bit grey under the sRGB curve.
    ///
    /// `blur` is the standard deviation of the optics' blur in pixels, `noise` that of the pixels
    /// in grey levels. The fraction of a pixel covered by a square is the product of the normal
    /// distribution function of its distances to the images of the four sides.
    ///
    /// # Panics
    /// If the size is zero.
    pub fn picture(&self, seed: u64, blur: f64, noise: f64) -> Picture {
        let mut rng = StdRng::seed_from_u64(seed);
        let blur = (blur * blur + BOX_VARIANCE).sqrt();
        let sides: Vec<[Vector3<f64>; 4]> = self.poses.iter().map(sides_seen).collect();
        let [width, height] = [self.size.width, self.size.height];
        let mut values = Vec::with_capacity(width as usize * height as usize);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let pixel = Vector2::new(f64::from(x), f64::from(y));
            let share = self.camera.unproject_with_jacobian(&pixel).map(|ray| {
                let cover = |line: &Vector3<f64>| cdf(self.camera.line_distance(&ray, line) / blur);
                let of_square =
                    |lines: &[Vector3<f64>; 4]| lines.iter().map(cover).product::<f64>();
                sides.iter().map(of_square).sum::<f64>()
            });
            let light = GROUND + (INK - GROUND) * share.unwrap_or(0.0);
            let coded = 255.0 * Tone::Srgb.encode(light);
            values.push((coded + noise * rng.sample::<f64, _>(StandardNormal)).round() as u8);
        }
        Picture::from_u8(width as usize, height as usize, 1, values)
            .expect("a scene has a picture that is not empty")
    }

    /// Pixels of the corners of every square, clockwise on the screen.
    ///
    /// # Panics
    /// If the lens does not see one of them, which does not happen in random scenes.
    pub fn corners(&self) -> Vec<[Vector2<f64>; 4]> {
        let seen = |pose: &Pose, i| self.camera.project(&pose.transform(&corner(i)));
        let of_square = |pose: &Pose| [0, 1, 2, 3].map(|i| seen(pose, i).expect("it is seen"));
        self.poses.iter().map(of_square).collect()
    }

    /// Samples between the ends of lines on every plane.
    fn measured(
        &self,
        ends: &[(Vector2<f64>, Vector2<f64>)],
        seed: u64,
        noise: f64,
        spacing: f64,
    ) -> Vec<Vec<Vec<Vector2<f64>>>> {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut normal = || noise * rng.sample::<f64, _>(StandardNormal);
        let mut line = |pose, ends| {
            let points = points_between(&self.camera, pose, ends, spacing).into_iter();
            points
                .map(|p| p + Vector2::new(normal(), normal()))
                .collect()
        };
        let poses = self.poses.iter();
        poses
            .map(|pose| ends.iter().map(|ends| line(pose, *ends)).collect())
            .collect()
    }
}

/// The sides of a unit square as planes through the camera centre, positive inside.
fn sides_seen(pose: &Pose) -> [Vector3<f64>; 4] {
    rectangle_lines(1.0, 1.0).map(|side| pose.line_map() * side.coefficients())
}

/// Corner `i` of the unit square at the origin.
fn corner(i: usize) -> Vector2<f64> {
    let [x, y] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]][i % 4];
    Vector2::new(x, y)
}

fn points_between<L: Lens>(
    camera: &L,
    pose: &Pose,
    (a, b): (Vector2<f64>, Vector2<f64>),
    spacing: f64,
) -> Vec<Vector2<f64>> {
    assert!(spacing > 0.0, "spacing must be positive, not {spacing}");
    let see = |t: f64| camera.project(&pose.transform(&a.lerp(&b, t)));
    let (Some(start), Some(end)) = (see(0.0), see(1.0)) else {
        return Vec::new();
    };
    let length = (end - start).norm();
    let count = (length / spacing).floor().max(2.0) as usize;
    let margin = MARGIN / length;
    (0..count)
        .filter_map(|i| see(margin + (1.0 - 2.0 * margin) * i as f64 / (count - 1) as f64))
        .collect()
}

fn random_camera(rng: &mut StdRng, options: SceneOptions) -> DefaultLens {
    let width = f64::from(options.size.width);
    let centre = options.size.centre();
    loop {
        let focal = width * rng.random_range(0.65..1.3);
        let aspect: f64 = rng.random_range(0.995..1.005);
        let mut offset = || 0.012 * width * rng.sample::<f64, _>(StandardNormal);
        let (cx, cy) = (centre.x + offset(), centre.y + offset());
        let (mut k1, mut k2) = (0.0, 0.0);
        if options.distortion {
            k1 = rng.random_range(-0.32..0.12);
            k2 = rng.random_range(0.0..0.35) * f64::abs(k1);
        }
        let k = Matrix3::new(focal, 0.0, cx, 0.0, focal * aspect, cy, 0.0, 0.0, 1.0);
        let mut parameters = DefaultLens::from_camera_matrix(&k).parameters();
        parameters[INTRINSICS..INTRINSICS + 2].copy_from_slice(&[k1, k2]);
        let camera = DefaultLens::from_camera_matrix(&k).with_parameters(&parameters);
        let far = 1.05;
        let monotonic = options.size.corners().iter().all(|c| {
            let stretched = centre + (c - centre) * far;
            camera.unproject_with_jacobian(&stretched).is_some()
        });
        if monotonic {
            return camera;
        }
    }
}

fn random_poses<L: Lens>(rng: &mut StdRng, camera: &L, options: SceneOptions) -> Option<Vec<Pose>> {
    let (width, height) = (
        f64::from(options.size.width),
        f64::from(options.size.height),
    );
    let first_direction = rng.random_range(0.0..std::f64::consts::TAU);
    let common_tilt = rng.random_range(25.0..50.0f64);
    let mut poses = Vec::with_capacity(PLACES.len());
    for (i, (x, y)) in PLACES.iter().enumerate() {
        let mut tilt = rng.random_range(25.0..50.0f64);
        let spread = 120.0 * i as f64 + rng.random_range(-20.0..20.0);
        let mut direction = first_direction + f64::to_radians(spread);
        if options.parallel {
            (tilt, direction) = (common_tilt, first_direction);
        }
        let turn = rng.random_range(0.0..std::f64::consts::TAU);
        let side = height * rng.random_range(0.30..0.42);
        let axis = Unit::new_normalize(Vector3::new(direction.cos(), direction.sin(), 0.0));
        let tilted = Rotation3::from_axis_angle(&axis, tilt.to_radians());
        let rotation: Matrix3<f64> =
            *(tilted * Rotation3::from_axis_angle(&Vector3::z_axis(), turn)).matrix();
        let ray = camera.unproject(&Vector2::new(x * width, y * height))?;
        let pose = Pose {
            rotation,
            translation: ray / ray.z * (camera.focal().x / side),
        };
        let inside = (0..4).all(|i| {
            camera
                .project(&pose.transform(&corner(i)))
                .is_some_and(|p| {
                    p.x > MARGIN && p.y > MARGIN && p.x < width - MARGIN && p.y < height - MARGIN
                })
        });
        if !inside || pose.normal().dot(&pose.translation) <= 0.0 {
            return None;
        }
        poses.push(pose);
    }
    Some(poses)
}
