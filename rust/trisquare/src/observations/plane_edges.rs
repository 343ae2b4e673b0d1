//! The input of a calibration: samples on the images of lines of planes.

use nalgebra::Vector2;

use super::relation::Relation;
use super::side_order::{SideOrder, stray_sample};
use crate::error::Error;
use crate::geometry::Line;

/// Which side of a figure's outline is dark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Polarity {
    /// The figure is dark on lighter ground.
    DarkInside,
    /// The figure is light on darker ground.
    LightInside,
}

/// The unknowns of a figure, whether it is a further one on a plane that another figure already
/// determines, or the first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Freedom {
    /// Its size if it lies concentric with the plane's first figure, otherwise all of the
    /// similarity.
    #[default]
    Auto,
    /// Nothing: its lines are in the plane's own coordinates.
    Fixed,
    /// Its size: it is concentric with the plane's first figure and has the same rotation.
    Size,
    /// Its size, rotation and place on the plane.
    Similarity,
    /// For the only figure on its plane: the factor by which its extent along X exceeds that of its
    /// lines, as for a rectangle of unknown aspect.
    Aspect,
    /// For the only figure on its plane: the offsets of all lines, which run along X or along Y.
    /// The outermost two of each direction form a rectangle as under [`Self::Aspect`], which
    /// defines the plane's coordinates.
    Offsets,
    /// All: the only line of a figure lies at an unknown place in space, on no plane.
    Line,
}

/// One flat figure: lines of a plane, or concentric circles, and samples on their images.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PlaneEdges {
    /// The figure's lines, in its own plane coordinates.
    pub lines: Vec<Line>,
    /// Radii of circles about the origin, for a figure of circles instead of lines; one that is
    /// `None` is estimated, but the first must be known.
    #[cfg_attr(feature = "serde", serde(default))]
    pub radii: Vec<Option<f64>>,
    /// Samples (pixels) on the image of each line or circle.
    pub points: Vec<Vec<Vector2<f64>>>,
    /// Standard deviation of each sample across its line, in pixels; 1 where absent.
    pub std: Option<Vec<Vec<f64>>>,
    /// Which side is dark; needed to fit the pixels.
    pub polarity: Option<Polarity>,
    /// Figures with equal numbers are on one physical plane; absent for a plane of its own.
    pub plane: Option<u64>,
    /// The picture that shows it: its index if photographs are given, else any number that the
    /// figures of one picture share.
    pub image: usize,
    /// The unknowns of the figure.
    pub freedom: Freedom,
    /// Displacement of each sample, in pixels, 10 at most, by one standard deviation of an error
    /// that all samples of a picture share, such as that of its estimated tone curve; absent if
    /// there is none.
    pub tone_drift: Option<Vec<Vec<Vector2<f64>>>>,
    /// Width of the plain border within a square's outline, in the lines' units: further inside is
    /// something else, such as the bits of a tag. Absent if unknown.
    pub border: Option<f64>,
    /// Prior standard deviation (px) of an error that all samples of a side share, left by a fault
    /// of the picture. It enters only the covariance, which lets the error rotate and bend the side
    /// a little as well: with a shift alone, the covariance of the camera would be too large.
    #[cfg_attr(feature = "serde", serde(default))]
    pub side_error: f64,
    /// Known relations of its plane to those of other figures of the picture, by the indices of
    /// these figures.
    #[cfg_attr(feature = "serde", serde(default))]
    pub relations: Vec<(usize, Relation)>,
}

impl PlaneEdges {
    /// Creates a square from the samples of its four sides, in order around it, in either
    /// direction.
    ///
    /// Corner `i` is where sides `i - 1` and `i` meet. The plane's origin is the square's centre,
    /// its X axis runs along side 0 and its Z axis away from the camera; the side is the unit.
    ///
    /// # Errors
    /// [`Error::TooFewLines`], [`Error::TooFewSamples`], [`Error::SampleNotFinite`], which name the
    /// figure 0; [`Error::InvalidArgument`] for more than four sides; and [`Error::CrossedSides`]
    /// if the sides do not follow each other around the square, or [`Error::StraySample`] if a
    /// single sample is the cause.
    pub fn square(sides: Vec<Vec<Vector2<f64>>>) -> Result<Self, Error> {
        Self::rectangle(sides, 1.0)
    }

    /// Creates a rectangle whose side 0 is `aspect` times as long as its side 1: as
    /// [`Self::square`], with the shorter side as the unit.
    ///
    /// # Errors
    /// As [`Self::square`]; [`Error::InvalidArgument`] if the aspect is not positive and finite.
    pub fn rectangle(sides: Vec<Vec<Vector2<f64>>>, aspect: f64) -> Result<Self, Error> {
        if !(aspect > 0.0 && aspect.is_finite()) {
            return Err(Error::InvalidArgument(format!(
                "the aspect of a rectangle must be positive and finite, not {aspect}"
            )));
        }
        let order = SideOrder::of(&sides).map_err(|error| match error {
            Error::CrossedSides { .. } => stray_sample(&sides).unwrap_or(error),
            _ => error,
        })?;
        let clockwise = order == SideOrder::Clockwise;
        let [bottom, right, top, left] = rectangle_lines(aspect.max(1.0), aspect.recip().max(1.0));
        let lines = match clockwise {
            true => [bottom, right, top, left],
            // The order that keeps X along side 0 and Z away from the camera.
            false => [top, right, bottom, left],
        };
        Ok(Self::new(lines.to_vec(), sides))
    }

    /// Creates a rectangle of unknown aspect: as [`Self::rectangle`], with side 1 as the unit.
    ///
    /// # Errors
    /// As [`Self::square`].
    pub fn rectangle_of_any_aspect(sides: Vec<Vec<Vector2<f64>>>) -> Result<Self, Error> {
        Ok(Self {
            freedom: Freedom::Aspect,
            ..Self::square(sides)?
        })
    }

    /// Creates two orthogonal families of parallel lines on a plane, such as a facade, with unknown
    /// offsets.
    ///
    /// The origin is the centre of the rectangle that the outermost two lines of each family form,
    /// and its extent along Y is the unit. X points from the line of `along_y` that is given first
    /// to the other one, Z away from the camera. Such a plane gives one equation for the camera.
    ///
    /// # Errors
    /// [`Error::TooFewParallels`] for fewer than two lines of a family,
    /// [`Error::CrossedParallels`], [`Error::TooFewSamples`], and [`Error::SampleNotFinite`].
    pub fn families(
        along_x: Vec<Vec<Vector2<f64>>>,
        along_y: Vec<Vec<Vector2<f64>>>,
    ) -> Result<Self, Error> {
        let through_origin = |normal| Line::with_unit_normal(normal, Vector2::zeros());
        let mut lines = vec![through_origin(Vector2::y()); along_x.len()];
        lines.resize(lines.len() + along_y.len(), through_origin(Vector2::x()));
        let points = along_x.into_iter().chain(along_y).collect();
        let edges = Self {
            freedom: Freedom::Offsets,
            ..Self::new(lines, points)
        };
        edges.check(0)?;
        Ok(edges)
    }

    /// Creates concentric circles from samples of each, with their radii in any unit; without
    /// radii, the first circle's is the unit, and the others are estimated.
    ///
    /// The plane's origin is their centre, its Z axis points away from the camera, and its rotation
    /// about that axis is arbitrary. A circle's image has five parameters, and so has its pose: a
    /// single circle does not constrain the camera. Of the ten parameters of two circles, five are
    /// the pose, two are equations for the camera, and three hold for any camera (two, if a radius
    /// is unknown).
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn circles(points: Vec<Vec<Vector2<f64>>>, radii: Option<&[f64]>) -> Result<Self, Error> {
        let radii = match radii {
            Some(radii) => radii.iter().map(|radius| Some(*radius)).collect(),
            None => (0..points.len())
                .map(|circle| (circle == 0).then_some(1.0))
                .collect(),
        };
        let found = Self {
            radii,
            ..Self::new(Vec::new(), points)
        };
        found.check(0)?;
        Ok(found)
    }

    /// Creates a straight line of the scene from its samples, at an unknown place in space.
    ///
    /// Its image has two parameters, so that it does not constrain the camera matrix. Its
    /// straightness constrains the lens's distortion and the centre of the distortion.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn line(points: Vec<Vector2<f64>>) -> Result<Self, Error> {
        let line = Line::with_unit_normal(Vector2::y(), Vector2::zeros());
        let found = Self {
            freedom: Freedom::Line,
            ..Self::new(vec![line], vec![points])
        };
        found.check(0)?;
        Ok(found)
    }

    /// Creates edges from samples on the images of the given lines, on a plane of their own.
    pub fn new(lines: Vec<Line>, points: Vec<Vec<Vector2<f64>>>) -> Self {
        Self {
            lines,
            radii: Vec::new(),
            points,
            std: None,
            polarity: None,
            plane: None,
            image: 0,
            freedom: Freedom::Auto,
            tone_drift: None,
            border: None,
            side_error: 0.0,
            relations: Vec::new(),
        }
    }

    /// Returns the same edges with at most `max_samples` samples of each line, evenly chosen.
    pub(crate) fn thinned(&self, max_samples: usize) -> Self {
        fn chosen<T: Clone>(lines: &[Vec<T>], max_samples: usize) -> Vec<Vec<T>> {
            let line = |samples: &Vec<T>| {
                let step = samples.len().div_ceil(max_samples.max(1)).max(1);
                samples.iter().step_by(step).cloned().collect()
            };
            lines.iter().map(line).collect()
        }
        Self {
            points: chosen(&self.points, max_samples),
            std: self.std.as_ref().map(|lines| chosen(lines, max_samples)),
            tone_drift: self
                .tone_drift
                .as_ref()
                .map(|lines| chosen(lines, max_samples)),
            ..self.clone()
        }
    }

    /// Returns the same samples for a figure whose lines are replaced by `other` of each.
    pub(crate) fn with_lines(&self, other: impl Fn(&Line) -> Line) -> Self {
        Self {
            lines: self.lines.iter().map(other).collect(),
            ..self.clone()
        }
    }

    /// Number of samples on all lines.
    pub fn sample_count(&self) -> usize {
        self.points.iter().map(Vec::len).sum()
    }
}

/// The sides of a rectangle at the origin, normals inward; side `i` runs from corner `i` to corner
/// `i + 1`, corner 0 at `(-width / 2, -height / 2)`, corner 1 at `(width / 2, -height / 2)`.
pub(crate) fn rectangle_lines(width: f64, height: f64) -> [Line; 4] {
    [
        (0.0, 1.0, height),
        (-1.0, 0.0, width),
        (0.0, -1.0, height),
        (1.0, 0.0, width),
    ]
    .map(|(a, b, extent)| {
        let normal = Vector2::new(a, b);
        Line::with_unit_normal(normal, normal * (-0.5 * extent))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(from: (f64, f64), to: (f64, f64)) -> Vec<Vector2<f64>> {
        let (a, b) = (Vector2::new(from.0, from.1), Vector2::new(to.0, to.1));
        (1..10).map(|i| a.lerp(&b, f64::from(i) / 10.0)).collect()
    }

    fn sides() -> Vec<Vec<Vector2<f64>>> {
        let c = [
            (100.0, 100.0),
            (300.0, 120.0),
            (280.0, 310.0),
            (90.0, 290.0),
        ];
        (0..4).map(|i| side(c[i], c[(i + 1) % 4])).collect()
    }

    #[test]
    fn of_a_rectangle_of_any_aspect_the_size_stays_that_of_side_1() {
        let found = PlaneEdges::rectangle_of_any_aspect(sides()).unwrap();
        assert_eq!(found.lines, PlaneEdges::square(sides()).unwrap().lines);
        assert_eq!(found.freedom, Freedom::Aspect);
    }

    #[test]
    fn either_way_round_keeps_x_along_side_0() {
        let forward = PlaneEdges::square(sides()).unwrap();
        assert_eq!(forward.lines[0].coefficients().as_slice(), [0.0, 1.0, 0.5]);
        let mut reversed = sides();
        reversed.reverse();
        let backward = PlaneEdges::square(reversed).unwrap();
        assert_eq!(
            backward.lines[0].coefficients().as_slice(),
            [0.0, -1.0, 0.5]
        );
        assert_eq!(backward.lines[1], forward.lines[1]);
    }

    #[test]
    fn the_shorter_side_of_a_rectangle_is_the_unit() {
        let offsets = |aspect| {
            let edges = PlaneEdges::rectangle(sides(), aspect).unwrap();
            [0, 1].map(|i: usize| edges.lines[i].coefficients().z)
        };
        assert_eq!(offsets(1.6), [0.5, 0.8]);
        assert_eq!(offsets(0.625), [0.8, 0.5]);
        assert!(PlaneEdges::rectangle(sides(), 0.0).is_err());
        assert!(PlaneEdges::rectangle(sides(), f64::INFINITY).is_err());
    }

    #[test]
    fn a_line_of_the_scene_has_three_samples_and_no_plane() {
        let points = |count| side((100.0, 100.0), (300.0, 120.0))[..count].to_vec();
        assert!(matches!(
            PlaneEdges::line(points(2)),
            Err(Error::TooFewSamples { needed: 3, .. })
        ));
        let line = PlaneEdges::line(points(3)).unwrap();
        let shared = PlaneEdges {
            plane: Some(0),
            ..line.clone()
        };
        assert!(matches!(shared.check(0), Err(Error::InvalidArgument(_))));
        let mut nan = line;
        nan.points[0][1].y = f64::NAN;
        assert!(matches!(
            nan.check(7),
            Err(Error::SampleNotFinite {
                figure: 7,
                line: 0,
                sample: 1
            })
        ));
    }

    #[test]
    fn samples_in_one_place_are_one() {
        let place = Vector2::new(100.0, 100.0);
        let mut edges = PlaneEdges::square(sides()).unwrap();
        edges.points[3] = vec![place; 9];
        let told = "line 3 of figure 0 has 1 different sample, but needs at least 2";
        for refused in [
            edges.check(0).unwrap_err(),
            PlaneEdges::square(edges.points).unwrap_err(),
        ] {
            assert_eq!(refused.to_string(), told);
        }
        let line = PlaneEdges::line(vec![place, place, 2.0 * place]);
        let circle = PlaneEdges::circles(vec![vec![place; 5]], None);
        for (refused, counts) in [(line, (2, 3)), (circle, (1, 5))] {
            assert!(matches!(
                refused,
                Err(Error::TooFewSamples { found, needed, .. }) if (found, needed) == counts
            ));
        }
    }

    #[test]
    fn sides_may_bulge_at_a_blunt_corner() {
        // A square as seen by a wide lens: one side 24 px off its chord, beside a short one.
        let c = [
            (1128.0, 35.0),
            (1034.0, 300.0),
            (934.0, 418.0),
            (887.0, 266.0),
        ];
        let mut bulging: Vec<Vec<Vector2<f64>>> =
            (0..4).map(|i| side(c[i], c[(i + 1) % 4])).collect();
        let (start, end) = (bulging[0][0], bulging[0][bulging[0].len() - 1]);
        let along = end - start;
        let across = Vector2::new(along.y, -along.x).normalize();
        for point in &mut bulging[0] {
            let fraction = (*point - start).dot(&along) / along.norm_squared();
            *point -= across * (96.0 * fraction * (1.0 - fraction));
        }
        assert!(PlaneEdges::square(bulging).is_ok());
    }

    #[test]
    fn one_sample_that_is_far_off_is_named() {
        for wild in [1e3, 1e4, -1e6] {
            let mut edges = sides();
            edges[2][3].x = wild;
            let error = PlaneEdges::square(edges).unwrap_err().of_figure(5);
            let expected = Error::StraySample {
                figure: 5,
                line: 2,
                sample: 3,
            };
            assert_eq!(error, expected);
        }
    }

    #[test]
    fn crossed_sides_and_bad_samples_are_refused() {
        let mut crossed = sides();
        crossed.swap(1, 2);
        assert!(matches!(
            PlaneEdges::square(crossed),
            Err(Error::CrossedSides { .. })
        ));
        let mut crossed = sides();
        crossed.swap(1, 2);
        let told = PlaneEdges::square(crossed).map_err(|error| error.of_figure(7).to_string());
        assert!(
            told.unwrap_err()
                .starts_with("the sides of figure 7 are not in order")
        );
        assert!(matches!(
            PlaneEdges::square(sides()[..3].to_vec()),
            Err(Error::TooFewLines { found: 3, .. })
        ));
        assert!(matches!(
            PlaneEdges::square([sides(), sides()].concat()),
            Err(Error::InvalidArgument(message)) if message.contains("not 8")
        ));
        for wild in [f64::NAN, f64::INFINITY, 1e12, -1e300] {
            let mut edges = sides();
            edges[2][3].x = wild;
            assert!(matches!(
                PlaneEdges::square(edges),
                Err(Error::SampleNotFinite {
                    figure: 0,
                    line: 2,
                    sample: 3
                })
            ));
        }
        let mut edges = PlaneEdges::square(sides()).unwrap();
        edges.std = Some(vec![vec![1.0; 9]; 3]);
        assert!(edges.check(0).is_err());
        let mut std = vec![vec![1.0; 9]; 4];
        std[1][4] = 0.0;
        edges.std = Some(std);
        let refused = edges.check(6).unwrap_err().to_string();
        assert!(
            refused.contains("sample 4 of line 1 of figure 6"),
            "{refused}"
        );
        let mut drift = vec![vec![Vector2::zeros(); 9]; 4];
        edges.std = None;
        for wild in [f64::NAN, -f64::INFINITY, 1e308, -10.1] {
            drift[3][8].y = wild;
            edges.tone_drift = Some(drift.clone());
            let refused = edges.check(6).unwrap_err().to_string();
            assert!(
                refused.contains("sample 8 of line 3 of figure 6"),
                "{refused}"
            );
        }
        edges.tone_drift = None;
        edges.std = None;
        edges.border = Some(0.1);
        assert!(edges.check(0).is_ok());
        for border in [0.0, f64::NAN, f64::INFINITY] {
            edges.border = Some(border);
            let refused = edges.check(5).unwrap_err().to_string();
            assert!(refused.contains("border of figure 5"), "{refused}");
        }
    }
}
