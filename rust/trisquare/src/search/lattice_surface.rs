//! The smooth surface of a plane's crossings: a homography, followed by the bending of a lens.
//!
//! A point at `p` in the photograph, in half diagonals from the picture's middle, is seen along the
//! ray `(p, x cot x)`, where `x^2 = -3 bend |p|^2`: that of an equidistant fisheye of any field of
//! view. For the weak distortion of other lenses this is `(p, 1 + bend |p|^2)`, the division model,
//! which fits all of them to a hundredth of a cell (A. W. Fitzgibbon, *Simultaneous linear
//! estimation of multiple view geometry and lens distortion*, CVPR 2001).

use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::lattice::{Lattice, Site};

/// Maximum number of Gauss-Newton steps, each of which also updates the weights: a few strays have
/// lost their weight by then.
const STEPS: usize = 6;

/// Deviation (px) below which all weights are the same: the scatter of the search.
const EQUAL_WEIGHT_DEVIATION: f64 = 0.3;

/// Deviation (px): if that of no crossing is larger, there are no strays, and there is no evidence
/// for a bend.
const CLOSE_DEVIATION: f64 = 0.6;

/// Size of the bend of usual lenses, as a prior, and its bounds: a strong barrel distortion has
/// -0.25, a fisheye of 190 degrees across -1.4. A few crossings determine it no better than the
/// prior.
const USUAL_BEND: f64 = 0.2;
const BEND_RANGE: [f64; 2] = [-2.0, 0.5];

/// Value that counts as zero for a depth or a scale of about one.
const ZERO_TOLERANCE: f64 = 1e-9;

/// Value of `bend |p|^2` below which differences between displacements are lost in rounding.
const MIN_BEND_TERM: f64 = 1e-6;

/// Maximum number of iterations of the decompositions; they take ten or so.
const MAX_ITERATIONS: usize = 1000;

const PARAMETERS: usize = 9;

type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Step = SVector<f64, PARAMETERS>;

/// Unit and origin of points of the photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PictureFrame {
    /// Middle of the picture, pixels.
    middle: Vector2<f64>,
    /// Half the picture's diagonal, pixels.
    half_diagonal: f64,
}

/// The positions in a picture of a plane's crossings, by row and column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LatticeSurface {
    frame: PictureFrame,
    shape: BentPlane,
}

impl LatticeSurface {
    /// Fits a lattice's crossings, ignoring a few strays.
    ///
    /// At least four of them must not be on one line; `size` is the picture's width and height.
    pub fn of(lattice: &Lattice, size: [usize; 2]) -> Self {
        let middle = Vector2::from(size.map(|pixels| 0.5 * (pixels as f64 - 1.0)));
        let half_diagonal = middle.x.hypot(middle.y).max(1.0);
        let (sites, points): (Vec<_>, Vec<_>) = lattice
            .found()
            .map(|(site, point)| (column_and_row(site), (point - middle) / half_diagonal))
            .unzip();
        Self {
            frame: PictureFrame {
                middle,
                half_diagonal,
            },
            shape: BentPlane::fitted(&sites, &points, half_diagonal),
        }
    }

    /// The point of the photograph, pixels, for a row and a column; NaN if there is none.
    pub fn at(&self, site: Site) -> Vector2<f64> {
        self.frame.middle + self.frame.half_diagonal * self.shape.at(column_and_row(site))
    }

    /// Columns and rows of points of the photograph; not finite if there are none.
    pub fn sites(&self, points: impl Iterator<Item = Vector2<f64>>) -> Vec<Vector2<f64>> {
        let observed = points.map(|point| (point - self.frame.middle) / self.frame.half_diagonal);
        self.shape.sites(&observed.collect::<Vec<_>>())
    }

    /// Distance of each crossing of a lattice from the surface, pixels.
    pub fn deviations(&self, lattice: &Lattice) -> Vec<(Site, f64)> {
        let off = |(site, point): (Site, Vector2<f64>)| {
            let gap = (point - self.at(site)).norm();
            // The distance of a crossing without a position on the surface is half the diagonal.
            let is_on_surface = gap.is_finite();
            (
                site,
                if is_on_surface {
                    gap
                } else {
                    self.frame.half_diagonal
                },
            )
        };
        lattice.found().map(off).collect()
    }
}

fn column_and_row((row, column): Site) -> Vector2<f64> {
    Vector2::new(column as f64, row as f64)
}

/// A homography and the bending of a lens, for points in half diagonals from the picture's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct BentPlane {
    /// Maps (column, row, 1) to ideal points.
    homography: Matrix3<f64>,
    /// Bend of the lens.
    bend: f64,
}

impl BentPlane {
    /// Fits crossings by least absolute deviations, ignoring a few strays.
    ///
    /// `sites` are (column, row); `points` are in half diagonals from the picture's middle, and a
    /// half diagonal is `size` pixels. At least four of them must not be on one line.
    fn fitted(sites: &[Vector2<f64>], points: &[Vector2<f64>], size: f64) -> Self {
        let Some(&first) = sites.first() else {
            return Self {
                homography: Matrix3::identity(),
                bend: 0.0,
            };
        };
        let (low, high) = sites
            .iter()
            .fold((first, first), |(low, high), s| (low.inf(s), high.sup(s)));
        let centre = (low + high) * 0.5;
        let half = (high - centre).sup(&Vector2::repeat(1.0));
        let scaled: Vec<_> = sites
            .iter()
            .map(|site| (site - centre).component_div(&half))
            .collect();
        let scaling = Matrix3::new(
            1.0 / half.x,
            0.0,
            -centre.x / half.x,
            0.0,
            1.0 / half.y,
            -centre.y / half.y,
            0.0,
            0.0,
            1.0,
        );
        let mut surface = Self {
            homography: algebraic_homography(&scaled, points),
            bend: 0.0,
        };
        surface.refine(&scaled, points, size);
        surface.homography *= scaling;
        surface
    }

    /// The point of the photograph, in half diagonals, for a column and row; NaN if there is none.
    fn at(&self, site: Vector2<f64>) -> Vector2<f64> {
        // The depth is one in the middle of the crossings.
        project(self.homography * site.push(1.0), self.bend)
    }

    /// Columns and rows of points of the photograph (half diagonals); not finite if there are none.
    fn sites(&self, points: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
        // A singular homography, which noise may produce, is inverted as well as possible.
        let inverse = self
            .homography
            .try_svd(true, true, f64::EPSILON, MAX_ITERATIONS)
            .and_then(|svd| {
                svd.pseudo_inverse(f64::EPSILON * svd.singular_values.max())
                    .ok()
            });
        let site = |point: &Vector2<f64>| {
            inverse.map_or(Vector2::repeat(f64::NAN), |inverse| {
                let mapped = inverse * point.push(depth(point.norm_squared(), self.bend));
                mapped.xy() / mapped.z
            })
        };
        points.iter().map(site).collect()
    }

    fn refine(&mut self, sites: &[Vector2<f64>], points: &[Vector2<f64>], size: f64) {
        for number in 0..STEPS {
            let residuals: Vec<_> = sites
                .iter()
                .zip(points)
                .map(|(&site, &point)| CrossingResidual::new(self, site, point, size))
                .collect();
            let farthest = residuals.iter().map(|p| p.gap.norm()).fold(0.0, f64::max);
            let is_close = farthest < CLOSE_DEVIATION;
            // If the first step was needed, a second one is always made, which fits the bend.
            if is_close && number != 1 {
                break;
            }
            let min_gap = if is_close {
                CLOSE_DEVIATION
            } else {
                EQUAL_WEIGHT_DEVIATION
            };
            let prior = EQUAL_WEIGHT_DEVIATION / (USUAL_BEND * USUAL_BEND);
            let (mut information, mut gradient) = (Normal::zeros(), Step::zeros());
            information[(8, 8)] = prior;
            gradient[8] = prior * self.bend;
            for residual in &residuals {
                residual.add_to(&mut information, &mut gradient, min_gap);
            }
            if !information.iter().chain(&gradient).all(|x| x.is_finite()) {
                break;
            }
            information.fill_lower_triangle_with_upper_triangle();
            let Some(step) = solved(&information, &gradient) else {
                break;
            };
            for k in 0..8 {
                self.homography[(k / 3, k % 3)] -= step[k];
            }
            self.bend = (self.bend - step[8]).clamp(BEND_RANGE[0], BEND_RANGE[1]);
        }
    }
}

/// Depth of the ray that is seen at a squared distance from the middle: `x cot x`.
fn depth(square: f64, bend: f64) -> f64 {
    let angle = (3.0 * bend * square).abs().sqrt();
    if angle < ZERO_TOLERANCE {
        1.0
    } else if bend < 0.0 {
        angle / angle.tan()
    } else {
        angle / angle.tanh()
    }
}

/// Point at which a ray is seen, in half diagonals from the picture's middle; NaN if there is none.
fn project(ray: Vector3<f64>, bend: f64) -> Vector2<f64> {
    let distance = ray.xy().norm();
    let scale = (3.0 * bend).abs().sqrt();
    let angle = scale * distance;
    if bend < 0.0 && angle > ZERO_TOLERANCE * ray.z.abs() {
        ray.xy() * (angle.atan2(ray.z) / angle)
    } else if !(ray.z > 0.0) {
        Vector2::repeat(f64::NAN)
    } else if angle > ZERO_TOLERANCE * ray.z {
        ray.xy() * ((angle / ray.z).atanh() / angle)
    } else {
        ray.xy() / ray.z
    }
}

/// Difference between a crossing and the surface, and its derivatives.
struct CrossingResidual {
    site: Vector3<f64>,
    /// Difference in pixels.
    gap: Vector2<f64>,
    /// Derivatives with respect to the ray, pixels per unit of the ray.
    by_ray: Matrix2x3<f64>,
    by_bend: Vector2<f64>,
}

impl CrossingResidual {
    fn new(surface: &BentPlane, site: Vector2<f64>, point: Vector2<f64>, size: f64) -> Self {
        let site = site.push(1.0);
        let ray = surface.homography * site;
        let bend = surface.bend;
        let at = project(ray, bend);
        let distance = ray.xy().norm().max(ZERO_TOLERANCE);
        let (outward, radius) = (ray.xy() / distance, at.norm());
        let square = ray.z * ray.z - 3.0 * bend * distance * distance;
        let tangential_scale = if distance > ZERO_TOLERANCE {
            radius / distance
        } else {
            1.0 / ray.z
        };
        let along = outward * outward.transpose();
        let across = Matrix2::identity() - along;
        let by_depth = -ray.xy() / square;
        let mut by_ray = Matrix2x3::zeros();
        by_ray
            .fixed_columns_mut::<2>(0)
            .copy_from(&(along * (ray.z / square) + across * tangential_scale));
        by_ray.set_column(2, &by_depth);
        // For a bend of zero the limit is the cube.
        let radius_by_bend = if (bend * radius * radius).abs() > MIN_BEND_TERM {
            (distance * ray.z / square - radius) / (2.0 * bend)
        } else {
            radius.powi(3)
        };
        Self {
            site,
            gap: (at - point) * size,
            by_ray: by_ray * size,
            by_bend: outward * (radius_by_bend * size),
        }
    }

    /// Adds the crossing to the upper triangle of the normal matrix and to the gradient.
    fn add_to(&self, information: &mut Normal, gradient: &mut Step, min_gap: f64) {
        let weight = 1.0 / self.gap.norm().max(min_gap);
        for axis in 0..2 {
            let mut row = Step::zeros();
            for k in 0..8 {
                row[k] = self.by_ray[(axis, k / 3)] * self.site[k % 3];
            }
            row[8] = self.by_bend[axis];
            for i in 0..PARAMETERS {
                let weighted = weight * row[i];
                for j in i..PARAMETERS {
                    information[(i, j)] += weighted * row[j];
                }
                gradient[i] += weighted * self.gap[axis];
            }
        }
    }
}

/// Solves the normal equations; without a unique solution, for the shortest one.
fn solved(information: &Normal, gradient: &Step) -> Option<Step> {
    if let Some(factor) = information.cholesky() {
        return Some(factor.solve(gradient));
    }
    let svd = information.try_svd(true, true, f64::EPSILON, MAX_ITERATIONS)?;
    let tolerance = PARAMETERS as f64 * f64::EPSILON * svd.singular_values.max();
    svd.solve(gradient, tolerance).ok()
}

/// The homography with the smallest algebraic error; its last entry is one.
fn algebraic_homography(sites: &[Vector2<f64>], points: &[Vector2<f64>]) -> Matrix3<f64> {
    let count = points.len() as f64;
    let centre = points.iter().sum::<Vector2<f64>>() / count;
    // Size of all coordinates about their common mean.
    let mean = 0.5 * (centre.x + centre.y);
    let squares = points.iter().map(|p| p.add_scalar(-mean).norm_squared());
    let size = (0.5 * squares.sum::<f64>() / count)
        .sqrt()
        .max(ZERO_TOLERANCE);
    let mut products = Normal::zeros();
    for (site, point) in sites.iter().zip(points) {
        let (place, scaled) = (site.push(1.0), (point - centre) / size);
        let outer = place * place.transpose();
        for axis in 0..2 {
            let mut block = products.fixed_view_mut::<3, 3>(3 * axis, 3 * axis);
            block += outer;
            let mut cross = products.fixed_view_mut::<3, 3>(3 * axis, 6);
            cross -= outer * scaled[axis];
        }
        let mut last = products.fixed_view_mut::<3, 3>(6, 6);
        last += outer * scaled.norm_squared();
    }
    products.fill_lower_triangle_with_upper_triangle();
    let Some(eigen) = products.try_symmetric_eigen(f64::EPSILON, MAX_ITERATIONS) else {
        return Matrix3::identity();
    };
    let smallest = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let homography = Matrix3::from_row_iterator(smallest.iter().copied());
    let top: Matrix2x3<f64> =
        homography.fixed_rows::<2>(0) * size + centre * homography.fixed_rows::<1>(2);
    let mut moved = homography;
    moved.fixed_rows_mut::<2>(0).copy_from(&top);
    let last = moved[(2, 2)];
    moved
        / if last.abs() > ZERO_TOLERANCE {
            last
        } else {
            ZERO_TOLERANCE
        }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    const SIZE: f64 = 800.0;

    fn sites() -> Vec<Vector2<f64>> {
        let every = (0..7).flat_map(|row| (0..9).map(move |col| (col, row)));
        every
            .map(|(c, r)| Vector2::new(f64::from(c), f64::from(r)))
            .collect()
    }

    fn truth() -> BentPlane {
        let homography = Matrix3::new(0.08, 0.01, -0.4, -0.02, 0.07, -0.2, 0.02, -0.01, 1.0);
        BentPlane {
            homography,
            bend: -0.2,
        }
    }

    #[test]
    fn a_fit_has_every_crossing_and_site_of_the_truth() {
        let points: Vec<_> = sites().iter().map(|&site| truth().at(site)).collect();
        let fitted = BentPlane::fitted(&sites(), &points, SIZE);
        for (&site, point) in sites().iter().zip(&points) {
            assert!((fitted.at(site) - point).norm() * SIZE < 0.02);
        }
        for (site, found) in sites().iter().zip(fitted.sites(&points)) {
            assert!((site - found).norm() < 1e-3);
        }
    }

    #[test]
    fn a_board_near_the_rim_of_a_fisheye_fits_as_a_whole() {
        let camera = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.9);
        let at = |site: &Vector2<f64>| {
            let place = Vector3::new(0.09 * site.x - 0.4, 0.09 * site.y - 0.2, 1.0);
            let ray = camera * place;
            // 190 degrees across a picture of 4 x 3: 119 degrees at the corner.
            ray.xy() / ray.xy().norm() * (ray.xy().norm().atan2(ray.z) / 119f64.to_radians())
        };
        let points: Vec<_> = sites().iter().map(at).collect();
        let fitted = BentPlane::fitted(&sites(), &points, SIZE);
        for (&site, point) in sites().iter().zip(&points) {
            assert!((fitted.at(site) - point).norm() * SIZE < 0.1);
        }
    }

    #[test]
    fn derivatives_are_those_of_the_gap() {
        let site = Vector2::new(5.0, 3.0);
        for bend in [-1.4, -0.2, 0.0, 0.3] {
            let surface = BentPlane { bend, ..truth() };
            let gap = |surface: &BentPlane| {
                CrossingResidual::new(surface, site, Vector2::zeros(), SIZE).gap
            };
            let place = CrossingResidual::new(&surface, site, Vector2::zeros(), SIZE);
            let step = 1e-6;
            for k in 0..8 {
                let moved = [step, -step].map(|by| {
                    let mut moved = surface;
                    moved.homography[(k / 3, k % 3)] += by;
                    gap(&moved)
                });
                let expected = place.by_ray.column(k / 3) * place.site[k % 3];
                assert!(((moved[0] - moved[1]) / (2.0 * step) - expected).norm() < 1e-3);
            }
            let moved = [step, -step].map(|by| {
                gap(&BentPlane {
                    bend: bend + by,
                    ..surface
                })
            });
            assert!(((moved[0] - moved[1]) / (2.0 * step) - place.by_bend).norm() < 1e-3);
        }
    }

    #[test]
    fn a_stray_is_far_off_the_surface_of_the_others() {
        let mut points: Vec<_> = sites().iter().map(|&site| truth().at(site)).collect();
        points[20].x += 12.0 / SIZE;
        let fitted = BentPlane::fitted(&sites(), &points, SIZE);
        for (number, (&site, point)) in sites().iter().zip(&points).enumerate() {
            let off = (fitted.at(site) - point).norm() * SIZE;
            assert_eq!(off > 5.0, number == 20, "{number}: {off}");
            assert!(number == 20 || off < 0.5, "{number}: {off}");
        }
    }

    #[test]
    fn what_is_no_lattice_gives_a_surface_all_the_same() {
        let same = vec![Vector2::new(0.3, 0.3); 5];
        let fitted = BentPlane::fitted(&sites()[..5], &same, SIZE);
        let _ = (fitted.at(Vector2::zeros()), fitted.sites(&same));
        let none = BentPlane::fitted(&[], &[], SIZE);
        assert!(none.sites(&[]).is_empty());
    }
}
