//! One function per entry point of the crate, from arbitrary bytes to a checked result.
//!
//! Every function reads its arguments from the bytes (sometimes garbage, mostly plausible arguments
//! with damage, so that the later stages are reached), calls the entry point, and panics where a
//! result is not finite or otherwise impossible. libFuzzer calls them through `fuzz_targets`, the
//! `soak` binary with random bytes.

mod boards;
mod bytes;
mod check;
mod coordinates;
mod figures;
mod pixels;
mod steps;

pub use boards::{find_lattices, localise_grid_lines};
pub use coordinates::{calibrate, calibrate_by_evidence, choose, predict, square};
pub use pixels::{calibrate_photographs, localise, localise_with_unknown_tone};
pub use steps::{fit_distortion, lens, linear_steps};

/// Outcome of a case: `"Ok"` or the kind of refusal.
pub type Outcome = &'static str;

/// An entry point, driven by bytes.
pub type Entry = fn(&[u8]) -> Outcome;

/// All entry points by name.
pub const ENTRIES: [(&str, Entry); 13] = [
    ("calibrate", calibrate),
    ("calibrate_by_evidence", calibrate_by_evidence),
    ("choose", choose),
    ("predict", predict),
    ("square", square),
    ("fit_distortion", fit_distortion),
    ("linear_steps", linear_steps),
    ("lens", lens),
    ("localise", localise),
    ("localise_with_unknown_tone", localise_with_unknown_tone),
    ("localise_grid_lines", localise_grid_lines),
    ("find_lattices", find_lattices),
    ("calibrate_photographs", calibrate_photographs),
];
