//! Which lens the data ask for.
//!
//! Within a family the models are nested, and chosen by their evidence. Families are chosen by their
//! odds. Where one lens was asked for and another explains what it leaves, a warning names that one.

mod doubt;
mod evidence;
mod families;
mod family_odds;
mod fisheye_cure;
mod models;
mod opencv_cure;

pub use families::{FamilyChoice, RejectedFamily, calibrate_by_family};
pub use fisheye_cure::{heed_fisheye, or_fisheye};
pub use models::{ModelAlternative, ModelChoice, calibrate_by_evidence};
pub use opencv_cure::heed_opencv_lens;
