//! Model of the pixels around one figure: from geometry and exposure to coded values.

use nalgebra::{Vector2, Vector3};

use super::band_pixels::{BandPixel, PixelFigure};
use super::coverage;
use super::coverage::{Corner, Coverage, Kurtosis, PLATEAU, coverage};
use super::exposure::{
    EXPOSURE_PARAMETERS, Exposure, LIGHT_PARAMETERS, VARIATION_PARAMETERS, Variation,
};
use crate::image::{
    KURTOSIS, PICTURE_PARAMETERS, PictureState, SHIFT, TONE_PARAMETERS, ToneCurve, box_kurtosis,
};
use crate::lens::Lens;
use crate::observations::View;

/// Maximum change (px) of a pixel's distance to the outline from its first estimate.
const DEPTH_SLACK: f64 = 1.0;

/// Step (in the figure's units) over which the direction of a side at its corner is computed.
const CORNER_STEP: f64 = 0.01;

/// One figure under one state: the quantities shared by all its pixels.
pub(super) struct Scene<'a, L> {
    pub figure: &'a PixelFigure,
    curve: &'a ToneCurve,
    picture: &'a PictureState,
    /// Derivatives of ground and contrast by the tone curve's parameters, at constant coded values.
    translation: [[f64; 2]; TONE_PARAMETERS],
    pub lens: &'a L,
    exposure: &'a Exposure,
    /// The planes through the camera centre and the sides.
    pub lines: [Vector3<f64>; 4],
    /// Corners, each between the blurred sides `i - 1` and `i`.
    corners: [Corner; 4],
    pub corner_pixels: [Vector2<f64>; 4],
    /// Kurtosis of the blur across each side.
    kurtosis: Kurtosis,
    /// One over the figure's size, and its widest blur: stored because every pixel uses them.
    per_size: f64,
    widest_blur: f64,
    /// Which of the picture's parameters are free.
    has_free_curve: bool,
    has_free_shift: bool,
    has_free_kurtosis: bool,
}

/// The model at one pixel.
pub(super) struct Shade {
    /// Modelled less observed.
    pub residual: f64,
    /// Whether the pixel is clipped and the model exceeds it: it is uninformative then, and
    /// residual and derivatives are zero.
    pub is_silent: bool,
    /// Derivative of the coded value by light.
    slope: f64,
    /// Light at the pixel, and the reflected fraction of it.
    light: f64,
    reflected: f64,
    pub coverage: Coverage,
    /// One over the blur across each side, and distances to the near sides in blurs.
    per_blur: [f64; 4],
    z: [f64; 4],
    place: Vector2<f64>,
}

impl<'a, L: Lens> Scene<'a, L> {
    /// `None` if the lens does not see the figure's corners.
    pub fn new(
        figure: &'a PixelFigure,
        picture: &'a PictureState,
        view: &'a View<L>,
        exposure: &'a Exposure,
    ) -> Option<Self> {
        let plane = &view.planes[figure.plane];
        let placement = &plane.figures[figure.figure];
        let lens = &view.lens;
        let project =
            |point: Vector2<f64>| lens.project(&plane.pose.transform(&placement.point(point)));
        let mut correlations = [0.0; 4];
        let mut directions = [Vector2::zeros(); 4];
        let mut corner_pixels = [Vector2::zeros(); 4];
        for (i, correlation) in correlations.iter_mut().enumerate() {
            let [before, corner, after] = [(i + 3) % 4, i, (i + 1) % 4].map(|k| figure.corners[k]);
            let here = project(corner)?;
            corner_pixels[i] = here;
            let arriving = here - project(corner.lerp(&before, CORNER_STEP))?;
            let leaving = project(corner.lerp(&after, CORNER_STEP))? - here;
            *correlation = arriving.normalize().dot(&leaving.normalize());
            directions[i] = leaving.normalize();
        }
        let per_size = 1.0 / figure.size;
        let of_box = std::array::from_fn(|i| {
            let middle = corner_pixels[i].lerp(&corner_pixels[(i + 1) % 4], 0.5);
            let blurs = exposure.blurs(&((middle - figure.centre) * per_size));
            box_kurtosis(&directions[i], blurs[i])
        });
        Some(Self {
            figure,
            curve: &picture.curve,
            picture,
            translation: exposure.translation(picture),
            lens,
            exposure,
            lines: [0, 1, 2, 3].map(|i| plane.line(figure.figure, &figure.sides[i])),
            corners: correlations.map(Corner::new),
            corner_pixels,
            kurtosis: Kurtosis {
                of_box,
                of_lens: picture.kurtosis,
            },
            per_size,
            widest_blur: exposure.widest_blur(),
            has_free_curve: picture.has_free_curve(),
            has_free_shift: picture.has_free_shift(),
            has_free_kurtosis: picture.has_free_kurtosis(),
        })
    }

    /// Position in the figure, from -1/2 to 1/2: the argument of its shading.
    #[inline]
    fn shading_place(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        (pixel - self.figure.centre) * self.per_size
    }

    /// Whether an edge may cut the pixel; if not, it is on a plateau.
    #[inline]
    pub fn may_cut(&self, pixel: &BandPixel) -> bool {
        pixel.depth().abs() < PLATEAU * self.widest_blur + DEPTH_SLACK
    }

    /// Modelled less observed value of a pixel that no edge may cut; `None` if it is clipped and
    /// the model exceeds it.
    #[inline]
    pub fn plateau_residual(&self, pixel: &BandPixel, inside: bool) -> Option<f64> {
        let reflected = self.plateau_reflection(inside);
        let place = self.shading_place(&pixel.place());
        let light = self.exposure.light.factor(&place);
        let residual = self.curve.encode_with_slope(light * reflected).0 - pixel.value;
        (!pixel.is_clipped || residual < 0.0).then_some(residual)
    }

    /// The fraction of the light reflected by the figure or by its ground.
    #[inline]
    fn plateau_reflection(&self, inside: bool) -> f64 {
        self.exposure.ground + if inside { self.exposure.contrast } else { 0.0 }
    }

    /// The model of a plateau at a position in the picture, without an observation.
    pub fn plateau(&self, place: &Vector2<f64>, inside: bool) -> Shade {
        let place = self.shading_place(place);
        let light = self.exposure.light.factor(&place);
        let reflected = self.plateau_reflection(inside);
        let (_, slope) = self.curve.encode_with_slope(light * reflected);
        Shade {
            residual: 0.0,
            is_silent: false,
            slope,
            light,
            reflected,
            coverage: coverage::plateau(inside),
            per_blur: [0.0; 4],
            z: [0.0; 4],
            place,
        }
    }

    /// The figure's widest blur, px.
    pub fn widest_blur(&self) -> f64 {
        self.widest_blur
    }

    /// Light and blur of the figure.
    pub fn exposure(&self) -> &Exposure {
        self.exposure
    }

    /// Addition to the distances, px, due to a shift of the edges towards the dark: distances are
    /// positive inside.
    pub fn shift(&self) -> f64 {
        self.shift_direction() * self.picture.shift
    }

    /// The model at a pixel, given its distances if an edge may cut it.
    #[inline(always)] // a caller needs only a part of the result
    pub fn shade(&self, pixel: &BandPixel, distances: Option<&[f64; 4]>) -> Shade {
        let place = self.shading_place(&pixel.place());
        let (mut per_blur, mut z) = ([0.0; 4], [0.0; 4]);
        let mut covered = match distances {
            None => coverage::plateau(pixel.depth() > 0.0),
            Some(distances) => {
                per_blur = self.exposure.blurs(&place).map(|blur| 1.0 / blur);
                z = std::array::from_fn(|i| distances[i] * per_blur[i]);
                coverage(pixel.near, &z, &self.kurtosis, &self.corners)
            }
        };
        let light = self.exposure.light.factor(&place);
        let reflected = self.exposure.ground + self.exposure.contrast * covered.value;
        let (value, mut slope) = self.curve.encode_with_slope(light * reflected);
        let mut residual = value - pixel.value;
        let is_silent = pixel.is_clipped && residual >= 0.0;
        if is_silent {
            (residual, slope, covered.cut_count) = (0.0, 0.0, 0);
        }
        Shade {
            residual,
            is_silent,
            slope,
            light,
            reflected,
            coverage: covered,
            per_blur,
            z,
            place,
        }
    }

    /// Distance (in blurs) from the cutting side of a pixel cut by one side, positive towards the
    /// light.
    pub fn blurs_towards_light(&self, shade: &Shade) -> Option<f64> {
        match shade.coverage.cut_count {
            1 => Some(shade.z[shade.coverage.cuts[0].0] * self.exposure.contrast.signum()),
            _ => None,
        }
    }

    /// Difference of the coded values of figure and ground.
    pub fn coded_contrast(&self) -> f64 {
        let [ground, within] = [false, true].map(|inside| {
            self.curve
                .encode_with_slope(self.plateau_reflection(inside))
                .0
        });
        within - ground
    }

    /// Derivative of the coded value by the distance to a side that cuts it with the given density.
    #[inline]
    pub fn gain(&self, shade: &Shade, (side, density): (usize, f64)) -> f64 {
        shade.slope * shade.light * self.exposure.contrast * density * shade.per_blur[side]
    }

    /// Derivative of the coded value by the blur across that side, times `1` and the derivatives of
    /// a [`Variation`].
    #[inline]
    pub fn blur_row(&self, shade: &Shade, cut: (usize, f64)) -> [f64; 1 + VARIATION_PARAMETERS] {
        let (side, density) = cut;
        let by_blur = shade.coverage.by_log_blur - density * shade.z[side];
        let by_blur = self.gain(shade, (side, by_blur));
        let [x, y, square] = Variation::wrt_parameters(&shade.place);
        [1.0, x, y, square].map(|by| by_blur * by)
    }

    /// Sign of the change of the distances when an edge moves towards the dark.
    fn shift_direction(&self) -> f64 {
        if self.figure.dark_inside { -1.0 } else { 1.0 }
    }

    /// Derivatives by the parameters shared by all pixels of the picture.
    pub fn wrt_picture(&self, shade: &Shade) -> [f64; PICTURE_PARAMETERS] {
        let mut all = [0.0; PICTURE_PARAMETERS];
        if self.has_free_curve && !shade.is_silent {
            let at_pixel = self.curve.sensitivity(shade.light * shade.reflected);
            for (i, [ground, contrast]) in self.translation.iter().enumerate() {
                let reflected = ground + contrast * shade.coverage.value;
                all[i] = at_pixel[i] + shade.slope * shade.light * reflected;
            }
        }
        if self.has_free_shift {
            let cuts = &shade.coverage.cuts[..shade.coverage.cut_count];
            let by_distance: f64 = cuts.iter().map(|cut| self.gain(shade, *cut)).sum();
            all[SHIFT] = self.shift_direction() * by_distance;
        }
        if self.has_free_kurtosis && !shade.is_silent {
            let by_coverage = shade.slope * shade.light * self.exposure.contrast;
            all[KURTOSIS] = by_coverage * shade.coverage.by_kurtosis;
        }
        all
    }

    /// Derivatives by the light's parameters.
    #[inline]
    pub fn wrt_light(&self, shade: &Shade) -> [f64; LIGHT_PARAMETERS] {
        let by_light = shade.slope * shade.light;
        let by_variation = shade.slope * shade.reflected;
        let [x, y, square] = Variation::wrt_parameters(&shade.place);
        [
            by_light,
            by_light * shade.coverage.value,
            by_variation * x,
            by_variation * y,
            by_variation * square,
        ]
    }

    /// Derivatives by the exposure's parameters.
    pub fn wrt_exposure(&self, shade: &Shade) -> [f64; EXPOSURE_PARAMETERS] {
        let mut all = [0.0; EXPOSURE_PARAMETERS];
        all[..LIGHT_PARAMETERS].copy_from_slice(&self.wrt_light(shade));
        for cut in &shade.coverage.cuts[..shade.coverage.cut_count] {
            let row = self.blur_row(shade, *cut);
            let jacobian = self.exposure.blur_jacobian(cut.0);
            for (sum, by) in all[LIGHT_PARAMETERS..].iter_mut().zip(&jacobian) {
                *sum += by.iter().zip(&row).map(|(by, row)| by * row).sum::<f64>();
            }
        }
        all
    }
}
