//! Checks of values read by serde.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// Tolerance of a stored unit vector or rotation, for truncated digits.
pub(crate) const CUT_DIGITS: f64 = 1e-6;

/// Reads the fields of a type with a method `check`, and returns the error of that method.
macro_rules! read_checked {
    ($type:ident { $($field:ident: $of:ty),+ $(,)? }) => {
        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                // Named like the type, as messages of serde contain the name.
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

/// Reads a number that must be positive, such as a gamma or a standard deviation.
///
/// # Errors
/// That of the deserializer, or one for a number that is not positive and finite.
pub(crate) fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(D::Error::custom(format!(
            "a gamma or a standard deviation must be positive and finite, not {value}"
        ))),
    }
}
