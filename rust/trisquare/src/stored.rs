//! Values that are checked as serde reads them.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// How far a stored unit vector, or a rotation, may be off one, as by digits that were cut.
pub(crate) const CUT_DIGITS: f64 = 1e-6;

/// Reads a type with a method `check` as its fields, and refuses what that refuses.
macro_rules! read_checked {
    ($type:ident { $($field:ident: $of:ty),+ $(,)? }) => {
        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                // Messages of serde state its name.
                #[derive(serde::Deserialize)]
                struct $type {
                    $($field: $of),+
                }
                let fields = $type::deserialize(deserializer)?;
                let read = Self { $($field: fields.$field),+ };
                read.check().map_err(serde::de::Error::custom)?;
                Ok(read)
            }
        }
    };
}

pub(crate) use read_checked;

/// Reads a number that must be positive, as a gamma or a standard deviation.
///
/// # Errors
/// Those of the deserializer, and one for any other number.
pub(crate) fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(D::Error::custom(format!(
            "a gamma or a standard deviation must be positive and finite, not {value}"
        ))),
    }
}
