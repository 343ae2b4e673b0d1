//! How what a calibration names is read back by serde.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use serde::de::Error;
use serde::{Deserialize, Deserializer};

use crate::lens::Lens;

/// The crate's own texts are some dozens; what reads more reads no calibrations.
const MOST_TEXTS: usize = 1000;

/// Bytes of a text; the crate's own have less than half as many.
const LONGEST_TEXT: usize = 200;

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

/// Reads a text that the crate states: the name of a parameter, a reason.
///
/// Each different one is kept for the life of the program, as those in the program itself are.
///
/// # Errors
/// Those of the deserializer, and one for what cannot be a text of the crate.
pub(super) fn static_text<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<&'static str, D::Error> {
    static KNOWN: Mutex<BTreeSet<&str>> = Mutex::new(BTreeSet::new());
    let text = String::deserialize(deserializer)?;
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(found) = known.get(text.as_str()) {
        return Ok(found);
    }
    if text.len() > LONGEST_TEXT || known.len() >= MOST_TEXTS {
        return Err(D::Error::custom("a warning holds no text of trisquare"));
    }
    let kept = text.leak();
    known.insert(kept);
    Ok(kept)
}
