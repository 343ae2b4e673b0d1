//! State of every fit: a camera and the planes that it sees.

use std::ops::Range;

use nalgebra::{DMatrix, Vector2, Vector3};

use super::curve::{Curve, ModelLine, Radius};
use super::free_parameters::FreeParameters;
use super::observed::Side;
use super::placement::{Placement, PlacementParameter::Angle};
use super::relation::Related;
use crate::geometry::{Line, Pose};
use crate::lens::{Columns, Lens};
use crate::numeric::ArrowStep;

/// Number of parameters of a pose: rotation vector, translation.
pub(crate) const POSE_PARAMETERS: usize = 6;

/// A camera and the planes it sees.
#[derive(Debug, Clone)]
pub(crate) struct View<L> {
    pub lens: L,
    pub planes: Vec<PlaneState>,
    /// Known relations between planes, which the states satisfy.
    pub relations: Vec<Related>,
}

/// The pose of a plane, and the placements of its figures.
#[derive(Debug, Clone)]
pub(crate) struct PlaneState {
    pub pose: Pose,
    pub figures: Vec<Placement>,
}

impl PlaneState {
    pub fn parameter_count(&self) -> usize {
        let figures = self.figures.iter();
        POSE_PARAMETERS + figures.map(Placement::parameter_count).sum::<usize>()
    }

    /// Number of parameters that its samples may determine.
    pub fn unknowns(&self) -> usize {
        self.parameter_count() - usize::from(self.turns_freely())
    }

    /// Whether a rotation about its normal changes nothing, as with circles, and figures beside
    /// them that rotate with it.
    fn turns_freely(&self) -> bool {
        let turns = |figure: &Placement| figure.is_round || figure.free.contains(&Angle);
        self.figures.iter().all(turns)
    }

    /// Fixes the rotation about the normal of a plane that rotates freely, in the plane's own
    /// information. What the samples determine is unchanged.
    pub fn hold_turn(&self, information: &mut DMatrix<f64>) {
        if self.turns_freely() {
            let normal = self.pose.normal();
            let mut rotation = information.fixed_view_mut::<3, 3>(0, 0);
            rotation.ger(rotation.trace(), &normal, &normal, 1.0);
        }
    }

    /// Returns the index of a figure's first parameter among the plane's own.
    pub fn figure_offset(&self, figure: usize) -> usize {
        POSE_PARAMETERS
            + self.figures[..figure]
                .iter()
                .map(Placement::parameter_count)
                .sum::<usize>()
    }

    /// Returns the straight lines to which the distances of a side's samples are measured, each
    /// with its range of samples: the side's line with all samples, or for a circle one tangent per
    /// sample; `None` where a sample has no tangent.
    pub fn model_lines<L: Lens>(
        &self,
        lens: &L,
        figure: usize,
        side: &Side,
    ) -> impl Iterator<Item = Option<(ModelLine, Range<usize>)>> {
        let all = side.samples.len();
        let lines = match side.curve {
            Curve::Line(_) => 1,
            Curve::Circle(_) => all,
        };
        (0..lines).map(move |i| {
            Some(match side.curve {
                Curve::Line(line) => (line.into(), 0..all),
                Curve::Circle(radius) => {
                    let pixel = &side.samples[i].pixel;
                    (self.tangent(lens, figure, radius, pixel)?, i..i + 1)
                }
            })
        })
    }

    /// Returns the tangent of a circle whose image is nearest to a pixel.
    ///
    /// The distance to this tangent's image is stationary as the tangent rolls along the circle:
    /// its value and derivatives are those of the distance to the circle's image, up to the second
    /// order in the distance over the radius. The tangent is found from the one in the direction of
    /// the pixel's ray, through the foot of the pixel on its image.
    fn tangent<L: Lens>(
        &self,
        lens: &L,
        figure: usize,
        radius: Radius,
        pixel: &Vector2<f64>,
    ) -> Option<ModelLine> {
        let placement = &self.figures[figure];
        let (radius, index) = placement.radius(radius);
        let map = self.pose.line_map() * placement.line_map();
        // The map takes lines of the figure to planes; its transpose takes rays to points of the
        // figure.
        let towards = |ray: &Vector3<f64>| {
            let point = map.tr_mul(ray);
            let outward = (point.xy() / point.z).normalize();
            let finite = outward.x.is_finite() && outward.y.is_finite();
            finite.then(|| ModelLine::tangent(outward, radius, index))
        };
        let pixel_ray = lens.unproject_with_jacobian(pixel)?;
        let first = map * towards(&lens.direction(&pixel_ray))?.line.coefficients();
        let distance = lens.line_distance_jacobian(&pixel_ray, &first, Columns::NONE);
        towards(&distance.wrt_line)
    }

    /// The plane through the camera centre and a line of a figure.
    pub fn line(&self, figure: usize, line: &Line) -> Vector3<f64> {
        self.pose.line_map() * self.figures[figure].line(line)
    }

    /// Derivative of `line` with respect to the plane's own parameters.
    ///
    /// With `l = L (a, b, c)`, `d` the line's direction and `m = R d`:
    /// `l = c r3 + m x t`, so a rotation `w` gives `(-c [r3]x + [t]x [m]x) w`, a translation
    /// `m x dt`.
    pub fn line_jacobian(&self, figure: usize, model: &ModelLine) -> DMatrix<f64> {
        let placement = &self.figures[figure];
        let map = self.pose.line_map();
        let line = placement.line(&model.line);
        let direction = self.pose.rotation * Vector3::new(-line.y, line.x, 0.0);
        let turn = direction.cross_matrix();
        let wrt_rotation = self.pose.translation.cross_matrix() * turn
            - self.pose.normal().cross_matrix() * line.z;
        let mut jacobian = DMatrix::zeros(3, self.parameter_count());
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&wrt_rotation);
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&turn);
        let offset = self.figure_offset(figure);
        let derivatives = placement.line_derivatives(model);
        for (i, derivative) in derivatives.enumerate() {
            jacobian.set_column(offset + i, &(map * derivative));
        }
        jacobian
    }

    /// Returns the plane after a step of its own parameters; further entries of the step are not
    /// used.
    pub fn moved(&self, step: &[f64]) -> Self {
        let pose = self.pose.moved(
            &Vector3::new(step[0], step[1], step[2]),
            &Vector3::new(step[3], step[4], step[5]),
        );
        let mut offset = POSE_PARAMETERS;
        let figures = self.figures.iter().map(|figure| {
            let figure_step = &step[offset..offset + figure.parameter_count()];
            offset += figure.parameter_count();
            figure.moved(figure_step)
        });
        Self {
            figures: figures.collect(),
            pose,
        }
    }
}

impl<L: Lens> View<L> {
    /// Number of unknowns of the camera and of all planes.
    pub fn unknowns(&self, free: &FreeParameters) -> usize {
        let plane_unknowns: usize = self.planes.iter().map(PlaneState::unknowns).sum();
        let held: usize = self.relations.iter().map(Related::count).sum();
        free.len() + plane_unknowns - held.min(plane_unknowns)
    }

    /// Returns the view after a step of the free parameters.
    pub fn advanced(&self, free: &FreeParameters, step: &ArrowStep) -> Self {
        let planes = self.planes.iter().zip(&step.blocks);
        let mut next = Self {
            lens: free.advance(&self.lens, &step.shared),
            planes: planes
                .map(|(plane, plane_step)| plane.moved(plane_step.as_slice()))
                .collect(),
            relations: self.relations.clone(),
        };
        next.hold_relations(); // the step satisfies them to first order
        next
    }
}
