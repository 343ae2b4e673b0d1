//! The band in which a preview of a span seeks its edge, before its neighbours are known.

use super::band::Band;
use super::coarse::CoarseEdge;
use super::curve::ChordCurve;
use super::far_edge::FarEdge;
use super::grid_crossings::GridCrossings;
use super::preview::Preview;
use super::side::SideModel;
use super::sought::Sought;
use super::span::{EdgeSpan, NoEdge};
use super::surroundings::{far_edge_limit, inner_end};
use crate::image::Tone;

/// Approximate number of columns of pixels in a preview, which only finds curve and blur. The
/// stride is odd, so that for a steep side both even and odd rows are used.
const PREVIEW_COLUMNS: f64 = 50.0;

/// Data that all bands of one span's preview share.
pub(super) struct PreviewBand<'a> {
    spans: &'a [EdgeSpan],
    index: usize,
    hidden: &'a [[f64; 2]],
    /// The curve and the contrast of the far edge of a thin bar.
    far_side: Option<(&'a ChordCurve, f64)>,
    /// End of the band along the chord, pixels from its middle.
    end: f64,
    stride: usize,
}

impl<'a> PreviewBand<'a> {
    /// The band around the first guess of a side. The far edge of a thin bar is taken from the
    /// previews, if there are any, and else from the coarse edges.
    pub fn around(
        side: &SideModel,
        sought: &'a Sought<'_>,
        index: usize,
        previews: &'a [Result<Preview, NoEdge>],
        tone: Tone,
    ) -> Result<Self, NoEdge> {
        let span = &sought.spans[index];
        let coarse = sought.coarse[index].as_ref().map_err(|&reason| reason)?;
        let find_far_side = |other: usize| match (previews.get(other), &sought.coarse[other]) {
            (Some(Ok(Preview { side, .. })), _) => Ok((&side.curve, side.contrast[0])),
            (
                None,
                Ok(CoarseEdge {
                    curve, plateaus, ..
                }),
            ) => {
                let [before, after] = plateaus.map(|coded| tone.decode(coded));
                Ok((curve, after - before))
            }
            _ => Err(NoEdge::Cramped),
        };
        Ok(Self {
            spans: &sought.spans,
            index,
            hidden: &coarse.hidden,
            far_side: span.far_edge.map(find_far_side).transpose()?,
            end: match span.crossings.is_empty() {
                true => inner_end(side),
                false => side.curve.half_length,
            },
            stride: 2 * (0.5 * side.curve.length() / PREVIEW_COLUMNS) as usize + 1,
        })
    }

    /// The far edge of a thin bar, for the current estimate of the side.
    pub fn far_edge(&self, side: &SideModel) -> Option<FarEdge<'a>> {
        let near_side = (&side.curve, side.contrast[0]);
        let far_side = self.far_side?;
        Some(FarEdge::new(near_side, far_side, side.mean_blur()))
    }

    /// The lines that cross the side, for its current estimate.
    pub fn crossings(&self, side: &SideModel) -> Option<GridCrossings> {
        let is_crossed = !self.spans[self.index].crossings.is_empty();
        is_crossed
            .then(|| GridCrossings::coarse(self.spans, self.index, &side.curve, side.edge_shape()))
    }

    /// The band around the current estimate of the side.
    pub fn band<'b>(
        &'b self,
        side: &SideModel,
        near: f64,
        reach: [f64; 2],
        crossings: Option<&'b GridCrossings>,
    ) -> Band<'b> {
        let far_edge = self.far_edge(side);
        Band {
            curve: side.curve.clone(),
            near,
            reach,
            ends: [-self.end, self.end],
            limits: far_edge.iter().map(far_edge_limit).collect(),
            hidden: self.hidden,
            crossings,
            far_edge: far_edge.filter(|far_edge| far_edge.is_modelled),
            stride: self.stride,
        }
    }
}
