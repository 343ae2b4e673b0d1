//! Covariance of the projection of a viewing direction.
//!
//! For the use of a calibration, the uncertainty of its parameters, whose errors may be correlated
//! and cancel, matters less than that of the pixel at which a direction is seen. For the direction
//! `u` seen at a pixel, held fixed in the camera's frame, the pixel's covariance is `J C J^T` with
//! `J` the derivative of the projection with respect to the free parameters and `C` their
//! covariance.

use nalgebra::{
    Const, DMatrix, Dim, Dyn, Matrix, Matrix2, Matrix6xX, OMatrix, Storage, SymmetricEigen, Vector2,
};

use crate::error::Error;
use crate::lens::{DefaultLens, Lens, of_all};
use crate::numeric::is_covariance;
use crate::result::{Calibration, PoseUncertainty};

/// Maximum number of sweeps of the symmetric eigenvalue iteration; a few per column suffice.
const MAX_SWEEPS: usize = 1000;

/// The uncertainty of projections that follows from that of a camera's parameters.
#[derive(Debug, Clone)]
pub struct ProjectionUncertainty<'a, L: Lens = DefaultLens> {
    camera: &'a L,
    free: FreeColumns,
}

/// The free parameters of a camera of any family.
#[derive(Debug, Clone)]
pub(super) struct FreeColumns {
    /// Columns of the projection's Jacobian that are free.
    columns: Vec<usize>,
    /// `fy / fx` where `fy` follows `fx`.
    aspect: Option<f64>,
    covariance: DMatrix<f64>,
}

impl<'a, L: Lens> ProjectionUncertainty<'a, L> {
    /// Creates it from the names of the free parameters and their covariance, in the same order.
    ///
    /// With `aspect_fixed`, `fy` follows `fx`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for a name that is unknown or given twice, or a covariance of
    /// another size, or one that is not symmetric and positive semidefinite; [`Error::NotFinite`].
    pub fn new(
        camera: &'a L,
        parameters: &[&str],
        aspect_fixed: bool,
        covariance: DMatrix<f64>,
    ) -> Result<Self, Error> {
        let column = |name: &&str| {
            let found = L::parameter_names().iter().position(|n| n == name);
            found.ok_or_else(|| Error::InvalidArgument(format!("no parameter is called {name:?}")))
        };
        let columns = parameters.iter().map(column);
        let columns: Vec<usize> = columns.collect::<Result<_, _>>()?;
        let size = columns.len();
        let is_repeated = |place: &usize| columns[..*place].contains(&columns[*place]);
        if let Some(place) = (0..size).find(is_repeated) {
            return Err(Error::InvalidArgument(format!(
                "the parameter {:?} is given twice",
                parameters[place]
            )));
        }
        if covariance.shape() != (size, size) {
            return Err(Error::InvalidArgument(format!(
                "the covariance of {size} parameters has {} rows and {} columns",
                covariance.nrows(),
                covariance.ncols()
            )));
        }
        if !covariance.iter().all(|v| v.is_finite()) {
            return Err(Error::NotFinite {
                what: "the covariance",
            });
        }
        if !is_covariance(&covariance) {
            return Err(Error::InvalidArgument(
                "the covariance is not symmetric and positive semidefinite".into(),
            ));
        }
        let focal = camera.focal();
        Ok(Self {
            camera,
            free: FreeColumns {
                aspect: (aspect_fixed && columns.contains(&0)).then(|| focal.y / focal.x),
                columns,
                covariance,
            },
        })
    }

    /// Returns the covariance, in px^2, of the projection of the direction seen at a pixel; `None`
    /// beyond the valid radius.
    pub fn at(&self, pixel: &Vector2<f64>) -> Option<Matrix2<f64>> {
        let pixel_ray = self.camera.unproject_with_jacobian(pixel)?;
        let free = self.free.of(&self.camera.projection_jacobian(&pixel_ray));
        let covariance = &free * &self.free.covariance * free.transpose();
        covariance
            .iter()
            .all(|v| v.is_finite())
            .then_some(covariance)
    }

    /// The camera.
    pub(super) fn camera(&self) -> &'a L {
        self.camera
    }

    /// The free parameters.
    pub(super) fn free(&self) -> &FreeColumns {
        &self.free
    }

    /// Returns the derivative of a pose with respect to the free parameters.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for the uncertainty of a pose seen by another lens.
    pub(super) fn pose_by_free(
        &self,
        uncertainty: &PoseUncertainty,
    ) -> Result<Matrix6xX<f64>, Error> {
        let (columns, parameters) = (uncertainty.by_camera.ncols(), L::parameter_names().len());
        if columns != parameters {
            return Err(Error::InvalidArgument(format!(
                "the pose's uncertainty is that of another lens: its derivative by the camera has \
                 {columns} columns, but the lens {parameters} parameters"
            )));
        }
        Ok(self.free.of(&uncertainty.by_camera))
    }

    /// Returns the same covariance for many pixels.
    ///
    /// # Errors
    /// [`Error::BeyondValidRadius`].
    pub fn at_pixels(&self, pixels: &[Vector2<f64>]) -> Result<Vec<Matrix2<f64>>, Error> {
        of_all(self.camera, pixels, |pixel| self.at(pixel))
    }
}

impl FreeColumns {
    /// Their covariance.
    pub(super) fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Their columns among all parameters.
    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Number of free parameters.
    pub(super) fn len(&self) -> usize {
        self.columns.len()
    }

    /// Returns a square root `L` of the covariance, `C = L L^T`; rounding may have left the
    /// covariance slightly indefinite.
    pub(super) fn root(&self) -> Result<DMatrix<f64>, Error> {
        if self.columns.is_empty() {
            return Ok(DMatrix::zeros(0, 0));
        }
        let eigen = SymmetricEigen::try_new(self.covariance.clone(), f64::EPSILON, MAX_SWEEPS);
        let eigen = eigen
            .ok_or_else(|| Error::InvalidArgument("the covariance has no eigenvalues".into()))?;
        let roots = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
        Ok(eigen.eigenvectors * DMatrix::from_diagonal(&roots))
    }

    /// Selects the derivatives with respect to the free parameters from those with respect to all;
    /// `fy` may follow `fx`.
    pub(super) fn of<const R: usize, C: Dim>(
        &self,
        all: &Matrix<f64, Const<R>, C, impl Storage<f64, Const<R>, C>>,
    ) -> OMatrix<f64, Const<R>, Dyn> {
        let mut free = OMatrix::<f64, Const<R>, Dyn>::zeros(self.columns.len());
        for (i, column) in self.columns.iter().enumerate() {
            free.set_column(i, &all.column(*column));
            if let (0, Some(aspect)) = (*column, self.aspect) {
                let followed = free.column(i) + all.column(1) * aspect;
                free.set_column(i, &followed);
            }
        }
        free
    }
}

impl<L: Lens> Calibration<L> {
    /// Returns the uncertainty of projections with this camera.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a covariance that is not finite.
    pub fn projection_uncertainty(&self) -> Result<ProjectionUncertainty<'_, L>, Error> {
        let covariance = self.covariance.clone();
        ProjectionUncertainty::new(
            &self.camera,
            &self.parameters,
            self.aspect_fixed,
            covariance,
        )
    }

    /// Returns the standard deviation, in pixels (rms), of the projections of the directions seen
    /// at pixels.
    ///
    /// `sqrt(trace(J C J^T))`: see [`ProjectionUncertainty`]. Directions are held in the camera's
    /// frame, so that an uncertain principal point counts in full, although a rotation of the
    /// camera compensates for most of it. The standard deviations that remain after the rotation
    /// that fits the given pixels best (for a grid over the picture, those of `lens_extrapolated`)
    /// are given by a comparison with the same camera taken as exact:
    ///
    /// ```
    /// use nalgebra::{DMatrix, Vector2};
    /// use trisquare::{Calibration, Error, ProjectionUncertainty, compare_projections};
    ///
    /// fn std_after_rotation(
    ///     found: &Calibration,
    ///     pixels: &[Vector2<f64>],
    /// ) -> Result<Vec<Option<f64>>, Error> {
    ///     let exact = ProjectionUncertainty::new(&found.camera, &[], false, DMatrix::zeros(0, 0))?;
    ///     let compared = compare_projections(&found.projection_uncertainty()?, &exact, pixels)?;
    ///     Ok(compared.test.map_or_else(Vec::new, |test| test.std))
    /// }
    /// ```
    ///
    /// # Errors
    /// [`Error::BeyondValidRadius`]; [`Error::NotFinite`].
    pub fn projection_std(&self, pixels: &[Vector2<f64>]) -> Result<Vec<f64>, Error> {
        let found = self.projection_uncertainty()?.at_pixels(pixels)?;
        // Rounding may make a trace of zero slightly negative.
        Ok(found.iter().map(|c| c.trace().max(0.0).sqrt()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Brown;

    const PARAMETERS: [f64; 9] = [
        1000.0, 1010.0, 640.0, 470.0, -0.25, 0.12, -0.03, 0.002, -0.001,
    ];

    #[test]
    fn with_the_aspect_fixed_fy_follows_fx() {
        let lens = Brown::new(PARAMETERS);
        let pixel = Vector2::new(900.0, 200.0);
        let variance = 4.0;
        let tied =
            ProjectionUncertainty::new(&lens, &["fx"], true, DMatrix::from_element(1, 1, variance));
        let (focal, centre) = (lens.focal(), lens.principal_point());
        // The picture is scaled about the principal point: by 1 / fx per unit of fx.
        let offset = (pixel - centre) / focal.x;
        let expected = offset * offset.transpose() * variance;
        assert!((tied.unwrap().at(&pixel).unwrap() - expected).norm() < 1e-12);
    }

    #[test]
    fn bad_arguments_are_refused() {
        let lens = Brown::new(PARAMETERS);
        for (names, rows, value) in [
            (vec!["f"], 1, 1.0),
            (vec!["fx"], 2, 1.0),
            (vec!["fx"], 1, f64::NAN),
            (vec!["fx"], 1, -1.0),
            (vec!["fx", "cx", "fx"], 3, 0.0),
        ] {
            let covariance = DMatrix::from_element(rows, rows, value);
            assert!(ProjectionUncertainty::new(&lens, &names, false, covariance).is_err());
        }
    }
}
