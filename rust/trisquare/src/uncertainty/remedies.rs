//! Remedies for a refused geometry: every remedy is tried before it is named.
//!
//! Holding a parameter is tried on the samples themselves. A change of the scene is tried on
//! noise-free samples: the planes, each where it is seen, are rotated or brought closer, and judged
//! by the same rule.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Matrix3, Rotation3, Unit, Vector2, Vector3};

use super::conditioning::{Conditioning, judged_parameters};
use crate::geometry::Pose;
use crate::ill_conditioning::{Cause, IllConditioning, Remedy};
use crate::lens::Lens;
use crate::numeric::Problem;
use crate::observations::{Fixed, ObservedPlane, View};
use crate::refine::EdgeProblem;

/// Tilts that are tried, in degrees; beyond, squares become slivers.
const TILTS: [f64; 8] = [15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0];

/// Enlargements that are tried.
const FACTORS: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 8.0];

/// Directions of the first square's tilt, as fractions of a turn, for all of which a remedy must
/// work.
const PHASES: [f64; 4] = [0.0, 0.07, 0.14, 0.21];

/// Number of samples of each side of an imagined scene, which stand for all of them.
const SAMPLES_PER_SIDE: usize = 16;

/// Largest standard deviation with a remedy, as a fraction of the limit: the photograph to come
/// differs from the imagined one.
pub(crate) const MARGIN: f64 = 0.7;

/// Ratio of the worst parameter's standard deviation to its limit below which the camera is taken
/// for the true one.
const KNOWN: f64 = 2.5;

/// Focal length that is assumed otherwise, in image widths: a long one, which shows least
/// perspective.
const ASSUMED_FOCAL: f64 = 1.5;

/// Distance outside the picture, as a fraction of its size, at which samples of an imagined scene
/// may lie: the scene could be moved.
const SLACK: f64 = 0.1;

/// Adds remedies to a refusal. `succeeds` returns whether a calibration with the given parameters
/// held succeeds.
pub(crate) fn add_remedies<L: Lens>(
    ill_conditioning: &mut IllConditioning,
    conditioning: &Conditioning<'_, L>,
    succeeds: impl Fn(Fixed) -> bool,
) {
    // Freeing a parameter helps only if its held value is wrong, and then nothing else helps.
    let freed = remedies_by_freeing(conditioning, &succeeds);
    if !freed.is_empty() {
        ill_conditioning.remedies = freed;
        return;
    }
    let mut remedies = remedies_by_holding(&conditioning.options.fixed, succeeds);
    // Another photograph is better than a principal point that is not known.
    let guess_position = remedies.iter().position(Remedy::is_of_principal_point);
    let scene_remedy = remedy_by_scene(conditioning, ill_conditioning);
    let insert_position = guess_position.unwrap_or(remedies.len());
    remedies.splice(insert_position..insert_position, scene_remedy);
    ill_conditioning.remedies = remedies;
}

/// Returns what has to be freed for a calibration to succeed.
fn remedies_by_freeing<L: Lens>(
    conditioning: &Conditioning<'_, L>,
    succeeds: impl Fn(Fixed) -> bool,
) -> Vec<Remedy> {
    let fixed = conditioning.options.fixed;
    let lens = &conditioning.view.lens;
    let pair = |held: Vector2<f64>| (held.x, held.y);
    let focal = Fixed {
        focal: false,
        ..fixed
    };
    let principal_point = Fixed {
        principal_point: false,
        ..fixed
    };
    let free_focal = Remedy::FreeFocal {
        held: pair(lens.focal()),
    };
    let free_principal_point = Remedy::FreePrincipalPoint {
        held: pair(lens.principal_point()),
    };
    let try_remedy = remedy_trial(&fixed, succeeds);
    let freed = try_remedy(free_focal, focal).into_iter();
    freed
        .chain(try_remedy(free_principal_point, principal_point))
        .collect()
}

/// Returns a remedy if it changes what is held, and a calibration then succeeds.
fn remedy_trial(
    current: &Fixed,
    succeeds: impl Fn(Fixed) -> bool,
) -> impl Fn(Remedy, Fixed) -> Option<Remedy> {
    move |remedy, held| (held != *current && succeeds(held)).then_some(remedy)
}

/// Returns what has to be held for a calibration to succeed.
fn remedies_by_holding(fixed: &Fixed, succeeds: impl Fn(Fixed) -> bool) -> Vec<Remedy> {
    let skew = Fixed {
        skew: true,
        ..*fixed
    };
    let aspect = Fixed {
        aspect: true,
        ..*fixed
    };
    let principal_point = Fixed {
        principal_point: true,
        ..*fixed
    };
    let both = Fixed {
        principal_point: true,
        ..aspect
    };
    let try_remedy = remedy_trial(fixed, succeeds);
    let single_remedies: Vec<Remedy> = try_remedy(Remedy::HoldSkew, skew)
        .into_iter()
        .chain(try_remedy(Remedy::FixAspect, aspect))
        .chain(try_remedy(Remedy::FixPrincipalPoint, principal_point))
        .collect();
    if !single_remedies.is_empty() || fixed.aspect || fixed.principal_point {
        return single_remedies;
    }
    let both = try_remedy(Remedy::FixAspectAndPrincipalPoint, both);
    both.into_iter().collect()
}

/// Returns how to show the planes for a calibration to succeed; `None` if nothing that was tried
/// suffices.
fn remedy_by_scene<L: Lens>(
    conditioning: &Conditioning<'_, L>,
    ill_conditioning: &IllConditioning,
) -> Option<Remedy> {
    let scene = ImaginedScene::new(conditioning, ill_conditioning);
    let may_enlarge = matches!(
        ill_conditioning.cause,
        Cause::Small { .. } | Cause::Huddled { .. }
    );
    let enlarged = FACTORS
        .into_iter()
        .find(|factor| may_enlarge && scene.is_lens_known && scene.suffices(None, *factor));
    if let Some(factor) = enlarged {
        return Some(Remedy::Enlarge { factor });
    }
    let tilts = |factor: f64| {
        let mut all = TILTS.into_iter();
        all.find(|degrees| scene.suffices(Some(*degrees), factor))
    };
    if let Some(degrees) = tilts(1.0) {
        return Some(Remedy::Tilt { degrees });
    }
    FACTORS.into_iter().find_map(|factor| {
        let degrees = tilts(factor)?;
        Some(Remedy::TiltAndEnlarge { degrees, factor })
    })
}

/// The same planes as another photograph might show them.
struct ImaginedScene<'a, 'b, L: Lens> {
    conditioning: &'a Conditioning<'b, L>,
    /// The planes with some of the samples, which stand for all.
    planes: Vec<ObservedPlane>,
    /// The noise scale for these samples.
    noise_scale: f64,
    lens: L,
    is_lens_known: bool,
}

impl<'a, 'b, L: Lens> ImaginedScene<'a, 'b, L> {
    fn new(conditioning: &'a Conditioning<'b, L>, ill_conditioning: &IllConditioning) -> Self {
        let found = conditioning.view.lens;
        let width = f64::from(conditioning.size.width);
        let is_lens_known = ill_conditioning.std < KNOWN * ill_conditioning.limit;
        let focal = ASSUMED_FOCAL * width;
        let centre = conditioning.size.centre();
        let assumed = Matrix3::new(focal, 0.0, centre.x, 0.0, focal, centre.y, 0.0, 0.0, 1.0);
        let planes: Vec<ObservedPlane> = conditioning
            .planes
            .iter()
            .map(|plane| plane.subsampled(SAMPLES_PER_SIDE))
            .collect();
        let count = |planes: &[ObservedPlane]| {
            let counts = planes.iter().map(|plane| plane.samples().count());
            counts.sum::<usize>() as f64
        };
        Self {
            conditioning,
            noise_scale: conditioning.noise_scale
                * (count(&planes) / count(conditioning.planes)).sqrt(),
            planes,
            lens: if is_lens_known {
                found
            } else {
                L::from_camera_matrix(&assumed)
            },
            is_lens_known,
        }
    }

    /// Whether the planes, tilted (or as they are) and enlarged, pass the rule with a margin.
    fn suffices(&self, tilt: Option<f64>, factor: f64) -> bool {
        let phases = if tilt.is_some() { &PHASES[..] } else { &[0.0] };
        phases.iter().all(|phase| {
            let ratio = self.limit_ratio(tilt, factor, *phase);
            ratio.is_some_and(|ratio| ratio <= MARGIN)
        })
    }

    /// Returns the worst standard deviation of the imagined scene as a fraction of its limit.
    fn limit_ratio(&self, tilt: Option<f64>, factor: f64, phase: f64) -> Option<f64> {
        let planes = &self.planes;
        let turn = if planes.len() == 2 {
            FRAC_PI_2
        } else {
            TAU / planes.len() as f64
        };
        let mut view = self.conditioning.view.clone();
        view.lens = self.lens;
        let mut imagined_planes = Vec::with_capacity(planes.len());
        for (i, plane) in planes.iter().enumerate() {
            let direction = TAU * phase + turn * i as f64;
            let tilt = tilt.map(|degrees| (degrees.to_radians(), direction));
            let (pose, plane) = self.imagined_plane(plane, i, tilt, factor)?;
            view.planes[i].pose = pose;
            imagined_planes.push(plane);
        }
        self.judged_limit_ratio(&view, &imagined_planes)
    }

    fn judged_limit_ratio(&self, view: &View<L>, planes: &[ObservedPlane]) -> Option<f64> {
        let free = self.conditioning.options.free_parameters();
        let judged = judged_parameters(&free);
        let (_, system) = EdgeProblem::new(planes, &judged, self.noise_scale).evaluate(view)?;
        let conditioning = Conditioning {
            view,
            planes,
            noise_scale: self.noise_scale,
            ..*self.conditioning
        };
        let weakest = conditioning.weakest(&system, &free, 1.0)?;
        Some(weakest.ratio())
    }

    /// Returns the pose of a plane rotated about the middle of its samples and brought closer, and
    /// its noise-free samples; `None` if they would leave the picture.
    fn imagined_plane(
        &self,
        plane: &ObservedPlane,
        index: usize,
        tilt: Option<(f64, f64)>,
        factor: f64,
    ) -> Option<(Pose, ObservedPlane)> {
        let view = self.conditioning.view;
        let old = view.planes[index].pose;
        let to_plane = old.homography().try_inverse()?;
        let on_plane = |pixel: &Vector2<f64>| {
            let pixel_ray = view.lens.unproject_with_jacobian(pixel)?;
            let point = to_plane * view.lens.direction(&pixel_ray);
            Some(point.xy() / point.z)
        };
        let count = plane.samples().count() as f64;
        let (mut middle, mut pixel) = (Vector2::zeros(), Vector2::zeros());
        for sample in plane.samples() {
            middle += on_plane(&sample.pixel)? / count;
            pixel += sample.pixel / count;
        }
        // Tilts are relative to the image plane: only planes in front of it are imagined.
        let ray = self.lens.unproject(&pixel).filter(|ray| ray.z > 0.0)?;
        let focal_ratio = self.lens.focal().x / view.lens.focal().x;
        let depth = old.transform(&middle).z * focal_ratio / factor;
        let rotation = match tilt {
            None => old.rotation,
            Some((angle, direction)) => {
                let axis = Vector3::new(direction.cos(), direction.sin(), 0.0);
                let spin = old.rotation.m21.atan2(old.rotation.m11);
                let tilted = Rotation3::from_axis_angle(&Unit::new_normalize(axis), angle);
                let spun = Rotation3::from_axis_angle(&Vector3::z_axis(), spin);
                (tilted * spun).into_inner()
            }
        };
        let pose = Pose {
            rotation,
            translation: ray / ray.z * depth - rotation * middle.push(0.0),
        };
        let mut imagined = plane.clone();
        for (f, figure) in imagined.figures.iter_mut().enumerate() {
            for side in &mut figure.sides {
                let state = &view.planes[index];
                let lines = state.model_lines(&view.lens, f, side);
                for (model, range) in lines.collect::<Option<Vec<_>>>()? {
                    let line = state.figures[f].line(&model.line);
                    for sample in &mut side.samples[range] {
                        let point = on_plane(&sample.pixel)?;
                        let on_line = point - line.xy() * line.dot(&point.push(1.0));
                        sample.pixel = self.lens.project(&pose.transform(&on_line))?;
                        self.is_inside(&sample.pixel).then_some(())?;
                    }
                }
            }
        }
        Some((pose, imagined))
    }

    fn is_inside(&self, pixel: &Vector2<f64>) -> bool {
        let centre = self.conditioning.size.centre();
        let offset = (pixel - centre).abs();
        offset.x <= centre.x * (1.0 + 2.0 * SLACK) && offset.y <= centre.y * (1.0 + 2.0 * SLACK)
    }
}
