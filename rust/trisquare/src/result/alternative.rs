//! Alternative settings of a calibration, and the results with them.

use std::borrow::Cow;
use std::fmt;

use crate::lens::DISTORTION;

/// An alternative setting of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Setting<'a> {
    /// The lens model of this name.
    Model(&'a str),
    /// The ratio of the focal lengths held.
    AspectHeld,
    /// The principal point held.
    PrincipalPointHeld,
    /// The distortion free where it is held, with the lens model of this name.
    DistortionFree(&'a str),
}

/// The focal length with another setting, which has been tried.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Alternative<'a> {
    /// The setting.
    pub setting: Setting<'a>,
    /// `fx` with that setting, pixels.
    pub focal: f64,
}

impl fmt::Display for Alternative<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.setting {
            Setting::Model(name) => write!(f, "With the lens model {name},")?,
            Setting::AspectHeld => write!(f, "With the aspect fixed,")?,
            Setting::PrincipalPointHeld => write!(f, "With the principal point fixed,")?,
            Setting::DistortionFree(name) => {
                write!(f, "With the distortion free (lens model {name}),")?;
            }
        }
        write!(f, " fx is {:.1}", self.focal)
    }
}

/// Returns the text on the focal length with something held, and on when that is wrong.
pub(super) fn held_focal(setting: Setting<'_>, held: Option<f64>, wrong: &str) -> String {
    held.map_or_else(String::new, |focal| {
        format!(" {}, {wrong}", Alternative { setting, focal })
    })
}

/// Returns the text on the model that fits a lens beyond its model.
pub(super) fn richer_focal(cure: Option<&(String, f64)>, held: &[Cow<'static, str>]) -> String {
    match cure {
        Some((model, focal)) => {
            let (setting, focal) = (cure_setting(model, held), *focal);
            format!(" {}", Alternative { setting, focal })
        }
        None => " No richer model of the same family fits it either: try a model of another family"
            .into(),
    }
}

/// Returns the setting under which a model fits a lens.
pub(super) fn cure_setting<'a>(model: &'a str, held: &[Cow<'static, str>]) -> Setting<'a> {
    match held.iter().any(|name| name == DISTORTION) {
        true => Setting::DistortionFree(model),
        false => Setting::Model(model),
    }
}
