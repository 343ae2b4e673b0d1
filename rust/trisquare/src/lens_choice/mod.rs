//! Choice of the lens.
//!
//! Models of one family are nested, and chosen by their evidence. Families are chosen by their
//! odds. If the requested lens leaves residuals that another explains, a warning names the other
//! one.

mod doubt;
mod evidence;
mod families;
mod family_odds;
mod fisheye_cure;
mod models;
mod opencv_cure;

pub use families::{FamilyChoice, RejectedFamily, calibrate_by_family};
pub use fisheye_cure::{or_fisheye, warn_of_fisheye};
pub use models::{ModelAlternative, ModelChoice, calibrate_by_evidence};
pub use opencv_cure::warn_of_opencv_lens;
