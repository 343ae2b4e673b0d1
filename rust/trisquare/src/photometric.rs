//! stub
use crate::observations::ObservedPlane;
use crate::parameters::FreeParameters;
use crate::refine::Refined;
use crate::result::Calibration;
use crate::{Brown, Picture, PlaneEdges, Tone};
/// The pictures that show the figures, by their index, and how they were coded.
#[derive(Debug, Clone, Copy)]
pub struct Photographs<'a> {
    /// One picture per image index.
    pub pictures: &'a [&'a Picture],
    /// The tone curve of all of them.
    pub tone: Tone,
}
pub(crate) fn improve(
    _: &[PlaneEdges],
    _: &[ObservedPlane],
    _: &FreeParameters,
    _: &Refined<Brown>,
    _: &Photographs<'_>,
    _: &mut Calibration,
) {
}
