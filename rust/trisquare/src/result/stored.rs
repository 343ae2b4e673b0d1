//! How what a calibration names is read back by serde.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

use crate::lens::Lens;

/// Reads the names of some of a lens's parameters.
///
/// # Errors
/// Those of the deserializer, and one for a parameter that the lens does not have.
pub(super) fn parameter_names<'de, L: Lens, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<&'static str>, D::Error> {
    let known = |name: &String| {
        let names = L::parameter_names().iter();
        let mut found = names.copied().filter(|own| own == name);
        let found = found.next();
        found.ok_or_else(|| D::Error::custom(format!("the lens has no parameter {name:?}")))
    };
    let names = Vec::<String>::deserialize(deserializer)?;
    names.iter().map(known).collect()
}
