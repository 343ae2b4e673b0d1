//! stub
use crate::observations::ObservedPlane;
use crate::parameters::FreeParameters;
use crate::refine::Refined;
use crate::result::Calibration;
use crate::{Brown, PlaneEdges};
/// stub
pub struct Photographs<'a>(std::marker::PhantomData<&'a ()>);
pub(crate) fn improve(
    _: &[PlaneEdges],
    _: &[ObservedPlane],
    _: &FreeParameters,
    _: &Refined<Brown>,
    _: &Photographs<'_>,
    _: &mut Calibration,
) {
}
