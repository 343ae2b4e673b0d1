//! A camera and the planes it sees: what every fit moves.

use nalgebra::{DMatrix, Vector3};

use super::free_parameters::FreeParameters;
use super::observed::Side;
use super::placement::Placement;
use crate::geometry::Pose;
use crate::lens::Lens;
use crate::numeric::ArrowStep;

/// Parameters of a pose: rotation vector, translation.
pub(crate) const POSE_PARAMETERS: usize = 6;

/// A camera and the planes it sees.
#[derive(Debug, Clone)]
pub(crate) struct View<L> {
    pub lens: L,
    pub planes: Vec<PlaneState>,
}

/// Where a plane stands, and where its figures lie on it.
#[derive(Debug, Clone)]
pub(crate) struct PlaneState {
    pub pose: Pose,
    pub figures: Vec<Placement>,
}

impl PlaneState {
    pub fn parameter_count(&self) -> usize {
        POSE_PARAMETERS + self.figures.iter().map(|f| f.free.len()).sum::<usize>()
    }

    /// Where the parameters of a figure begin among the plane's own.
    pub fn figure_offset(&self, figure: usize) -> usize {
        POSE_PARAMETERS
            + self.figures[..figure]
                .iter()
                .map(|f| f.free.len())
                .sum::<usize>()
    }

    /// The plane through the camera centre and a line of a figure.
    pub fn line(&self, figure: usize, side: &Side) -> Vector3<f64> {
        self.pose.line_map() * self.figures[figure].line(&side.line)
    }

    /// Its derivative by the plane's own parameters.
    ///
    /// With `l = L (a, b, c)`, `d` the line's direction and `m = R d`:
    /// `l = c r3 + m x t`, so a rotation `w` gives `(-c [r3]x + [t]x [m]x) w`, a translation
    /// `m x dt`.
    pub fn line_jacobian(&self, figure: usize, side: &Side) -> DMatrix<f64> {
        let placement = &self.figures[figure];
        let map = self.pose.line_map();
        let line = placement.line(&side.line);
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
        let derivatives = placement.line_derivatives(&side.line);
        for (i, derivative) in derivatives.enumerate() {
            jacobian.set_column(offset + i, &(map * derivative));
        }
        jacobian
    }

    /// The plane after a step of its own parameters (any that follow are not its geometry).
    pub fn moved(&self, step: &[f64]) -> Self {
        let pose = self.pose.moved(
            &Vector3::new(step[0], step[1], step[2]),
            &Vector3::new(step[3], step[4], step[5]),
        );
        let mut offset = POSE_PARAMETERS;
        let figures = self.figures.iter().map(|figure| {
            let own = &step[offset..offset + figure.free.len()];
            offset += figure.free.len();
            figure.moved(own)
        });
        Self {
            figures: figures.collect(),
            pose,
        }
    }
}

impl<L: Lens> View<L> {
    /// Parameters of the camera that are free, and of all planes.
    pub fn unknowns(&self, free: &FreeParameters) -> usize {
        free.len()
            + self
                .planes
                .iter()
                .map(PlaneState::parameter_count)
                .sum::<usize>()
    }

    /// The view after a step of the free parameters.
    pub fn advanced(&self, free: &FreeParameters, step: &ArrowStep) -> Self {
        let planes = self.planes.iter().zip(&step.blocks);
        Self {
            lens: free.advance(&self.lens, &step.shared),
            planes: planes
                .map(|(plane, own)| plane.moved(own.as_slice()))
                .collect(),
        }
    }
}
