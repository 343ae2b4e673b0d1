//! Parts of the messages of warnings.

use std::borrow::Cow;

/// Formats a fraction in per cent.
pub(super) fn part_of_whole(part: f64) -> String {
    match part {
        ..0.005 => "less than 1 %".into(),
        _ => format!("{:.0} %", 100.0 * part),
    }
}

/// Formats a value and its standard deviation, with two significant digits of the latter.
pub(super) fn with_its_std(value: f64, std: f64) -> String {
    let decimals = decimals_of(std);
    format!("{value:.decimals$} +- {std:.decimals$}")
}

/// Formats a number with two significant digits.
pub(super) fn two_digits(value: f64) -> String {
    let decimals = decimals_of(value);
    format!("{value:.decimals$}")
}

/// Formats a number with its sign and two significant digits.
pub(super) fn signed_two_digits(value: f64) -> String {
    let decimals = decimals_of(value.abs());
    format!("{value:+.decimals$}")
}

/// Number of decimals that show two significant digits.
fn decimals_of(value: f64) -> usize {
    match value > 0.0 {
        true => (1.0 - value.log10().floor()).clamp(0.0, 12.0) as usize,
        false => 6,
    }
}

/// Formats a factor; the digits of a large one are meaningless and are omitted.
pub(super) fn times(factor: f64) -> String {
    if factor < 100.0 {
        format!("{factor:.1} times")
    } else {
        "more than 100 times".into()
    }
}

/// Text on the factor by which a standard deviation was raised; empty if it rounds to 1.
pub(super) fn std_increase(parameter: &str, factor: f64) -> String {
    if factor < 1.05 {
        return String::new();
    }
    format!(
        "; the standard deviation of {parameter} is {} as large because of this",
        times(factor)
    )
}

/// Reason why a parameter is hardly known, and what to do.
pub(super) fn open_parameter_advice(by_tone: bool) -> &'static str {
    if by_tone {
        "the tone curve is not known, and may have shifted all edges. State it if you know it, take the \
         picture without sharpening, or show more planes"
    } else {
        "the errors of the planes exceed the noise, and the planes are too few or too similar to \
         average them out. Show more planes, or flatter ones"
    }
}

/// Reason why lines were not used.
pub(super) fn lines_not_used(sigmas: Option<f64>) -> String {
    match sigmas {
        Some(sigmas) => format!(
            "they would change the distortion by {sigmas:.1} of its standard deviations (are most \
             of them curved, or does the lens model not fit the lens?)"
        ),
        None => {
            "hardly any of them is straight with a distortion that the planes allow, or no free \
             parameter depends on them"
                .to_owned()
        }
    }
}

/// Text on what planes contradict, and the possible causes: a single plane contradicts only what is
/// held.
pub(super) fn contradiction(
    factor: f64,
    displacement: f64,
    planes: usize,
    known_to: Option<f64>,
    held: &[Cow<'static, str>],
) -> String {
    let (what, sides, camera, which) = match planes {
        1 => (
            "the plane contradicts the camera",
            "its sides",
            "the camera",
            "it",
        ),
        _ => (
            "the planes contradict each other",
            "their sides",
            "one camera",
            "one of them",
        ),
    };
    // Warnings stored by older versions do not contain the displacement.
    let displaced = match displacement {
        0.0 => format!(
            "{factor:.1} times as far from where {camera} would show them as their noise explains"
        ),
        _ => format!(
            "{} px from where {camera} would show them, {factor:.1} times as far as their noise \
             explains",
            two_digits(displacement)
        ),
    };
    let known = known_to.map_or_else(String::new, |part| {
        format!(
            " (focal lengths and principal point are still known to {} % of the focal length, or of \
             the width)",
            two_digits(100.0 * part)
        )
    });
    let suspected = held_phrase(held);
    format!(
        "{what}: {sides} lie {displaced}{known}; {which} may not be flat, or not exactly square (or of \
         the stated shape){suspected}"
    )
}

/// Further possible cause where something is held.
pub(super) fn held_phrase(held: &[Cow<'static, str>]) -> String {
    match held {
        [] => String::new(),
        _ => format!(", or a fixed value ({}) is wrong", held.join(", ")),
    }
}

/// Figure of its plane to which a side belongs, unless it is the first.
pub(super) fn figure_phrase(figure: usize) -> String {
    match figure {
        0 => String::new(),
        1 => " (its second outline)".into(),
        _ => format!(" (its figure {figure})"),
    }
}

/// Change of `fx` without a plane, unless `fx` is held.
pub(super) fn focal_change_phrase(focal_change: f64) -> String {
    match focal_change {
        0.0 => String::new(),
        _ => format!(
            " (without it, fx would change by {:+.2} %)",
            100.0 * focal_change
        ),
    }
}

/// The farthest of some stray samples.
pub(super) fn numbered_sample(samples: usize, [plane, figure, side, sample]: [usize; 4]) -> String {
    let (which, lies) = match samples {
        1 => ("", " lies"),
        _ => ("the farthest, ", ", lies"),
    };
    let figure = figure_phrase(figure);
    format!("{which}sample {sample} of side {side} of plane {plane}{figure}{lies}")
}

/// Text on rejected planes where the others cannot be checked.
pub(super) fn rejection_phrase(rejected: usize) -> &'static str {
    match rejected {
        0 => "",
        1 => ", and one of them may be the wrong one instead of the rejected plane",
        _ => ", and some of them may be the wrong ones instead of the rejected planes",
    }
}

/// Number of planes, and of their directions if those are fewer.
pub(super) fn planes_in_directions(planes: usize, directions: usize) -> String {
    match (planes, directions) {
        (1, _) => "one plane gives".into(),
        (_, 0) => format!("{planes} planes give"),
        (_, 1) => format!("{planes} planes, all in one direction, give"),
        _ if directions < planes => format!("{planes} planes in {directions} directions give"),
        _ => format!("{planes} planes give"),
    }
}

/// Number of further planes whose shape is not known well enough.
pub(super) fn rough_phrase(rough: usize) -> String {
    match rough {
        0 => String::new(),
        1 => " (one more is too small or too rough to check them)".into(),
        _ => format!(" ({rough} more are too small or too rough to check them)"),
    }
}

/// Possible fault of targets that cannot be checked.
pub(super) fn deformation(stretch: f64, are_angles: bool) -> String {
    match are_angles {
        true => format!(
            "the right angles of the targets are off by {:.1} degrees",
            stretch.to_degrees()
        ),
        false => format!(
            "the targets are {:.1} % longer in one direction than in the other, as printers make \
             them",
            100.0 * stretch
        ),
    }
}

/// The groups that differ more than they should.
pub(super) fn groups(one_picture: bool) -> &'static str {
    match one_picture {
        true => "the planes",
        false => "the pictures, or the planes of one picture,",
    }
}

/// Possible causes of that; within one picture neither focus nor zoom changes.
pub(super) fn causes_of_variation(one_picture: bool) -> &'static str {
    match one_picture {
        true => {
            "Are all flat, and exactly square (or of the stated shape), and did nothing move while \
             the picture was taken?"
        }
        false => {
            "Did focus or zoom change, did something move while a picture was taken, or are the \
             targets not flat or stretched?"
        }
    }
}

/// Cause of common errors of sides.
pub(super) fn cause_of_errors(height: Option<f64>) -> String {
    match height {
        Some(height) => format!(
            "its sheet rises by {} % of its size",
            two_digits(100.0 * height)
        ),
        None => {
            "the paper or the print is not flat, or the lens model does not fit the lens".to_owned()
        }
    }
}
