//! Misfit of the mean edge profile of a picture.

use super::figure_chart::all_distances;
use super::fit::{PixelFit, PixelState};
use crate::lens::Lens;
use crate::localise::ResidualProfile;

/// Stride of the pixels used.
const STRIDE: u32 = 4;

/// Root mean square of the mean profile's residuals, as a fraction of the contrast, less the
/// contribution of noise; `None` if a picture cannot be read again.
pub(super) fn misfit<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    picture: usize,
) -> Option<f64> {
    let figures = fit.subsampled(STRIDE)?;
    let few = PixelFit {
        figures: &figures,
        ..fit.clone()
    };
    let mut mean = ResidualProfile::default();
    for (index, figure) in figures.iter().enumerate() {
        if figure.image != picture {
            continue;
        }
        let scene = few.scene(&state.view, &state.exposures[index], &state.pictures, index)?;
        let distances = all_distances(&scene, figure, |pixel| scene.may_cut(pixel))?;
        let mut profile = ResidualProfile::default();
        for (pixel, distances) in figure.pixels.iter().zip(&distances) {
            if scene.may_cut(pixel) {
                let shade = scene.shade(pixel, Some(distances));
                if let Some(place) = scene.blurs_towards_light(&shade) {
                    profile.add(place, shade.residual);
                }
            }
        }
        mean.merge(&profile.relative_to(scene.coded_contrast()));
    }
    Some(mean.misfit())
}
