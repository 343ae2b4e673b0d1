//! A representative subset of many pixels.

/// Its multiples modulo 1 fill the range from 0 to 1 evenly, without a period.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_895;

/// One in `stride` of a side's pixels, for any number of pixels per column of its band; a regular
/// subset might lie on one side of the edge only.
pub(super) fn subset<T>(pixels: impl Iterator<Item = T>, stride: usize) -> impl Iterator<Item = T> {
    let is_kept = move |index: usize| (index as f64 * GOLDEN_RATIO).fract() * (stride as f64) < 1.0;
    let kept = pixels.enumerate().filter(move |(index, _)| is_kept(*index));
    kept.map(|(_, pixel)| pixel)
}
