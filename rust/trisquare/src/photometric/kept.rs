//! Pixels of a picture that a later fit to the pixels will read, chosen before a camera is known.

use nalgebra::Vector2;

use super::band_pixels::Width;
use super::outline::bounds;
use crate::geometry::Line;
use crate::image::{KeptPixels, Picture};
use crate::observations::PlaneEdges;

/// Maximum distance (px) of the fitted outline from the samples and from the extrapolation of their
/// ends: twice the deviation that a lens causes over half a side.
const MAX_DEVIATION: f64 = 6.0;

/// The pixels that [`calibrate_photographs`](crate::calibrate_photographs) reads of a picture in
/// which these figures were measured, with sides of at most this [`blur`](crate::SpanEdges::blur)
/// (px): those near outlines of four sides.
#[must_use]
pub fn pixels_to_keep(picture: &Picture, figures: &[PlaneEdges], blur: f64) -> KeptPixels {
    let width = Width::of_blur(blur);
    let outlines: Vec<Vec<Vector2<f64>>> = figures.iter().filter_map(outline).collect();
    picture.near(outlines.iter().map(|outline| {
        let (low, high) = bounds(outline.iter());
        let reach = width.reach((high - low).norm()) + MAX_DEVIATION;
        (&outline[..], reach)
    }))
}

/// The samples of a figure and, between those of two sides, their extrapolated corner.
fn outline(figure: &PlaneEdges) -> Option<Vec<Vector2<f64>>> {
    let sides: &[Vec<Vector2<f64>>; 4] = figure.points.as_slice().try_into().ok()?;
    let mut path = Vec::with_capacity(figure.sample_count() + 4);
    for i in 0..4 {
        let (side, before, after) = (&sides[i], &sides[(i + 3) % 4], &sides[(i + 1) % 4]);
        path.extend(nearer_half(side, before)?.rev());
        path.extend(nearer_half(side, after)?);
        let [current, next] = [nearer_half(side, after)?, nearer_half(after, side)?];
        let [current, next] =
            [current, next].map(|half| Line::fit(half.map(|point| (*point, 1.0))));
        path.extend(
            current
                .zip(next)
                .and_then(|(current, next)| current.intersection(&next)),
        );
    }
    Some(path)
}

/// The half of a side's samples that is nearer to another side, ordered towards it; `None` if there
/// are no samples.
fn nearer_half<'a>(
    side: &'a [Vector2<f64>],
    other: &[Vector2<f64>],
) -> Option<impl DoubleEndedIterator<Item = &'a Vector2<f64>> + Clone> {
    let middle = other.iter().sum::<Vector2<f64>>() / other.len() as f64;
    let (first, last) = (side.first()?, side.last()?);
    let is_forward = (last - middle).norm() < (first - middle).norm();
    let half = side.len().div_ceil(2);
    let part = if is_forward {
        &side[side.len() - half..]
    } else {
        &side[..half]
    };
    Some((0..half).map(move |k| &part[if is_forward { k } else { half - 1 - k }]))
}

#[cfg(test)]
mod tests {
    use super::super::band::Bands;
    use super::super::band_pixels::PixelFigure;
    use super::super::photographs::Photographs;
    use super::*;
    use crate::image::{PictureTone, Tone};
    use crate::observations::{Placement, PlaneState, Polarity, View, sort_by_plane};
    use crate::synthetic::{Scene, SceneOptions};
    use nalgebra::Vector3;

    #[test]
    fn a_fit_reads_the_same_as_from_the_whole_picture() {
        let tones = [PictureTone::Known(Tone::Srgb)];
        for seed in 0..8 {
            let scene = Scene::random(seed, SceneOptions::default());
            let mut figures = scene.edges(seed, 0.1, 6.0);
            for figure in &mut figures {
                figure.polarity = Some(Polarity::DarkInside);
                // As measured: without the blurred corners, and with one of them hidden.
                figure.points.iter_mut().for_each(|side| {
                    *side = side[3..side.len() - 3].to_vec();
                });
                let hidden = figure.points[1].len() / 4;
                figure.points[1].drain(..hidden);
            }
            let planes = sort_by_plane(&figures).unwrap();
            let [width, height] = [scene.size.width, scene.size.height].map(|n| n as usize);
            let levels = (0..width * height).map(|i| (i * 31 % 251) as u8).collect();
            let picture = Picture::from_u8(width, height, 1, levels).unwrap();
            let everywhere = [Vector2::zeros()];
            let whole = picture.near([(&everywhere[..], 1e4)]);
            // Planes slightly displaced from the samples.
            let planes_seen = scene.poses.iter().map(|pose| {
                let mut pose = *pose;
                pose.translation += 2e-3 * pose.translation.z * Vector3::new(1.0, -1.0, 0.0);
                PlaneState {
                    pose,
                    figures: vec![Placement::IDENTITY],
                }
            });
            let view = View {
                lens: scene.camera,
                planes: planes_seen.collect(),
                relations: Vec::new(),
            };
            let read = |pixels: &KeptPixels, width| {
                let photographs = Photographs {
                    pictures: &[pixels],
                    tones: &tones,
                };
                let bands = Bands::new(&figures, &planes, &view, &photographs);
                let all = (0..planes.len()).map(|p| bands.of_plane(p, width).ok());
                let all: Option<Vec<Vec<PixelFigure>>> = all.collect();
                all.map(|all| all.concat())
            };
            for (width, blur) in [(Width::Usual, 0.8), (Width::Wide, 4.0)] {
                let kept = pixels_to_keep(&picture, &figures, blur);
                let [found, expected] = [&kept, &whole].map(|pixels| read(pixels, width).unwrap());
                assert!(expected.iter().all(|figure| figure.pixels.len() > 1000));
                assert_eq!(
                    format!("{found:?}"),
                    format!("{expected:?}"),
                    "scene {seed}"
                );
            }
        }
    }

    #[test]
    fn what_is_no_outline_keeps_nothing() {
        let picture = Picture::from_u8(64, 64, 1, vec![0; 64 * 64]).unwrap();
        let line =
            PlaneEdges::line((0..9).map(|i| Vector2::repeat(f64::from(i))).collect()).unwrap();
        let mut empty = PlaneEdges::new(Vec::new(), vec![Vec::new(); 4]);
        empty.polarity = Some(Polarity::DarkInside);
        let kept = pixels_to_keep(&picture, &[line, empty], 1.0);
        assert!(kept.reader(Tone::Linear).get(4, 4).is_none());
    }
}
