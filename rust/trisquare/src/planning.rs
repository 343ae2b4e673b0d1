//! Prediction of the standard deviations of a planned photograph.
//!
//! The information is that of noise-free samples along the planned squares' edges, by the same
//! normal equations, covariance and checks as in a calibration: a plan whose photograph would be
//! refused is refused here, for the same reason.

use nalgebra::{DMatrix, Vector2};

use crate::error::Error;
use crate::geometry::{Line, Pose};
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::numeric::{ArrowSystem, Problem};
use crate::observations::{
    Curve, Figure, Fixed, FreeParameters, Freedom, ObservedPlane, Options, Placement, PlaneState,
    Sample, Side, View,
};
use crate::refine::EdgeProblem;
use crate::result::deviations;
use crate::uncertainty::{
    Conditioning, add_remedies, check_plane_count, covariance, judged_parameters,
};

/// Number of samples per side; more would change nothing, since the information varies slowly along
/// it.
const SAMPLES_PER_SIDE: usize = 64;

/// A planned plane.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedPlane {
    /// `cam_from_plane`.
    pub pose: Pose,
    /// Corners of the figures on it, in plane units: the first one defines the unit of the plane;
    /// further ones, concentric with it, have unknown sizes.
    pub outlines: Vec<[Vector2<f64>; 4]>,
}

impl PlannedPlane {
    /// A square of unit side about the plane's origin.
    pub fn square(pose: Pose) -> Self {
        Self {
            pose,
            outlines: vec![square_of_side(1.0)],
        }
    }

    /// A square with a square hole of side `inner`.
    pub fn frame(pose: Pose, inner: f64) -> Self {
        Self {
            pose,
            outlines: vec![square_of_side(1.0), square_of_side(inner)],
        }
    }
}

fn square_of_side(side: f64) -> [Vector2<f64>; 4] {
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| Vector2::new(x, y) * side)
}

/// Expected accuracy of an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeNoise {
    /// Standard deviation of one sample across its edge, in pixels.
    pub sigma: f64,
    /// Distance between samples along the edge, in pixels.
    pub spacing: f64,
}

/// Predicted uncertainty of the camera.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Prediction {
    /// Names of the free parameters, in the order of the covariance.
    pub parameters: Vec<&'static str>,
    /// Covariance of the free parameters.
    pub covariance: DMatrix<f64>,
    /// `fy / fx` if `fy` follows `fx`.
    pub aspect: Option<f64>,
}

impl Prediction {
    /// One standard deviation of every free parameter (and of `fy` if it follows `fx`).
    pub fn std(&self) -> Vec<(&'static str, f64)> {
        deviations(&self.parameters, &self.covariance, self.aspect)
    }
}

/// Predicts the uncertainty of a camera calibrated from planned planes.
///
/// The Cramer-Rao bound, which the refinement attains: the inverse of `sum J^T J / sigma^2` over
/// the samples, with the planes' own parameters eliminated. Parameters fixed by `options` have the
/// camera's values; lengths in pixels, poses in units of the squares' sides.
///
/// ```
/// use nalgebra::{Rotation3, Vector3};
/// use trisquare::{Brown, EdgeNoise, ImageSize, Options, PlannedPlane, Pose, predict};
///
/// let camera = Brown::new([900.0, 900.0, 639.5, 479.5, -0.1, 0.0, 0.0, 0.0, 0.0]);
/// let square = |tilt: [f64; 3], x, y| {
///     PlannedPlane::square(Pose {
///         rotation: *Rotation3::new(Vector3::from(tilt)).matrix(),
///         translation: Vector3::new(x, y, 3.0),
///     })
/// };
/// let planes = [
///     square([0.6, 0.0, 0.1], -0.8, -0.5),
///     square([-0.3, 0.5, 0.0], 0.8, -0.5),
///     square([-0.3, -0.5, 0.2], 0.0, 0.7),
/// ];
/// let size = ImageSize { width: 1280, height: 960 };
/// let noise = EdgeNoise { sigma: 0.02, spacing: 4.0 };
/// let found = predict(&camera, size, &planes, noise, &Options::default())?;
/// assert_eq!(found.std()[0].0, "fx");
/// assert!(found.std()[0].1 < 1.0);
/// # Ok::<(), trisquare::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidArgument`] with the index of a square that is not wholly in the picture,
/// [`Error::NotEnoughPlanes`], and [`Error::IllConditioned`] for a plan that a calibration would
/// refuse.
pub fn predict<L: Lens>(
    camera: &L,
    size: ImageSize,
    planes: &[PlannedPlane],
    noise: EdgeNoise,
    options: &Options<L>,
) -> Result<Prediction, Error> {
    let plan = Plan::new(camera, size, planes, noise, options)?;
    match plan.judge(plan.options.fixed) {
        Ok(()) => plan.prediction(),
        Err(Error::IllConditioned(mut ill_conditioning)) => {
            let conditioning = plan.conditioning(&plan.options);
            let succeeds = |fixed| plan.judge(fixed).is_ok();
            add_remedies(&mut ill_conditioning, &conditioning, succeeds);
            Err(Error::IllConditioned(ill_conditioning))
        }
        Err(other) => Err(other),
    }
}

/// As [`predict`], but not refused because of large standard deviations: for comparisons of
/// set-ups.
///
/// # Errors
/// As [`predict`]; [`Error::NotConverged`] if nothing is determined.
pub fn predict_unjudged<L: Lens>(
    camera: &L,
    size: ImageSize,
    planes: &[PlannedPlane],
    noise: EdgeNoise,
    options: &Options<L>,
) -> Result<Prediction, Error> {
    Plan::new(camera, size, planes, noise, options)?.prediction()
}

/// A planned scene.
struct Plan<L: Lens> {
    view: View<L>,
    observed_planes: Vec<ObservedPlane>,
    size: ImageSize,
    options: Options<L>,
}

impl<L: Lens> Plan<L> {
    fn new(
        camera: &L,
        size: ImageSize,
        planes: &[PlannedPlane],
        noise: EdgeNoise,
        options: &Options<L>,
    ) -> Result<Self, Error> {
        size.check()?;
        let options = Options {
            initial: Some(*camera),
            ..*options
        };
        options.check()?;
        if ![noise.sigma, noise.spacing]
            .iter()
            .all(|v| v.is_finite() && *v > 0.0)
        {
            return Err(Error::InvalidArgument(
                "the noise and the spacing of the samples must be positive and finite".into(),
            ));
        }
        check_plane_count(planes.len(), &options.free_parameters())?;
        let photograph = |(index, plane)| photographed(camera, size, plane, index, noise);
        Ok(Self {
            observed_planes: planes
                .iter()
                .enumerate()
                .map(photograph)
                .collect::<Result<_, _>>()?,
            view: View {
                lens: *camera,
                planes: planes.iter().map(state).collect(),
                relations: Vec::new(),
            },
            size,
            options,
        })
    }

    fn conditioning<'a>(&'a self, options: &'a Options<L>) -> Conditioning<'a, L> {
        Conditioning {
            view: &self.view,
            planes: &self.observed_planes,
            size: self.size,
            options,
            noise_scale: 1.0,
        }
    }

    fn system(&self, free: &FreeParameters) -> Result<ArrowSystem, Error> {
        let found = EdgeProblem::new(&self.observed_planes, free, 1.0).evaluate(&self.view);
        found.map(|(_, system)| system).ok_or_else(|| {
            Error::InvalidArgument("an edge lies where the lens is not invertible".into())
        })
    }

    /// Checks the geometry as a calibration with `fixed` does.
    fn judge(&self, fixed: Fixed) -> Result<(), Error> {
        let options = Options {
            fixed,
            ..self.options
        };
        let free = options.free_parameters();
        let system = self.system(&judged_parameters(&free))?;
        let conditioning = self.conditioning(&options);
        match conditioning.ill_conditioning(&system, &free, 1.0) {
            Some(found) => Err(Error::IllConditioned(Box::new(found))),
            None => Ok(()),
        }
    }

    fn prediction(&self) -> Result<Prediction, Error> {
        let free = self.options.free_parameters();
        let covariance = covariance(&self.system(&free)?, 1.0).ok_or(Error::NotConverged {
            stage: "the covariance",
            iterations: 0,
            rms: 0.0,
        })?;
        let focal = self.view.lens.focal();
        Ok(Prediction {
            parameters: free.names(),
            covariance,
            aspect: free.aspect_is_fixed().then_some(focal.y / focal.x),
        })
    }
}

/// State of a plane, with the sizes of its further figures free.
fn state(plane: &PlannedPlane) -> PlaneState {
    let further = Placement {
        free: Placement::SIZE,
        ..Placement::IDENTITY
    };
    let mut figures = vec![further; plane.outlines.len()];
    figures[0] = Placement::IDENTITY;
    PlaneState {
        pose: plane.pose,
        figures,
    }
}

/// Noise-free samples of a plane's figures.
fn photographed<L: Lens>(
    camera: &L,
    size: ImageSize,
    plane: &PlannedPlane,
    index: usize,
    noise: EdgeNoise,
) -> Result<ObservedPlane, Error> {
    if plane.outlines.is_empty() {
        return Err(Error::InvalidArgument(format!(
            "square {index} has no outline"
        )));
    }
    if plane.pose.normal().dot(&plane.pose.translation) <= 0.0 {
        return Err(Error::InvalidArgument(format!(
            "square {index} is seen from behind or edge-on: its Z axis must point away from the \
             camera"
        )));
    }
    let mut figures = Vec::with_capacity(plane.outlines.len());
    for (f, outline) in plane.outlines.iter().enumerate() {
        let mut sides = Vec::with_capacity(outline.len());
        for i in 0..outline.len() {
            let ends = (outline[i], outline[(i + 1) % outline.len()]);
            sides.push(side(camera, size, (plane, index), (i, ends), noise)?);
        }
        figures.push(Figure {
            index: f,
            freedom: Freedom::Size,
            sides,
        });
    }
    Ok(ObservedPlane {
        image: 0,
        figures,
        deformation: None,
        side_error: 0.0,
        relations: Vec::new(),
    })
}

/// Samples of one side, evenly spaced, each weighted by the part of the side that it represents.
fn side<L: Lens>(
    camera: &L,
    size: ImageSize,
    (plane, index): (&PlannedPlane, usize),
    (number, (start, end)): (usize, (Vector2<f64>, Vector2<f64>)),
    noise: EdgeNoise,
) -> Result<Side, Error> {
    let extent = size.centre() * 2.0;
    let projection = |fraction: f64| {
        let point = plane.pose.transform(&start.lerp(&end, fraction));
        let pixel = camera.project(&point);
        let is_inside =
            |p: &Vector2<f64>| p.x >= 0.0 && p.y >= 0.0 && p.x <= extent.x && p.y <= extent.y;
        pixel.filter(is_inside).ok_or_else(|| {
            Error::InvalidArgument(if point.z > 0.0 {
                format!("square {index} is not wholly in the picture")
            } else {
                format!("square {index} is not wholly in front of the camera")
            })
        })
    };
    let normal = (end - start).normalize();
    let line = Line::with_unit_normal(Vector2::new(-normal.y, normal.x), start);
    let parts = SAMPLES_PER_SIDE as f64;
    let mut samples = Vec::with_capacity(SAMPLES_PER_SIDE);
    let mut from = projection(0.0)?;
    for i in 0..SAMPLES_PER_SIDE {
        let to = projection((i + 1) as f64 / parts)?;
        let count = (to - from).norm() / noise.spacing;
        samples.push(Sample {
            pixel: projection((i as f64 + 0.5) / parts)?,
            weight: count.sqrt() / noise.sigma,
            index: i,
        });
        from = to;
    }
    Ok(Side {
        curve: Curve::Line(line),
        number,
        samples,
        tone_drift: Vec::new(),
        is_outlier: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate;
    use crate::error::ErrorKind;
    use crate::ill_conditioning::Remedy;
    use crate::synthetic::{Scene, SceneOptions};

    const NOISE: EdgeNoise = EdgeNoise {
        sigma: 0.1,
        spacing: 4.0,
    };

    fn plan(scene: &Scene) -> Vec<PlannedPlane> {
        let poses = scene.poses.iter();
        poses.map(|pose| PlannedPlane::square(*pose)).collect()
    }

    /// A calibration's standard deviations are those predicted, except for the effect of missing
    /// samples at the corners.
    #[test]
    fn prediction_is_what_a_calibration_states() {
        let scene = Scene::random(3, SceneOptions::default());
        let options = Options::default();
        let found = predict(&scene.camera, scene.size, &plan(&scene), NOISE, &options).unwrap();
        let edges = scene.edges(1, NOISE.sigma, NOISE.spacing);
        let stated = calibrate(&edges, scene.size, &options).unwrap();
        for ((name, predicted), (_, stated)) in found.std().iter().zip(stated.std()) {
            let ratio = predicted / stated;
            assert!((0.85..1.1).contains(&ratio), "{name}: {ratio}");
        }
    }

    /// Frames determine the camera better than squares, and half the noise halves the standard
    /// deviation.
    #[test]
    fn prediction_follows_figures_and_noise() {
        let scene = Scene::random(4, SceneOptions::default());
        let std = |planes: &[PlannedPlane], sigma: f64| {
            let noise = EdgeNoise { sigma, ..NOISE };
            let options = Options::default();
            let found = predict(&scene.camera, scene.size, planes, noise, &options).unwrap();
            found.std()[0].1
        };
        let squares = plan(&scene);
        let frames: Vec<_> = scene
            .poses
            .iter()
            .map(|pose| PlannedPlane::frame(*pose, 0.6))
            .collect();
        assert!((std(&squares, 0.1) / std(&squares, 0.05) - 2.0).abs() < 1e-9);
        let gain = std(&frames, 0.1) / std(&squares, 0.1);
        assert!((0.5..0.9).contains(&gain), "{gain}");
    }

    #[test]
    fn a_bad_plan_is_refused_like_its_photograph() {
        let parallel = SceneOptions {
            parallel: true,
            ..SceneOptions::default()
        };
        let scene = Scene::random(5, parallel);
        let try_plan = |planes: &[PlannedPlane], fixed: Fixed| {
            let options = Options {
                fixed,
                ..Options::default()
            };
            predict(&scene.camera, scene.size, planes, NOISE, &options)
        };
        let Err(Error::IllConditioned(ill_conditioning)) =
            try_plan(&plan(&scene), Fixed::default())
        else {
            panic!("parallel squares were not refused");
        };
        assert!(
            ill_conditioning
                .remedies
                .contains(&Remedy::FixPrincipalPoint),
            "{ill_conditioning}"
        );
        let held = Fixed {
            principal_point: true,
            ..Fixed::default()
        };
        assert!(try_plan(&plan(&scene), held).is_ok());

        let mut outside = plan(&scene);
        outside[1].pose.translation.x += 3.0;
        let error = try_plan(&outside, Fixed::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert!(error.to_string().contains("square 1"), "{error}");
        let error = try_plan(&outside[..1], Fixed::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NotEnoughPlanes);
    }
}
