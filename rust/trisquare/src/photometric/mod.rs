//! The last stage with a picture: fit of the joint model to the pixels themselves.

mod band;
mod band_pixels;
mod blur_prior;
mod coverage;
mod distance_map;
mod exposure;
mod exposure_fit;
mod figure_chart;
mod figure_sums;
mod fit;
mod hidden_stretches;
mod kept;
mod misfit;
mod optimum;
mod outline;
mod photographs;
mod prior_step;
mod refine;
mod scene;
mod stated_tone;

pub use kept::pixels_to_keep;
pub use photographs::Photographs;
pub(crate) use refine::improve;
