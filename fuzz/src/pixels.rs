//! The pixel entry points: localising edges, and a calibration with its photographs.

use std::sync::LazyLock;

use nalgebra::Vector2;
use trisquare::internals::cdf;
use trisquare::synthetic::Scene;
use trisquare::{
    EdgeSpan, ImageSize, Method, NoEdge, Photographs, Picture, PictureTone, PlaneEdges, Polarity,
    SpanEdges, Tone, calibrate_photographs as solve, pixels_to_keep,
};

use crate::bytes::Bytes;
use crate::figures::{View, corner, damage, scenes};
use crate::{Outcome, check};

/// Small, so that a million cases finish; squares in it have sides of some 30 pixels.
const SIZE: ImageSize = ImageSize {
    width: 96,
    height: 72,
};

static SCENES: LazyLock<Vec<Scene>> = LazyLock::new(|| scenes(SIZE));

/// `trisquare::localise` on any picture, along any paths.
pub fn localise(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let tone = bytes.tone();
    let (picture, spans) = searched(tone, bytes);
    let (found, ..) = trisquare::localise(&picture, &spans, tone);
    assert_eq!(found.len(), spans.len());
    measured_spans(&found)
}

/// `trisquare::localise_with_unknown_tone` on any picture, along any paths.
pub fn localise_with_unknown_tone(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let tone = bytes.tone();
    let (picture, spans) = searched(tone, bytes);
    let (found, estimate, _) = trisquare::localise_with_unknown_tone(&picture, &spans);
    assert_eq!(found.len(), spans.len());
    assert!(estimate.picture_tone().is_valid(), "{estimate:?}");
    assert!(estimate.effective_gamma_std().is_finite() && estimate.misfit.is_finite());
    assert!(estimate.covariance.iter().all(|v| v.is_finite()));
    measured_spans(&found)
}

/// Returns a picture, and the paths along which edges are searched.
fn searched(tone: Tone, bytes: &mut Bytes<'_>) -> (Picture, Vec<EdgeSpan>) {
    let (canvas, mut spans) = if bytes.once_in(4) {
        (Canvas::garbage(bytes), Vec::new())
    } else {
        let view = View::sound(bytes, &SCENES);
        let mut canvas = Canvas::of(&view, tone, bytes);
        canvas.damage(bytes);
        let mut spans = spans_of(&view, bytes);
        // One square tests as much as three.
        spans.truncate(if bytes.once_in(4) { 12 } else { 4 });
        (canvas, spans)
    };
    for _ in 0..bytes.below(4) {
        spans.push(any_span(canvas.size, bytes));
    }
    (canvas.picture(bytes), spans)
}

/// Checks the samples of the measured spans.
pub(crate) fn measured_spans(found: &[Result<SpanEdges, NoEdge>]) -> Outcome {
    let mut outcome = "no span";
    for span in found {
        outcome = match span {
            Ok(edges) => {
                assert!(edges.points.len() >= 2 && edges.points.len() == edges.std.len());
                assert!(edges.points.iter().all(|p| p.iter().all(|v| v.is_finite())));
                assert!(edges.std.iter().all(|s| s.is_finite() && *s > 0.0));
                let about = [edges.blur, edges.dark, edges.light, edges.noise];
                assert!(about.iter().all(|v| v.is_finite()), "{about:?}");
                "Ok"
            }
            Err(NoEdge::NoPath) => "NoPath",
            Err(NoEdge::OutsidePicture) => "OutsidePicture",
            Err(NoEdge::Inconsistent) => "Inconsistent",
            Err(NoEdge::Unmeasurable) => "Unmeasurable",
            Err(NoEdge::Cramped) => "Cramped",
            Err(_) => "of another kind",
        };
        if outcome == "Ok" {
            break;
        }
    }
    outcome
}

/// `trisquare::calibrate_photographs`: figures, and pictures that may or may not show them.
pub fn calibrate_photographs(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let tone = bytes.tone();
    let mut options = bytes.options(SIZE);
    if !bytes.once_in(4) {
        // Otherwise, squares this small determine too little, and the pixels are not used.
        (options.fixed.principal_point, options.fixed.aspect) = (true, true);
        options.method = Method::MaximumLikelihood;
    }
    let view = View::sound(bytes, &SCENES);
    let mut canvas = if bytes.once_in(16) {
        Canvas::garbage(bytes)
    } else {
        Canvas::of(&view, tone, bytes)
    };
    if bytes.once_in(3) {
        canvas.damage(bytes);
    }
    let picture = canvas.picture(bytes);
    let mut figures = if bytes.once_in(4) {
        view.figures(bytes)
    } else {
        measured(&view, &picture, tone)
    };
    if bytes.once_in(4) {
        damage(&mut figures, SIZE, bytes);
    }
    let blur = bytes.between(0.0, 4.0);
    let kept = pixels_to_keep(&picture, &figures, blur);
    let pictures = vec![&kept; 1 + bytes.below(2)];
    let tones: Vec<_> = pictures.iter().map(|_| picture_tone(tone, bytes)).collect();
    let photographs = Photographs {
        pictures: &pictures,
        tones: &tones,
    };
    let found = solve(&figures, SIZE, &options, Some(&photographs));
    for fit in found.iter().flat_map(|found| &found.tones) {
        assert!(Tone::Power(fit.curve).is_valid(), "{fit:?}");
        assert!(fit.effective_gamma_std().is_none_or(f64::is_finite));
        let finite = |(shift, std): (f64, f64)| shift.is_finite() && std.is_finite();
        assert!(fit.shift.is_none_or(finite), "{fit:?}");
    }
    match (check::calibration(&found), found) {
        ("Ok", Ok(found)) => match found.stage {
            trisquare::Stage::Linear => "Ok, linear",
            trisquare::Stage::Edges => "Ok, edges",
            trisquare::Stage::Pixels => "Ok, pixels",
        },
        (refused, _) => refused,
    }
}

/// Returns what is known about the tone of a picture that was coded with `tone`.
fn picture_tone(tone: Tone, bytes: &mut Bytes<'_>) -> PictureTone {
    match bytes.below(4) {
        0 | 1 => PictureTone::Known(tone),
        2 => PictureTone::Estimated(bytes.curve()),
        _ => PictureTone::Shifted(bytes.curve(), bytes.power(-4.0, 1.0)),
    }
}

/// Measures figures as the package does: every side is localised from its chord.
fn measured(view: &View, picture: &Picture, tone: Tone) -> Vec<PlaneEdges> {
    let spans: Vec<EdgeSpan> = sides(view).collect();
    let (found, ..) = trisquare::localise(picture, &spans, tone);
    found
        .chunks_exact(4)
        .filter_map(|sides| {
            let sides: Option<Vec<_>> = sides.iter().map(|s| s.as_ref().ok()).collect();
            let sides = sides?;
            let points = sides.iter().map(|s| s.points.clone()).collect();
            let mut figure = PlaneEdges::square(points).ok()?;
            figure.std = Some(sides.iter().map(|s| s.std.clone()).collect());
            figure.polarity = Some(Polarity::DarkInside);
            Some(figure)
        })
        .collect()
}

/// Returns the chords of all sides of dark squares, clockwise on the screen or not.
fn sides(view: &View) -> impl Iterator<Item = EdgeSpan> + '_ {
    (0..view.poses.len()).flat_map(move |plane| {
        (0..4).map(move |side| EdgeSpan {
            path: [side, side + 1]
                .map(|i| view.see(plane, corner(i, 0.5)))
                .to_vec(),
            // The plane's Z points away from the camera: its sides run clockwise on the screen.
            polarity: -1.0,
            bounds: [side + 3, side + 1].map(|i| Some(4 * plane + i % 4)),
            ..EdgeSpan::new(Vec::new(), 1.0)
        })
    })
}

/// Returns the true sides, slightly displaced.
fn spans_of(view: &View, bytes: &mut Bytes<'_>) -> Vec<EdgeSpan> {
    let shift = bytes.power(-1.0, 1.0);
    let mut spans: Vec<EdgeSpan> = sides(view).collect();
    for span in &mut spans {
        for point in &mut span.path {
            *point += Vector2::new(bytes.unit() - 0.5, bytes.unit() - 0.5) * shift;
        }
    }
    spans
}

fn any_span(size: ImageSize, bytes: &mut Bytes<'_>) -> EdgeSpan {
    EdgeSpan {
        path: bytes.points(size, 5),
        polarity: bytes.coefficient(),
        bounds: std::array::from_fn(|_| bytes.once_in(2).then(|| bytes.below(20))),
        crossings: Vec::new(),
        rims: Vec::new(),
        tags: Vec::new(),
        tag_border: 0.0,
        margin: match bytes.once_in(4) {
            true => [10.0 * bytes.coefficient(), 10.0 * bytes.coefficient()],
            false => [f64::INFINITY; 2],
        },
        is_beside_others: bytes.once_in(4),
        far_edge: bytes.once_in(4).then(|| bytes.below(20)),
    }
}

/// Coded grey values, from which pictures of any kind are made.
pub(crate) struct Canvas {
    size: ImageSize,
    values: Vec<f32>,
}

impl Canvas {
    pub(crate) fn garbage(bytes: &mut Bytes<'_>) -> Self {
        let (width, height) = (1 + bytes.below(40), 1 + bytes.below(40));
        Self {
            size: ImageSize {
                width: width as u32,
                height: height as u32,
            },
            values: (0..width * height)
                .map(|_| f32::from(bytes.byte()) / 255.0)
                .collect(),
        }
    }

    /// Draws the view's squares on lighter (at times darker) ground, with blur and noise.
    fn of(view: &View, tone: Tone, bytes: &mut Bytes<'_>) -> Self {
        let (width, height) = (view.size.width as usize, view.size.height as usize);
        let (mut dark, mut light) = (bytes.between(0.0, 0.4), bytes.between(0.4, 1.0));
        if bytes.once_in(16) {
            (dark, light) = (light, dark);
        }
        let (blurred, noisy) = (bytes.once_in(4), bytes.once_in(4));
        let blur = 0.4 * bytes.power(0.0, if blurred { 1.0 } else { 0.3 });
        let mut covered = vec![0.0; width * height];
        for plane in 0..view.poses.len() {
            cover(&mut covered, width, view, plane, blur);
        }
        let (noise, mut state) = (
            bytes.power(-4.0, if noisy { -0.5 } else { -2.0 }),
            bytes.seed(),
        );
        let values = covered.iter().map(|covered| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let disturbance = (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5;
            (tone.encode(light + (dark - light) * covered) + noise * disturbance) as f32
        });
        Self {
            size: view.size,
            values: values.collect(),
        }
    }

    /// Sets each pixel to the value of a function.
    pub(crate) fn drawn(size: ImageSize, mut shade: impl FnMut(Vector2<f64>) -> f64) -> Self {
        let rows = (0..size.height).map(f64::from);
        let pixels = rows.flat_map(|y| (0..size.width).map(move |x| Vector2::new(f64::from(x), y)));
        Self {
            size,
            values: pixels.map(|pixel| shade(pixel) as f32).collect(),
        }
    }

    /// Returns width, height and 8-bit values.
    pub(crate) fn grey_bytes(&self) -> (usize, usize, Vec<u8>) {
        let values = self.values.iter().map(|v| (255.0 * v) as u8);
        (
            self.size.width as usize,
            self.size.height as usize,
            values.collect(),
        )
    }

    /// Covers patches of the picture with another shade, or with an arbitrary, huge or NaN value.
    pub(crate) fn damage(&mut self, bytes: &mut Bytes<'_>) {
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        for _ in 0..bytes.below(4) {
            let (left, top) = (bytes.below(width), bytes.below(height));
            let right = left + bytes.below(width - left) + 1;
            let bottom = top + bytes.below((height - top).min(30)) + 1;
            let shade = match bytes.below(6) {
                0 => bytes.any() as f32,
                1 => 1e30,
                2 => f32::NAN,
                _ => bytes.unit() as f32,
            };
            for row in self.values.chunks_exact_mut(width).take(bottom).skip(top) {
                row[left..right].fill(shade);
            }
        }
    }

    /// Returns the picture as one of the kinds that cameras provide.
    pub(crate) fn picture(&self, bytes: &mut Bytes<'_>) -> Picture {
        let channels = bytes.pick(&[1, 3]);
        let tints: [f32; 3] = std::array::from_fn(|_| bytes.between(0.5, 1.0) as f32);
        let values = self
            .values
            .iter()
            .flat_map(|v| (0..channels).map(move |channel| v * tints[channel]));
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        let picture = match bytes.below(3) {
            0 => {
                let values = values.map(|v| (255.0 * v) as u8).collect();
                Picture::from_u8(width, height, channels, values)
            }
            1 => {
                let values = values.map(|v| (65_535.0 * v) as u16).collect();
                Picture::from_u16(width, height, channels, values)
            }
            _ => Picture::from_f32(width, height, channels, values.collect()),
        };
        picture.expect("the values fill the size")
    }
}

/// Adds the fraction of every pixel that a square covers: the product over its sides, which are
/// straight from corner to corner.
fn cover(covered: &mut [f64], width: usize, view: &View, plane: usize, blur: f64) {
    let corners: [_; 4] = std::array::from_fn(|i| view.see(plane, corner(i, 0.5)));
    let normals: [_; 4] = std::array::from_fn(|i| {
        let along = (corners[(i + 1) % 4] - corners[i]).normalize();
        Vector2::new(-along.y, along.x)
    });
    let reach = 4.0 * blur;
    let low = corners.iter().fold(corners[0], |low, c| low.inf(c));
    let high = corners.iter().fold(corners[0], |high, c| high.sup(c));
    for (y, row) in covered.chunks_exact_mut(width).enumerate() {
        let y = y as f64;
        if y < low.y - reach || y > high.y + reach {
            continue;
        }
        for (x, share) in row.iter_mut().enumerate() {
            let x = x as f64;
            if x < low.x - reach || x > high.x + reach {
                continue;
            }
            let pixel = Vector2::new(x, y);
            let inside = |i: usize| cdf(normals[i].dot(&(pixel - corners[i])) / blur);
            *share += (0..4).map(inside).product::<f64>();
        }
    }
}
