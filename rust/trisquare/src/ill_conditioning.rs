//! Reasons why a geometry does not determine the camera, and remedies.

use std::fmt;

/// Largest standard deviation that is stated as a number: a prediction above it comes from an
/// estimate that is as uncertain, and is stated only as larger.
const LARGEST_STATED_STD: f64 = 10.0;

/// Reason why the planes do not determine the camera matrix.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct IllConditioning {
    /// Deficiency of the planes.
    pub cause: Cause,
    /// Name of the least certain parameter.
    pub parameter: &'static str,
    /// Its predicted standard deviation: of a focal length as a fraction of it, of the principal
    /// point as a fraction of the picture's width (infinite if it is not observable).
    pub std: f64,
    /// The largest standard deviation accepted, in the same unit.
    pub limit: f64,
    /// Remedies; each has been verified.
    pub remedies: Vec<Remedy>,
}

/// Deficiency of a set of planes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Cause {
    /// All planes share one direction.
    Parallel {
        /// Number of planes.
        planes: usize,
        /// The largest angle between two of them, in degrees.
        degrees: f64,
    },
    /// No two planes differ much in direction.
    Alike {
        /// The two that differ most.
        planes: (usize, usize),
        /// The angle between them, in degrees.
        degrees: f64,
    },
    /// All planes face the camera.
    Facing {
        /// Number of planes.
        planes: usize,
        /// The largest angle between one of them and the image plane, in degrees.
        degrees: f64,
    },
    /// The figures are small in the picture.
    Small {
        /// The larger dimension of the largest one, in pixels.
        pixels: f64,
    },
    /// The figures cover only a small part of the picture.
    Huddled {
        /// Fraction of the picture's width that they span.
        width: f64,
        /// Fraction of its height.
        height: f64,
    },
    /// Too many parameters are free for the directions of the planes.
    Open {
        /// Number of planes.
        planes: usize,
        /// The largest angle between two of them, in degrees.
        degrees: f64,
    },
}

/// A change that would make a calibration succeed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Remedy {
    /// Free the focal lengths: the planes determine the camera without their fixed values.
    FreeFocal {
        /// The fixed values.
        held: (f64, f64),
    },
    /// Free the principal point: the planes determine the camera without its fixed value.
    FreePrincipalPoint {
        /// The fixed value.
        held: (f64, f64),
    },
    /// Fix the skew.
    HoldSkew,
    /// Fix the ratio of the focal lengths.
    FixAspect,
    /// Fix the principal point.
    FixPrincipalPoint,
    /// Fix both.
    FixAspectAndPrincipalPoint,
    /// Tilt every square, each in a different direction.
    Tilt {
        /// The tilt against the image plane, in degrees.
        degrees: f64,
    },
    /// Show the squares larger, in the same orientation.
    Enlarge {
        /// Factor of enlargement.
        factor: f64,
    },
    /// Tilt and enlarge the squares.
    TiltAndEnlarge {
        /// The tilt against the image plane, in degrees.
        degrees: f64,
        /// Factor of enlargement.
        factor: f64,
    },
}

impl Remedy {
    /// Whether the remedy needs a known principal point.
    pub(crate) fn is_of_principal_point(&self) -> bool {
        matches!(
            self,
            Self::FixPrincipalPoint | Self::FixAspectAndPrincipalPoint
        )
    }
}

impl fmt::Display for IllConditioning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parameter = self.parameter;
        write!(f, "{}: {parameter} is not determined ", self.cause)?;
        let whole = match parameter {
            "cx" | "cy" => "the picture's width",
            focal => focal,
        };
        if self.std <= LARGEST_STATED_STD {
            let std = percent(self.std);
            write!(f, "(predicted standard deviation {std} % of {whole}, ")?;
        } else {
            let std = percent(LARGEST_STATED_STD);
            write!(
                f,
                "(predicted standard deviation more than {std} % of {whole}, "
            )?;
        }
        write!(f, "at most {} % is accepted)", percent(self.limit))?;
        let mut joint = "; ";
        for remedy in &self.remedies {
            write!(f, "{joint}{remedy}")?;
            joint = ", or ";
        }
        if self.remedies.is_empty() {
            let advice = "show larger squares, each tilted 25 to 50 degrees in its own direction";
            write!(f, "; {advice}")?;
        }
        Ok(())
    }
}

/// Formats a fraction in per cent with two significant digits, or all before the decimal point.
fn percent(part: f64) -> String {
    let percent = 100.0 * part;
    let decimals = usize::from(percent < 9.95);
    format!("{percent:.decimals$}")
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parallel { planes, degrees } => {
                write!(
                    f,
                    "all {planes} planes are parallel within {degrees:.1} degrees"
                )
            }
            Self::Alike {
                planes: (a, b),
                degrees,
            } => write!(
                f,
                "the planes are nearly parallel: {a} and {b} differ most, by {degrees:.1} degrees"
            ),
            Self::Facing { planes: 1, degrees } => {
                write!(
                    f,
                    "the plane faces the camera (tilted by {degrees:.1} degrees)"
                )
            }
            Self::Facing { planes, degrees } => write!(
                f,
                "all {planes} planes face the camera (none is tilted by more than {degrees:.1} \
                 degrees)"
            ),
            Self::Small { pixels } => {
                write!(
                    f,
                    "the targets are small (the largest spans {pixels:.0} pixels)"
                )
            }
            Self::Huddled { width, height } => write!(
                f,
                "the targets cover only {:.0} % of the picture's width and {:.0} % of its height",
                100.0 * width,
                100.0 * height
            ),
            Self::Open { planes: 1, .. } => write!(f, "one plane determines too few parameters"),
            Self::Open { planes: 2, degrees } => write!(
                f,
                "the 2 planes, {degrees:.1} degrees apart, determine too few parameters"
            ),
            Self::Open { planes, degrees } => write!(
                f,
                "the {planes} planes, at most {degrees:.1} degrees apart, determine too few parameters"
            ),
        }
    }
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FreeFocal { held: (fx, fy) } => write!(
                f,
                "free the focal lengths: the planes contradict the fixed fx = {fx}, fy = {fy}"
            ),
            Self::FreePrincipalPoint { held: (cx, cy) } => write!(
                f,
                "free the principal point: the planes contradict the fixed cx = {cx}, cy = {cy}"
            ),
            Self::HoldSkew => write!(f, "fix the skew at 0"),
            Self::FixAspect => write!(f, "fix the aspect"),
            Self::FixPrincipalPoint => write!(f, "fix the principal point at a known value"),
            Self::FixAspectAndPrincipalPoint => {
                write!(f, "fix the aspect and the principal point at known values")
            }
            Self::Tilt { degrees } => write!(
                f,
                "tilt the targets by at least {degrees:.0} degrees, each in its own direction"
            ),
            Self::Enlarge { factor } => {
                write!(f, "show the targets at least {factor} times larger")
            }
            Self::TiltAndEnlarge { degrees, factor } => write!(
                f,
                "show the targets at least {factor} times larger and tilt them by at least \
                 {degrees:.0} degrees, each in its own direction"
            ),
        }
    }
}
