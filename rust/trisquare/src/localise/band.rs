//! The pixels in a band along a curve.

use nalgebra::Vector2;

use super::curve::ChordCurve;
use super::far_edge::FarEdge;
use super::flip::Flip;
use super::grid_crossings::GridCrossings;
use crate::image::{Grey, GreyReader};

/// Number of columns whose pixels far from the edge are averaged into one.
const FAR_COLUMNS: usize = 4;

/// A pixel, or the mean of several pixels far from the edge, in the frame of a side's chord.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    pub s: f64,
    pub y: f64,
    /// `s` of the point of the curve that is nearest to the pixel.
    pub foot: f64,
    /// Cosine of the angle between curve and chord, the ratio of distances to heights. Like the
    /// foot it is accurate enough for the curve along which the pixels were gathered.
    pub cosine: f64,
    /// Coded grey.
    pub value: f64,
    /// Number of pixels that this one is the mean of.
    pub count: f64,
    /// Change of the side's step here by the lines that cross the side, or by a far edge.
    pub flip: Flip,
    /// Whether the value is only a lower bound of the light.
    pub is_clipped: bool,
}

impl Pixel {
    /// A step from 0 to 1, as changed by the lines that cross it.
    #[inline]
    pub fn flipped(&self, step: f64) -> f64 {
        0.5 + self.flip.slope * (step - 0.5) + 0.5 * self.flip.shift
    }
}

/// A neighbouring side's curve: pixels nearer to it than `clearance`, or beyond it, are not used.
#[derive(Clone, Copy)]
pub(super) struct SearchLimit<'a> {
    pub curve: &'a ChordCurve,
    /// +1 if this side lies where the distance from that curve is positive, else -1.
    pub side: f64,
    pub clearance: f64,
}

impl SearchLimit<'_> {
    fn contains(&self, point: Vector2<f64>) -> bool {
        self.curve.is_beyond(point, self.side, self.clearance)
    }
}

/// The pixels to gather: those within `reach` of the curve, with `x` between the two ends.
///
/// Pixels farther than `near` show a plateau and no edge. They are averaged, which costs nothing
/// and reduces the uncertainty that unknown plateaus add to a side's position: with 4 pixels on
/// either side a line is 18 % less certain than its samples say, with 8 it is 6 %.
pub(super) struct Band<'a> {
    pub curve: ChordCurve,
    pub near: f64,
    /// Reach in pixels on the side of negative distances, and on the other.
    pub reach: [f64; 2],
    /// Range of `x` along the chord, pixels.
    pub ends: [f64; 2],
    pub limits: Vec<SearchLimit<'a>>,
    /// Ranges of `s` where another object hides the edge.
    pub hidden: &'a [[f64; 2]],
    /// Lines that cross this one, at each of which light and dark are exchanged.
    pub crossings: Option<&'a GridCrossings>,
    /// The far edge, for a thin bar, where the light changes back.
    pub far_edge: Option<FarEdge<'a>>,
    /// Use only one column in this many (or one row, for a steep side).
    pub stride: usize,
}

impl Band<'_> {
    /// Collects the band's pixels in order along the side.
    pub fn gather(&self, reader: &GreyReader<'_>, pixels: &mut Vec<Pixel>) {
        pixels.clear();
        let curve = &self.curve;
        // "Columns" are rows for a steep side: they are numbered along the axis on which it
        // advances faster.
        let u = usize::from(curve.along.x.abs() < curve.along.y.abs());
        let size = [reader.picture().width(), reader.picture().height()];
        let Some((first, last)) = self.columns(u, size[u]) else {
            return;
        };
        let (mut greys, mut flips) = (Vec::new(), Vec::new());
        let mut plateaus = [Plateau::default(); 2];
        let clear = self.uncut_columns(u, [first, last]);
        let s_per_column = 1.0 / (curve.along[u] * curve.half_length);
        let mut s = (first as f64 - curve.origin[u]) * s_per_column;
        for (index, number) in (first..=last).step_by(self.stride).enumerate() {
            if index % FAR_COLUMNS == 0 {
                pixels.extend(plateaus.iter_mut().filter_map(Plateau::take));
            }
            let column = ColumnCrossing::crossing(curve, u, number, s);
            s = column.s + self.stride as f64 * s_per_column;
            if self.is_hidden(column.s) {
                continue;
            }
            let Some((top, count)) = column.rows(self.reach, size[1 - u]) else {
                continue;
            };
            let start = if u == 0 { [number, top] } else { [top, number] };
            reader.read_line(start, u == 0, count, &mut greys);
            if !clear.contains(&number) {
                self.mask_outside(&column, top, &mut greys);
            }
            self.compute_flips(&column, top, &mut greys, &mut flips);
            self.add_column(&column, top, (&greys, &flips), &mut plateaus, pixels);
        }
        pixels.extend(plateaus.iter_mut().filter_map(Plateau::take));
    }

    fn is_hidden(&self, s: f64) -> bool {
        self.hidden.iter().any(|run| run[0] < s && s < run[1])
    }

    /// The columns that neither the neighbours nor the ends cut. They are contiguous, since every
    /// limit cuts the band at one end.
    fn uncut_columns(&self, u: usize, [first, last]: [usize; 2]) -> std::ops::Range<usize> {
        let curve = &self.curve;
        let ends = self.ends.map(|x| x / curve.half_length);
        let reach = self.reach[0].max(self.reach[1]);
        let is_clear = |number: &usize| {
            let s = (*number as f64 - curve.origin[u]) / (curve.along[u] * curve.half_length);
            let column = ColumnCrossing::crossing(curve, u, *number, s);
            let rows = reach * column.per_pixel;
            [column.centre - rows, column.centre + rows]
                .into_iter()
                .all(|row| {
                    let place = column.place(row);
                    let s = curve.local(place).0;
                    let contains = |limit: &SearchLimit<'_>| limit.contains(place);
                    ends[0] <= s && s <= ends[1] && self.limits.iter().all(contains)
                })
        };
        let Some(start) = (first..=last).find(is_clear) else {
            return 0..0;
        };
        let end = (start..=last).rev().find(is_clear);
        start..end.map_or(start, |end| end + 1)
    }

    /// The columns that the band meets inside the picture.
    fn columns(&self, u: usize, size: usize) -> Option<(usize, usize)> {
        let curve = &self.curve;
        let ends = self.ends.map(|x| curve.origin[u] + x * curve.along[u]);
        let overhang =
            (self.reach[0].max(self.reach[1]) + curve.height(0.0).abs()) * curve.across[u].abs();
        let first = (ends[0].min(ends[1]) - overhang).ceil().max(0.0);
        let last = (ends[0].max(ends[1]) + overhang)
            .floor()
            .min(size as f64 - 1.0);
        (first <= last).then_some((first as usize, last as usize))
    }

    /// Marks the pixels of a column outside the band as unreadable.
    fn mask_outside(&self, column: &ColumnCrossing, top: usize, greys: &mut [Grey]) {
        let ends = self.ends.map(|x| x / self.curve.half_length);
        for (row, grey) in (top..).zip(greys) {
            let place = column.place(row as f64);
            let s = self.curve.local(place).0;
            if s < ends[0] || s > ends[1] || !self.limits.iter().all(|f| f.contains(place)) {
                grey.value = f64::NAN;
            }
        }
    }

    /// Computes the flip of each pixel of a column by a far edge or by the lines that cross; marks
    /// pixels near markers and tags as unreadable.
    fn compute_flips(
        &self,
        column: &ColumnCrossing,
        top: usize,
        greys: &mut [Grey],
        flips: &mut Vec<Flip>,
    ) {
        flips.clear();
        if let Some(far_edge) = &self.far_edge {
            let rows = top..top + greys.len();
            flips.extend(rows.map(|row| far_edge.flip(column.place(row as f64))));
            return;
        }
        let Some(crossings) = self
            .crossings
            .map(|crossings| crossings.adjacent_to(column.s))
        else {
            flips.resize(greys.len(), Flip::NONE);
            return;
        };
        let place_and_distance = |row: usize| {
            let row = row as f64;
            (column.place(row), column.distance(row - column.centre))
        };
        // Where only the line itself has an effect, no marker or tag is near.
        if let Some(flip) =
            crossings.constant_flip([top, top + greys.len() - 1].map(place_and_distance))
        {
            flips.resize(greys.len(), flip);
            return;
        }
        for (row, grey) in (top..).zip(greys) {
            let (place, distance) = place_and_distance(row);
            if crossings.is_near_marker(distance) || crossings.is_near_tag(place) {
                grey.value = f64::NAN;
            }
            flips.push(crossings.flip(place, distance));
        }
    }

    /// Adds the readable pixels of one column; those far from the edge are summed up.
    fn add_column(
        &self,
        column: &ColumnCrossing,
        top: usize,
        (greys, flips): (&[Grey], &[Flip]),
        plateaus: &mut [Plateau; 2],
        pixels: &mut Vec<Pixel>,
    ) {
        let curve = &self.curve;
        // Within a column, the frame's coordinates are linear in the row.
        let (s_at_top, y_at_top) = curve.local(column.place(top as f64));
        let v = 1 - column.u;
        let (s_per_row, y_per_row) = (curve.along[v] / curve.half_length, curve.across[v]);
        let place = |index: usize| {
            let row = index as f64;
            (s_at_top + row * s_per_row, y_at_top + row * y_per_row)
        };
        // The first row near the edge, and the first one beyond.
        let near = self.near * column.per_pixel;
        let index_of = |row: f64| ((row - top as f64).max(0.0) as usize).min(greys.len());
        let start = index_of((column.centre - near).ceil());
        let end = index_of((column.centre + near).floor() + 1.0).max(start);
        for (rows, is_after) in [(0..start, false), (end..greys.len(), true)] {
            let plateau = &mut plateaus[usize::from(is_after == column.is_downwards)];
            let mut sums = *plateau;
            for index in rows {
                let Grey { value, is_clipped } = greys[index];
                if value.is_finite() {
                    let (s, y) = place(index);
                    sums.add([s, y, value], flips[index], is_clipped);
                }
            }
            *plateau = sums;
        }
        for index in start..end {
            let Grey { value, is_clipped } = greys[index];
            if value.is_finite() {
                let (s, y) = place(index);
                pixels.push(Pixel {
                    s,
                    y,
                    foot: s + (y - curve.height(s)) * column.foot_per_height,
                    cosine: column.cosine,
                    value,
                    count: 1.0,
                    flip: flips[index],
                    is_clipped,
                });
            }
        }
    }
}

/// The crossing of a curve and a column of pixels, and the directions there.
struct ColumnCrossing {
    /// The axis across columns: 0 for columns of the picture, 1 for its rows.
    u: usize,
    number: usize,
    /// Row of the crossing, and its coordinate along the chord.
    centre: f64,
    s: f64,
    /// Number of rows per pixel of distance from the curve.
    per_pixel: f64,
    /// Whether distances increase with the row.
    is_downwards: bool,
    /// Cosine of the angle between curve and chord, and shift of a pixel's foot per height above
    /// the curve: both are constant over a band's width.
    cosine: f64,
    foot_per_height: f64,
}

impl ColumnCrossing {
    /// The crossing with a column, sought from a nearby `s`.
    fn crossing(curve: &ChordCurve, u: usize, number: usize, mut s: f64) -> Self {
        let (along, across, v) = (curve.along, curve.across, 1 - u);
        let target = number as f64 - curve.origin[u];
        // The curve is nearly parallel to its chord, so that this iteration converges quickly.
        let per_length = 1.0 / (along[u] * curve.half_length);
        for _ in 0..2 {
            s = (target - curve.height(s) * across[u]) * per_length;
        }
        let (height, slope) = curve.height_and_slope(s);
        let cosine = 1.0 / (1.0 + slope * slope).sqrt();
        let normal_v = (across[v] - slope * along[v]) * cosine;
        Self {
            u,
            number,
            centre: curve.origin[v] + s * curve.half_length * along[v] + height * across[v],
            s,
            // Clamped, so that a wild curve along the column does not reach across the picture.
            per_pixel: 1.0 / normal_v.abs().max(0.25),
            is_downwards: normal_v > 0.0,
            cosine,
            foot_per_height: slope * cosine * cosine / curve.half_length,
        }
    }

    /// First row and number of rows within reach of the curve, on its negative side and on the
    /// other.
    fn rows(&self, reach: [f64; 2], size: usize) -> Option<(usize, usize)> {
        let [mut up, mut down] = reach.map(|reach| reach * self.per_pixel);
        if !self.is_downwards {
            (up, down) = (down, up);
        }
        let first = (self.centre - up).ceil().max(0.0);
        let last = (self.centre + down).floor().min(size as f64 - 1.0);
        (first <= last).then(|| (first as usize, last as usize - first as usize + 1))
    }

    /// Distance from the curve of a pixel this many rows below the crossing.
    fn distance(&self, rows: f64) -> f64 {
        let distance = rows / self.per_pixel;
        if self.is_downwards {
            distance
        } else {
            -distance
        }
    }

    fn place(&self, row: f64) -> Vector2<f64> {
        let mut point = Vector2::repeat(row);
        point[self.u] = self.number as f64;
        point
    }
}

/// Sums of pixels far from the edge, on one side of it.
#[derive(Debug, Clone, Copy, Default)]
struct Plateau {
    s: f64,
    y: f64,
    value: f64,
    slope: f64,
    shift: f64,
    count: f64,
    is_clipped: bool,
}

impl Plateau {
    fn add(&mut self, [s, y, value]: [f64; 3], flip: Flip, is_clipped: bool) {
        // The mean of values and bounds is a bound.
        self.is_clipped |= is_clipped;
        self.s += s;
        self.y += y;
        self.value += value;
        self.slope += flip.slope;
        self.shift += flip.shift;
        self.count += 1.0;
    }

    /// Returns the mean pixel, if there are any, and resets the sums.
    fn take(&mut self) -> Option<Pixel> {
        let Self {
            s,
            y,
            value,
            slope,
            shift,
            count,
            is_clipped,
        } = std::mem::take(self);
        (count > 0.0).then(|| Pixel {
            s: s / count,
            y: y / count,
            foot: s / count,
            cosine: 1.0,
            value: value / count,
            count,
            flip: Flip {
                slope: slope / count,
                shift: shift / count,
            },
            is_clipped,
        })
    }
}
