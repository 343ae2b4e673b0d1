//! The grid lines beside a grid line, from the lines that cross both.

use nalgebra::Vector2;

use super::span::EdgeSpan;

/// A line beside a grid line, at which the light changes back.
#[derive(Debug, Clone, Copy)]
pub(super) struct LineBeside {
    /// Distance from the grid line, pixels.
    pub distance: f64,
    /// Whether it is the grid's outline, beyond which all is light.
    pub is_outline: bool,
}

impl LineBeside {
    pub const NONE: Self = Self {
        distance: f64::INFINITY,
        is_outline: true,
    };

    /// The line beside at a place along the line, from those at the crossings before and after it.
    pub fn interpolated(s: f64, before: Option<(f64, Self)>, after: Option<(f64, Self)>) -> Self {
        let (Some((start, first)), Some((end, second))) = (before, after) else {
            return before.or(after).map_or(Self::NONE, |(_, first)| first);
        };
        // If only one crossing has a line there and not just the outline, that line is used.
        match (first.is_outline, second.is_outline) {
            (true, false) => second,
            (false, true) => first,
            (is_outline, _) if first.distance.is_finite() && second.distance.is_finite() => Self {
                distance: first.distance
                    + (s - start) / (end - start) * (second.distance - first.distance),
                is_outline,
            },
            _ if first.distance < second.distance => first,
            _ => second,
        }
    }
}

/// The next line on the right of the given direction, at a crossing of a line.
///
/// Beyond its last line the grid extends to its outline. Except for perspective, the distance to it
/// is the one between the next two lines inwards.
pub(super) fn next_line(
    spans: &[EdgeSpan],
    index: usize,
    number: usize,
    along: Vector2<f64>,
) -> LineBeside {
    if let Some(&distance) = line_distances(spans, index, number, along).first() {
        return LineBeside {
            distance,
            is_outline: false,
        };
    }
    let inwards = line_distances(spans, index, number, -along);
    let distance = match inwards[..] {
        [first, second, third, ..] => (second - first) * first / (third - second),
        [first, second] => second - first,
        _ => return LineBeside::NONE,
    };
    LineBeside {
        distance,
        is_outline: true,
    }
}

/// Distances from a line to the next lines on the right of the given direction, at most three.
pub(super) fn line_distances(
    spans: &[EdgeSpan],
    index: usize,
    number: usize,
    along: Vector2<f64>,
) -> Vec<f64> {
    let points = next_crossings(spans, index, number, along).unwrap_or_default();
    let here = spans[index].path.get(number).copied().unwrap_or_default();
    let distance = |point: &Vector2<f64>| along.perp(&(point - here));
    points.iter().map(distance).collect()
}

/// The next crossings, at most three, along the line that crosses another, on the right of the
/// given direction; they end at the first missing one.
pub(super) fn next_crossings(
    spans: &[EdgeSpan],
    index: usize,
    number: usize,
    along: Vector2<f64>,
) -> Option<Vec<Vector2<f64>>> {
    let crossing_line = spans[index].crossings.get(number)?.0?;
    let place = crossing_index(spans, crossing_line, index)?;
    let EdgeSpan {
        path, crossings, ..
    } = &spans[crossing_line];
    let here = path.get(place)?;
    let runs = [-1, 1].map(|step| {
        let mut from = place;
        let next = || {
            let to = from.checked_add_signed(step)?;
            let is_next = crossings.get(to)?.1.abs_diff(crossings[from].1) == 1;
            from = to;
            path.get(to).filter(|_| is_next).copied()
        };
        std::iter::from_fn(next).take(3).collect::<Vec<_>>()
    });
    let is_right = |point: &Vector2<f64>| along.perp(&(point - here)) > 0.0;
    runs.into_iter()
        .find(|run| run.first().is_some_and(is_right))
}

/// Smallest distance from a line to the lines beside it, including the grid's outline, measured
/// along the lines that cross both, pixels; infinite if there is none.
pub(super) fn spacing(spans: &[EdgeSpan], index: usize, along: Vector2<f64>) -> f64 {
    let numbers = 0..spans[index].crossings.len();
    numbers
        .flat_map(|number| [-along, along].map(|along| next_line(spans, index, number, along)))
        .map(|beside| beside.distance)
        .fold(f64::INFINITY, f64::min)
}

/// Index in the list of a line's crossings of the one with another line.
pub(super) fn crossing_index(
    spans: &[EdgeSpan],
    line: usize,
    crossing_line: usize,
) -> Option<usize> {
    let crossings = &spans.get(line)?.crossings;
    crossings.iter().position(|c| c.0 == Some(crossing_line))
}
