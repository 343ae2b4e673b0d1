//! Pictures, and the tone curves by which they are coded.

mod grey_bytes;
mod grey_reader;
mod kept_pixels;
mod picture;
mod picture_tone;
mod pixel_box;
mod power_curve;
mod tone;

pub use grey_bytes::GreyBytes;
pub(crate) use grey_reader::Grey;
pub use grey_reader::GreyReader;
pub use kept_pixels::KeptPixels;
pub(crate) use kept_pixels::KeptReader;
pub use picture::{Picture, PictureError};
pub(crate) use picture_tone::{
    KURTOSIS, KurtosisRole, PICTURE_PARAMETERS, PicturePrior, PictureState, SHIFT, USUAL_KURTOSIS,
};
pub use picture_tone::{PictureTone, ToneFit};
pub(crate) use pixel_box::box_kurtosis;
pub use power_curve::{PowerCurve, Sensitivity};
pub(crate) use power_curve::{SRGB, TONE_PARAMETERS, TonePrior, USUAL};
pub use tone::{Tone, ToneCurve};
