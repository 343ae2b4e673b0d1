//! Choice of the candidates that are squares seen by one camera.

mod candidates;
mod choose;
mod hypothesis;
mod inliers;
mod joint_fit;
mod propose;
mod squareness;
mod straightness;
mod subsets;
mod verdict;

pub use choose::choose;
pub use verdict::{Choice, Doubt, Verdict};
