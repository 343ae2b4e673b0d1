//! Warnings of a calibration, and the stage that its result comes from.

use std::borrow::Cow;

use super::alternative::{Alternative, Setting, cure_setting, held_focal, richer_focal};
use super::warning_words::{
    cause_of_errors, causes_of_variation, contradiction, deformation, figure_phrase,
    focal_change_phrase, groups, held_phrase, lines_not_used, numbered_sample,
    open_parameter_advice, part_of_whole, planes_in_directions, rejection_phrase, rough_phrase,
    signed_two_digits, std_increase, times, two_digits, with_its_std,
};
use crate::error::counted;

/// A text of the crate, or one that was read back.
type Text = Cow<'static, str>;

/// A plane that disagrees with the rest.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Disagreement {
    /// Index of the plane.
    pub plane: usize,
    /// Relative change of the focal length `fx` without the plane; 0 where it is held.
    pub focal_change: f64,
    /// The size of the disagreement, as a normal deviate.
    pub sigmas: f64,
}

/// The stage that a result comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Stage {
    /// The paper's three linear steps.
    Linear,
    /// Joint maximum likelihood over edge samples.
    Edges,
    /// The same model fitted to the pixels.
    Pixels,
}

/// Severity of a warning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Severity {
    /// Something was left out, or an interval widened; the answer stands.
    Low,
    /// Something should be checked.
    Medium,
    /// The answer may be wrong beyond its stated uncertainty.
    High,
}

/// A warning, about something that the user can act on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Warning {
    /// One plane disagrees with the rest.
    #[error(
        "plane {} disagrees with the rest by {:.1} standard deviations{}: is it flat, and \
         exactly square (or of the stated shape)?",
        .0.plane, .0.sigmas, focal_change_phrase(.0.focal_change)
    )]
    Disagreement(Disagreement),
    /// One side does not fit the square that the others show.
    #[error(
        "plane {plane}: side {side}{} is rejected: its samples lie {distance:.2} px (rms) from the \
         line that the other sides predict (is it bent, torn, or covered?)",
        figure_phrase(*.figure)
    )]
    SideRejected {
        /// Index of the plane.
        plane: usize,
        /// Index of the figure on its plane, not among the edges.
        figure: usize,
        /// Index of the outline's side, in the order of its samples.
        side: usize,
        /// Root mean square distance of its samples, px.
        distance: f64,
    },
    /// Some samples are far from their line, but their neighbours are not.
    #[error(
        "{} {} used: {} {distance:.2} px off its line, but its neighbours do not. Was it measured \
         on another edge?",
        counted(*.samples, "sample"),
        if *.samples == 1 { "is not" } else { "are not" },
        numbered_sample(*.samples, [*.plane, *.figure, *.side, *.sample])
    )]
    StraySamples {
        /// Number of such samples.
        samples: usize,
        /// Index of the plane of the farthest one.
        plane: usize,
        /// Index of the figure on its plane, not among the edges.
        figure: usize,
        /// Index of the outline's side, in the order of its samples.
        side: usize,
        /// Index of the sample on its side.
        sample: usize,
        /// Its distance from the side's line, px.
        distance: f64,
    },
    /// One plane does not fit the camera that the others show.
    #[error(
        "plane {plane} was rejected: it disagrees with all others by {distance:.2} px. Is it flat, \
         and exactly square (or of the stated shape)?"
    )]
    PlaneRejected {
        /// Index of the plane.
        plane: usize,
        /// Root mean square distance of its samples, px.
        distance: f64,
        /// Whether it is certainly not a target: no board, and far from the shape of a target.
        #[cfg_attr(feature = "serde", serde(default))]
        is_other: bool,
    },
    /// The planes cannot all be true squares seen by one camera.
    #[error("{}", contradiction(*.factor, *.displacement, *.planes, *.known_to, .held))]
    PlanesContradict {
        /// Distance of the sides from where one camera would show them, relative to that expected.
        factor: f64,
        /// Root mean square distance of the sides from there, px.
        #[cfg_attr(feature = "serde", serde(default))]
        displacement: f64,
        /// Number of planes.
        #[cfg_attr(feature = "serde", serde(default = "several"))]
        planes: usize,
        /// The largest standard deviation of a focal length, as a fraction of it, or of the
        /// principal point, as a fraction of the width, with all of this included; `None` if none
        /// of them is free.
        #[cfg_attr(feature = "serde", serde(default))]
        known_to: Option<f64>,
        /// Held parts of the camera: `"principal point"`, `"focal length"`, `"aspect"`,
        /// `"distortion"`.
        #[cfg_attr(feature = "serde", serde(default))]
        held: Vec<Text>,
    },
    /// The squares are not square, or the lens departs from its model: sides do not lie where one
    /// camera would show those of true squares.
    #[error(
        "the targets are not flat, or not exactly square (or of the stated shape), or the lens \
         model does not fit the lens{}: their sides lie {displacement:.1} px from where one camera \
         would show them{}",
        held_phrase(.held), std_increase(.parameter, *.factor)
    )]
    NoSquares {
        /// Distance of the sides from there, px.
        displacement: f64,
        /// The parameter whose standard deviation is raised most.
        parameter: Text,
        /// Its standard deviation relative to that with true squares.
        factor: f64,
        /// Held parts of the camera, as in [`Warning::PlanesContradict`].
        #[cfg_attr(feature = "serde", serde(default))]
        held: Vec<Text>,
    },
    /// Groups of planes give results that differ more than expected from their samples.
    #[error(
        "{} disagree {factor:.1} times more than the noise of their edges explains; all standard \
         deviations were raised by that factor. {}",
        groups(*.one_picture), causes_of_variation(*.one_picture)
    )]
    PlanesVary {
        /// Their scatter relative to that expected.
        factor: f64,
        /// Whether all planes are in one picture.
        #[cfg_attr(feature = "serde", serde(default))]
        one_picture: bool,
        /// Largest standard deviation of the camera, as in [`Warning::PlanesContradict`].
        #[cfg_attr(feature = "serde", serde(default))]
        known_to: Option<f64>,
    },
    /// The samples of a side have a common error, beyond their noise.
    #[error(
        "the samples of a side have a common error, of {displacement:.3} px on plane {plane} ({}): \
         the standard deviation of {parameter} is {} as large because of this",
        cause_of_errors(*.height), times(*.factor)
    )]
    SidesErrTogether {
        /// The plane that shows it most clearly.
        plane: usize,
        /// Root mean square error of a side there, px.
        displacement: f64,
        /// Height difference between the lowest and the highest place of its sheet, over its
        /// extent, if it is bent.
        height: Option<f64>,
        /// The parameter whose standard deviation is raised most.
        parameter: Text,
        /// Its standard deviation relative to that under independent noise alone.
        factor: f64,
        /// Largest standard deviation of the camera, as in [`Warning::PlanesContradict`].
        #[cfg_attr(feature = "serde", serde(default))]
        known_to: Option<f64>,
    },
    /// Flat targets do not have the stated ratio of width to height; the camera is estimated with
    /// the ratio of each.
    #[error(
        "plane {plane} is stretched: the ratio of its width to its height is {:.2} % {} than \
         stated{}. The camera is estimated with that; was the target printed to the same scale in \
         both directions?",
        100.0 * .stretch.abs(), if *.stretch > 0.0 { "larger" } else { "smaller" },
        std_increase(.parameter, *.factor)
    )]
    PlaneStretched {
        /// The plane that is stretched most.
        plane: usize,
        /// Its ratio of width to height, relative to the stated one, minus 1.
        stretch: f64,
        /// The parameter whose standard deviation is raised most.
        parameter: Text,
        /// Its standard deviation relative to that under independent noise alone.
        factor: f64,
        /// Largest standard deviation of the camera, as in [`Warning::PlanesContradict`].
        #[cfg_attr(feature = "serde", serde(default))]
        known_to: Option<f64>,
    },
    /// The lens departs from its model.
    #[error(
        "the lens model {} fit the lens{}: all planes have the same residuals at the same place in \
         the picture{}.{}",
        if *.certain && .cure.is_some() { "does not" } else { "may not" },
        held_phrase(.held),
        std_increase(.parameter, *.factor),
        richer_focal(.cure.as_ref(), .held)
    )]
    LensBeyondModel {
        /// Whether nothing else explains the residuals as well.
        certain: bool,
        /// The parameter whose standard deviation is raised most.
        parameter: Text,
        /// Its standard deviation relative to that with a lens of its model.
        factor: f64,
        /// The model that fits the lens, and `fx` with it, pixels; `None` if none does.
        cure: Option<(String, f64)>,
        /// Held parts of the camera, as in [`Warning::PlanesContradict`], which may be what is
        /// wrong; `cure` has the distortion free.
        #[cfg_attr(feature = "serde", serde(default))]
        held: Vec<Text>,
    },
    /// A lens of another family fits where the requested one does not.
    #[error(
        "the lens is a fisheye: a fisheye model fits the edges to {rms:.2} px, the requested model \
         to {own:.2} px. {}",
        Alternative { setting: Setting::Model(.model), focal: *.focal }
    )]
    LensOfAnotherFamily {
        /// The model that fits the lens.
        model: String,
        /// Root mean square distance of the edge samples with it, px.
        rms: f64,
        /// The same with the requested model.
        own: f64,
        /// `fx` with it, pixels.
        focal: f64,
    },
    /// The pixels did not follow the model closely enough to be used.
    #[error("the fit to the pixels was not used: {reason}")]
    PixelsNotUsed {
        /// The reason.
        reason: Text,
    },
    /// The lines of the scene give no information, or indicate another lens than the planes.
    #[error(
        "the lines of the scene were not used: {}",
        lines_not_used(*.sigmas)
    )]
    LinesNotUsed {
        /// Number of standard deviations by which the lens would change; `None` where hardly any of
        /// the lines is the image of a straight line, or nothing is free.
        sigmas: Option<f64>,
    },
    /// The estimated pixels of the camera are not square.
    #[error(
        "fy / fx is {}, but nearly every camera's pixels are square: are the targets rectangles, or \
         was the picture stretched?{}",
        with_its_std(*.ratio, *.std),
        held_focal(Setting::AspectHeld, *.held, "which is wrong if the picture was stretched")
    )]
    PixelsNotSquare {
        /// `fy / fx`.
        ratio: f64,
        /// Its standard deviation.
        std: f64,
        /// `fx` with the aspect ratio held, pixels; `None` if that calibration has no result.
        held: Option<f64>,
    },
    /// With a skew, which is held at zero, all planes agree better.
    #[error(
        "the skew, K[0, 1], is fixed at 0, but with a skew of {} px all planes agree better, and \
         fx is {focal:.1} px: was the picture sheared, as by a rolling shutter or a scanner? If \
         so, free the skew; if not, check that every target is exactly square",
        with_its_std(*.skew, *.std)
    )]
    Sheared {
        /// The skew, pixels.
        skew: f64,
        /// Its standard deviation.
        std: f64,
        /// `fx` with that skew, pixels.
        focal: f64,
    },
    /// The estimated principal point is far from the centre of the picture.
    #[error(
        "the principal point is {} px from the centre of the picture, farther than in nearly every \
         camera: was the picture cropped, or are the targets not square?{}",
        with_its_std(*.distance, *.std),
        held_focal(Setting::PrincipalPointHeld, *.held, "which is wrong if the picture was cropped")
    )]
    PrincipalPointOffCentre {
        /// Distance of the principal point from the centre of the picture, pixels.
        distance: f64,
        /// Its standard deviation.
        std: f64,
        /// `fx` with the principal point held, pixels; `None` if that calibration has no result.
        held: Option<f64>,
    },
    /// The planes do not determine the principal point, which is held at the picture's centre.
    #[error(
        "the standard deviation of fx, {} px, assumes that the principal point is at the picture's \
         centre. In real cameras it is about {scatter:.0} px away (1.2 % of the width), which adds \
         {added:.1} px to the uncertainty of fx; these planes cannot measure it. Fix it at a known \
         value, or show three planes tilted in different directions",
        two_digits(*.std)
    )]
    PrincipalPointAssumed {
        /// Standard deviation of principal points about the centre, of each coordinate, pixels.
        scatter: f64,
        /// Standard deviation of `fx` because of that, pixels.
        added: f64,
        /// The stated standard deviation of `fx`, pixels.
        std: f64,
    },
    /// The planes just suffice for the camera, so that their shapes cannot be checked.
    #[error(
        "the targets cannot be checked{}: {} no more equations than this camera has unknowns{}. If \
         {}, fx is wrong by {} px; its standard deviation, {} px, does not include this error. \
         Show one more target, tilted in another direction",
        rejection_phrase(*.rejected), planes_in_directions(*.planes, *.directions), rough_phrase(*.rough),
        deformation(*.stretch, *.are_angles), two_digits(*.change), two_digits(*.std)
    )]
    TargetsUnchecked {
        /// Number of planes that determine the camera.
        planes: usize,
        /// Number of further planes that are too small or too rough to check them.
        #[cfg_attr(feature = "serde", serde(default))]
        rough: usize,
        /// Number of further planes that were rejected; it cannot be told whether these were the
        /// false ones.
        #[cfg_attr(feature = "serde", serde(default))]
        rejected: usize,
        /// Number of directions in which the planes and their sides stand; 0 if it was not stored.
        #[cfg_attr(feature = "serde", serde(default))]
        directions: usize,
        /// Relative stretch that each square may have, or error of its right angles, radians.
        stretch: f64,
        /// Whether only the right angles of the planes are known.
        #[cfg_attr(feature = "serde", serde(default))]
        are_angles: bool,
        /// Change of `fx` because of that, with either sign in each direction, pixels (rms).
        change: f64,
        /// The stated standard deviation of `fx`, pixels.
        std: f64,
    },
    /// Errors beyond noise, as shown by the residuals, leave a parameter as uncertain as a geometry
    /// that is refused.
    #[error(
        "the standard deviation of {parameter} is {std:.0} px ({:.0} % of {of}): {}",
        100.0 * .part,
        open_parameter_advice(*.by_tone)
    )]
    BarelyDetermined {
        /// The parameter that is known worst.
        parameter: Text,
        /// Its standard deviation, pixels.
        std: f64,
        /// The same as a fraction of `of`.
        part: f64,
        /// The unit of `part`: the focal length or the width.
        of: Text,
        /// Whether it would be known if an unknown tone curve did not shift the edges.
        #[cfg_attr(feature = "serde", serde(default))]
        by_tone: bool,
    },
    /// Samples that the picture cannot show.
    #[error(
        "{} of figure {figure} {} outside the picture of {} x {} pixels, the first at ({:.1}, \
         {:.1}): is that the picture's size, width before height?",
        counted(*samples, "sample"), if *.samples == 1 { "is" } else { "are" },
        .size[0], .size[1], .first[0], .first[1]
    )]
    OutsidePicture {
        /// Index among the edges of the first figure that has such samples.
        figure: usize,
        /// Number of its samples that lie outside.
        samples: usize,
        /// The first of them, pixels.
        first: [f64; 2],
        /// Width and height of the picture.
        size: [u32; 2],
    },
    /// The distortion cannot be inverted in a part of the picture.
    #[error(
        "the distortion cannot be inverted in {} of the picture: no target was there, and its polynomial \
         turns back. Show targets nearer to the corners, or choose a lens model with fewer coefficients",
        part_of_whole(*.missing)
    )]
    LensEndsInPicture {
        /// Fraction of the picture in which the distortion cannot be inverted.
        missing: f64,
    },
    /// The lens is extrapolated in a part of the picture.
    #[error(
        "projections are not known to within {limit:.0} px in {} of the picture. No target was \
         there: their standard deviation reaches {worst:.0} px, and their error may be larger \
         where the lens departs from its model. Show targets nearer to the corners, or choose a \
         lens model with fewer coefficients",
        part_of_whole(*.unknown)
    )]
    LensExtrapolated {
        /// Fraction of the picture where projections are not known to `limit`.
        unknown: f64,
        /// Standard deviation up to which projections count as known, pixels.
        limit: f64,
        /// The largest standard deviation over the picture, pixels.
        worst: f64,
    },
    /// Planes contradict their stated relation.
    #[error(
        "planes {} and {} are {} degrees from {stand} if calibrated without this relation: remove \
         it, or correct the plane numbers",
        .planes[0], .planes[1], with_its_std(*.degrees, *.std)
    )]
    RelationContradicted {
        /// Indices of the planes.
        planes: [usize; 2],
        /// The stated relation, in words.
        stand: Text,
        /// Angle by which they depart from it, degrees.
        degrees: f64,
        /// Its standard deviation.
        std: f64,
    },
    /// The pixels contradict the tone curve that was stated.
    #[error(
        "the pixels contradict the tone curve that was stated or assumed: they show a gamma of {}, \
         with which {parameter} changes by {}; its standard deviation was raised by the same amount",
        with_its_std(*.gamma, *.std), signed_two_digits(*.change)
    )]
    ToneContradicted {
        /// Index of the picture whose pixels contradict its curve the most.
        picture: usize,
        /// The pure gamma that codes mid-grey as the pixels of that picture do.
        gamma: f64,
        /// Its standard deviation.
        std: f64,
        /// The first free parameter, in most cases `fx`.
        parameter: Text,
        /// Its change, to first order, where the curve is estimated.
        change: f64,
    },
    /// Something covers a part of one side, which is not used there.
    #[error(
        "plane {plane}: {:.0} % of side {side}{} is left out: it shows no plain edge there (a \
         finger, glare, a stain, a pattern, a torn edge?)",
        100.0 * .part, figure_phrase(*.figure)
    )]
    PartlyHidden {
        /// Index of the plane.
        plane: usize,
        /// Index of the figure on its plane, not among the edges.
        figure: usize,
        /// Index of the outline's side, in the order of its samples.
        side: usize,
        /// Fraction of the side's length that is left out.
        part: f64,
    },
}

/// Factor on a standard deviation above which the user should check the cause. Below it, common
/// errors of sides need no action: the diagnosis reports them.
pub(crate) const NOTABLE_FACTOR: f64 = 2.0;

/// Standard deviation of focal lengths and principal point, as a fraction of the focal length or
/// the width, below which a warning whose cause the standard deviations include is one step less
/// severe: an error of four such standard deviations is no larger than that from three squares
/// printed 0.3 % too long in one direction.
const HARMLESS: f64 = 0.001;

/// Number of planes for a stored warning that does not contain it.
#[cfg(feature = "serde")]
fn several() -> usize {
    2
}

impl Warning {
    /// Returns a name that programs may rely on, the same as in Python. Each has its section in
    /// `docs/faq.md` of the repository: its meaning, its causes, and what to do.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Disagreement(_) => "plane_disagrees",
            Self::SideRejected { .. } => "side_rejected",
            Self::StraySamples { .. } => "stray_samples",
            Self::PlaneRejected { .. } => "plane_rejected",
            Self::PlanesContradict { .. } | Self::NoSquares { .. } => "planes_contradict",
            Self::PlanesVary { .. } => "planes_vary",
            Self::SidesErrTogether { .. } => "correlated_residuals",
            Self::PlaneStretched { .. } => "plane_stretched",
            Self::LensBeyondModel { .. } | Self::LensOfAnotherFamily { .. } => "lens_beyond_model",
            Self::PixelsNotUsed { .. } => "pixels_not_used",
            Self::LinesNotUsed { .. } => "lines_not_used",
            Self::PixelsNotSquare { .. } | Self::Sheared { .. } => "pixels_not_square",
            Self::PrincipalPointOffCentre { .. } => "principal_point_off_centre",
            Self::PrincipalPointAssumed { .. } => "principal_point_assumed",
            Self::TargetsUnchecked { .. } => "targets_unchecked",
            Self::BarelyDetermined { .. } => "barely_determined",
            Self::LensEndsInPicture { .. } => "lens_ends_in_picture",
            Self::LensExtrapolated { .. } => "lens_extrapolated",
            Self::OutsidePicture { .. } => "samples_outside_picture",
            Self::RelationContradicted { .. } => "relation_contradicted",
            Self::PartlyHidden { .. } => "side_partly_hidden",
            Self::ToneContradicted { .. } => "tone_contradicted",
        }
    }

    /// Whether the lens is beyond its model, or of another family: they share a code.
    pub(crate) fn is_lens_beyond_model(&self) -> bool {
        matches!(
            self,
            Self::LensBeyondModel { .. } | Self::LensOfAnotherFamily { .. }
        )
    }

    /// Returns the setting that was tried, if one was; the message contains it.
    #[must_use]
    pub fn alternative(&self) -> Option<Alternative<'_>> {
        let (setting, focal) = match self {
            Self::LensBeyondModel {
                cure: Some((model, focal)),
                held,
                ..
            } => (cure_setting(model, held), Some(*focal)),
            Self::LensOfAnotherFamily { model, focal, .. } => (Setting::Model(model), Some(*focal)),
            Self::PixelsNotSquare { held, .. } => (Setting::AspectHeld, *held),
            Self::PrincipalPointOffCentre { held, .. } => (Setting::PrincipalPointHeld, *held),
            _ => return None,
        };
        focal.map(|focal| Alternative { setting, focal })
    }

    /// Returns the severity.
    #[must_use]
    pub fn severity(&self) -> Severity {
        match self {
            Self::PlanesContradict { known_to, .. } if is_harmless(*known_to) => Severity::Medium,
            Self::LensBeyondModel { .. }
            | Self::LensOfAnotherFamily { .. }
            | Self::PlanesContradict { .. }
            | Self::NoSquares { .. }
            | Self::RelationContradicted { .. }
            | Self::BarelyDetermined { .. }
            | Self::PrincipalPointAssumed { .. }
            | Self::OutsidePicture { .. }
            | Self::ToneContradicted { .. }
            | Self::TargetsUnchecked { rejected: 1.., .. }
            | Self::Sheared { .. }
            | Self::PixelsNotSquare { .. } => Severity::High,
            Self::Disagreement(_)
            | Self::SideRejected { .. }
            | Self::PlaneRejected {
                is_other: false, ..
            }
            | Self::PrincipalPointOffCentre { .. }
            | Self::TargetsUnchecked { .. }
            | Self::LensEndsInPicture { .. }
            | Self::LensExtrapolated { .. }
            | Self::LinesNotUsed { sigmas: Some(_) } => Severity::Medium,
            Self::PlanesVary {
                factor, known_to, ..
            }
            | Self::SidesErrTogether {
                factor, known_to, ..
            }
            | Self::PlaneStretched {
                factor, known_to, ..
            } if *factor > NOTABLE_FACTOR && !is_harmless(*known_to) => Severity::Medium,
            Self::PlanesVary { .. }
            | Self::SidesErrTogether { .. }
            | Self::PlaneStretched { .. }
            | Self::PlaneRejected { is_other: true, .. }
            | Self::StraySamples { .. }
            | Self::PixelsNotUsed { .. }
            | Self::LinesNotUsed { sigmas: None }
            | Self::PartlyHidden { .. } => Severity::Low,
        }
    }

    /// Returns the same warning with the largest standard deviation of the camera, as a fraction of
    /// the focal length or of the width, if its severity depends on that.
    pub(crate) fn with_camera_known_to(mut self, part: Option<f64>) -> Self {
        if let Self::PlanesContradict { known_to, .. }
        | Self::PlanesVary { known_to, .. }
        | Self::SidesErrTogether { known_to, .. }
        | Self::PlaneStretched { known_to, .. } = &mut self
        {
            *known_to = part;
        }
        self
    }

    /// Returns the picture that the warning is about, if it is about one.
    #[must_use]
    pub fn picture(&self) -> Option<usize> {
        match self {
            Self::ToneContradicted { picture, .. } => Some(*picture),
            _ => None,
        }
    }

    /// Returns the plane that the warning is about, if it is about one.
    #[must_use]
    pub fn plane(&self) -> Option<usize> {
        match self {
            Self::Disagreement(found) => Some(found.plane),
            Self::SideRejected { plane, .. }
            | Self::StraySamples { plane, .. }
            | Self::PlaneRejected { plane, .. }
            | Self::SidesErrTogether { plane, .. }
            | Self::PlaneStretched { plane, .. }
            | Self::PartlyHidden { plane, .. } => Some(*plane),
            _ => None,
        }
    }
}

/// Whether errors within the standard deviations of a camera that is known to `part` are small.
fn is_harmless(part: Option<f64>) -> bool {
    part.is_some_and(|part| part < HARMLESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::DISTORTION;

    #[test]
    fn one_plane_contradicts_what_is_held() {
        let held = vec!["principal point".into(), "aspect".into()];
        let (factor, planes) = (12.34, 1);
        let warning = Warning::PlanesContradict {
            factor,
            displacement: 0.0123,
            planes,
            known_to: None,
            held,
        };
        assert_eq!(
            warning.to_string(),
            "the plane contradicts the camera: its sides lie 0.012 px from where the camera would show \
             them, 12.3 times as far as their noise explains; it may not be flat, or not exactly \
             square (or of the stated shape), or a fixed value (principal point, aspect) is wrong"
        );
        let (planes, held) = (3, Vec::new());
        let warning = Warning::PlanesContradict {
            factor,
            displacement: 0.0,
            planes,
            known_to: None,
            held,
        };
        let text = warning.to_string();
        assert!(
            text.starts_with(
                "the planes contradict each other: their sides lie 12.3 times as far from where one \
                 camera would show them as their noise explains; one of them may"
            ),
            "{text}"
        );
        assert!(
            text.ends_with("may not be flat, or not exactly square (or of the stated shape)"),
            "{text}"
        );
        let warning = Warning::NoSquares {
            displacement: 0.14,
            parameter: "fx".into(),
            factor: 1.0,
            held: vec!["aspect".into()],
        };
        assert_eq!(
            warning.to_string(),
            "the targets are not flat, or not exactly square (or of the stated shape), or the lens \
             model does not fit the lens, or a fixed value (aspect) is wrong: their sides lie 0.1 \
             px from where one camera would show them"
        );
    }

    #[test]
    fn a_contradiction_is_as_severe_as_what_it_leaves_of_the_camera() {
        let found = Warning::PlanesContradict {
            factor: 3.1,
            displacement: 0.0022,
            planes: 3,
            known_to: None,
            held: Vec::new(),
        };
        for (part, severity) in [
            (None, Severity::High),
            (Some(0.0011), Severity::High),
            (Some(0.0004), Severity::Medium),
        ] {
            let warning = found.clone().with_camera_known_to(part);
            assert_eq!(warning.severity(), severity);
        }
        assert_eq!(
            found.with_camera_known_to(Some(0.00042)).to_string(),
            "the planes contradict each other: their sides lie 0.0022 px from where one camera would show \
             them, 3.1 times as far as their noise explains (focal lengths and principal point are \
             still known to 0.042 % of the focal length, or of the width); one of them may not be \
             flat, or not exactly square (or of the stated shape)"
        );
    }

    #[test]
    fn what_raises_deviations_a_lot_is_to_be_looked_at() {
        let together = |factor| Warning::SidesErrTogether {
            plane: 0,
            displacement: 0.1,
            height: None,
            parameter: "fx".into(),
            factor,
            known_to: None,
        };
        for (factor, part, expected) in [
            (1.5, None, Severity::Low),
            (2.5, None, Severity::Medium),
            (2.5, Some(0.0011), Severity::Medium),
            (2.5, Some(0.0009), Severity::Low),
        ] {
            let together = together(factor).with_camera_known_to(part);
            assert_eq!(together.severity(), expected);
            for (one_picture, words) in [(true, "the planes disagree"), (false, "focus or zoom")] {
                let vary = Warning::PlanesVary {
                    factor,
                    one_picture,
                    known_to: None,
                };
                let vary = vary.with_camera_known_to(part);
                assert_eq!(vary.severity(), expected);
                assert!(vary.to_string().contains(words), "{vary}");
            }
        }
    }

    #[test]
    fn a_standard_deviation_has_two_digits_and_its_value_as_many_decimals() {
        for (value, std, expected) in [
            (78.26, 0.4321, "78.26 +- 0.43"),
            (1.012_345, 0.000_031, "1.012345 +- 0.000031"),
            (812.3, 54.6, "812 +- 55"),
            (5.0, 0.0, "5.000000 +- 0.000000"),
        ] {
            assert_eq!(with_its_std(value, std), expected);
        }
        let (distance, std, held) = (78.26, 0.4321, None);
        let text = Warning::PrincipalPointOffCentre {
            distance,
            std,
            held,
        }
        .to_string();
        assert!(
            text.contains("is 78.26 +- 0.43 px from the centre"),
            "{text}"
        );
    }

    #[test]
    fn what_leaves_a_parameter_open_is_named() {
        let open = |by_tone| Warning::BarelyDetermined {
            parameter: "fy".into(),
            std: 43.0,
            part: 0.043,
            of: "the focal length".into(),
            by_tone,
        };
        let text = open(true).to_string();
        assert!(text.contains("43 px (4 % of the focal length): the tone curve is not known"));
        assert!(open(false).to_string().contains("flatter ones"));
    }

    #[test]
    fn a_message_has_the_setting_that_was_tried() {
        let held = Some(901.25);
        let cure = Some(("radial3".to_owned(), 901.25));
        let (ratio, distance, std) = (1.01, 60.0, 0.001);
        let (certain, parameter, factor) = (true, "fx", 2.0);
        for (warning, expected) in [
            (
                Warning::PixelsNotSquare { ratio, std, held },
                "With the aspect fixed, fx is 901.2",
            ),
            (
                Warning::PrincipalPointOffCentre {
                    distance,
                    std,
                    held,
                },
                "With the principal point fixed, fx is 901.2",
            ),
            (
                Warning::LensBeyondModel {
                    certain,
                    parameter: parameter.into(),
                    factor,
                    cure: cure.clone(),
                    held: Vec::new(),
                },
                "With the lens model radial3, fx is 901.2",
            ),
            (
                Warning::LensBeyondModel {
                    certain,
                    parameter: parameter.into(),
                    factor,
                    cure,
                    held: vec![DISTORTION.into()],
                },
                "With the distortion free (lens model radial3), fx is 901.2",
            ),
            (
                Warning::LensOfAnotherFamily {
                    model: "fisheye".into(),
                    rms: 0.1,
                    own: 2.0,
                    focal: 901.25,
                },
                "With the lens model fisheye, fx is 901.2",
            ),
        ] {
            assert_eq!(warning.alternative().unwrap().to_string(), expected);
            assert!(warning.to_string().contains(expected), "{warning}");
        }
        let text = Warning::PixelsNotSquare { ratio, std, held }.to_string();
        assert!(
            text.ends_with(" fx is 901.2, which is wrong if the picture was stretched"),
            "{text}"
        );
        let untried = Warning::PixelsNotSquare {
            ratio,
            std,
            held: None,
        };
        assert_eq!(untried.alternative(), None);
    }
}
