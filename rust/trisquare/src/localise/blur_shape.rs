//! The shape of a blur across an edge: normal, or wider at its shoulders.
//!
//! A camera that moves while the shutter is open spreads light over a box, and a lens out of focus
//! over a disc. A tone curve turns the difference from a normal blur, though symmetric, into a
//! shift of the edge: with a motion of 14 pixels and sRGB, fx is wrong by 0.2 %. With a normal
//! shape, the estimate of the tone curve failed for discs of 1.2 to 1.6 pixels and little other blur.

use super::band::Pixel;
use super::blur::{BlurShape, MAX_BOX_SQUARE};
use super::pixel_noise::robust_cost;
use super::side::{LAST_STEP, SideModel};
use crate::image::ToneCurve;

/// Squares of the box's share of the variance that are tried. The fourth cumulant of a shape is
/// that of a box times this square; a disc is similar to a shape with 0.83.
const TRIAL_SQUARES: [f64; 5] = [0.25, 0.45, 0.65, 0.8, 0.92];
/// Minimum decrease of the cost for a shape other than normal: four standard deviations.
const MIN_GAIN: f64 = 8.0;
/// Difference of the squares that are tried on both sides of the current one when all pixels are
/// used.
const SQUARE_STEP: f64 = 0.08;
/// Maximum number of steps of the side's fit in each trial.
const TRIAL_STEPS: usize = 4;

impl SideModel {
    /// Gives a side that was fitted with a normal blur the shape that fits its pixels best; false
    /// if that is the normal one.
    pub fn fit_shape(&mut self, tone: &ToneCurve, pixels: &[Pixel], noise: f64) -> bool {
        let normal = self.trial(tone, pixels, noise, 0.0);
        // If the nearest shape is no better than the normal one, no other is.
        let nearest = self.trial(tone, pixels, noise, TRIAL_SQUARES[0]);
        if nearest.cost > normal.cost - MIN_GAIN {
            return false;
        }
        let mut trials = vec![normal, nearest];
        for square in &TRIAL_SQUARES[1..] {
            trials.push(self.trial(tone, pixels, noise, *square));
        }
        *self = self.best(tone, pixels, noise, trials);
        true
    }

    /// Refines the shape of a side that is not normal, from all its pixels; false if it is normal.
    pub fn refine_shape(&mut self, tone: &ToneCurve, pixels: &[Pixel], noise: f64) -> bool {
        let square = self.shape.square;
        if square == 0.0 {
            return false;
        }
        let trials = [
            square - SQUARE_STEP,
            square,
            (square + SQUARE_STEP).min(MAX_BOX_SQUARE),
        ]
        .map(|square| self.trial(tone, pixels, noise, square.max(0.0)));
        *self = self.best(tone, pixels, noise, trials.to_vec());
        true
    }

    fn trial(&self, tone: &ToneCurve, pixels: &[Pixel], noise: f64, square: f64) -> Trial {
        let mut side = SideModel {
            shape: BlurShape::with_square(square),
            ..self.clone()
        };
        let mut predictions = Vec::with_capacity(pixels.len());
        let steps = (TRIAL_STEPS, LAST_STEP);
        side.predict_all(tone, pixels, &mut predictions);
        side.fit(tone, pixels, &mut predictions, noise, steps);
        if predictions.is_empty() {
            side.predict_all(tone, pixels, &mut predictions);
        }
        let inverse_variance = 1.0 / (noise * noise);
        let costs = pixels.iter().zip(&predictions).map(|(pixel, p)| {
            0.5 * robust_cost(p.residual * p.residual * inverse_variance * pixel.count)
        });
        Trial {
            cost: costs.sum(),
            side,
        }
    }

    /// The side at the minimum of the parabola through the best trial and its two neighbours.
    fn best(
        &self,
        tone: &ToneCurve,
        pixels: &[Pixel],
        noise: f64,
        trials: Vec<Trial>,
    ) -> SideModel {
        let by_cost = |a: &usize, b: &usize| trials[*a].cost.total_cmp(&trials[*b].cost);
        let middle = (0..trials.len()).min_by(by_cost).unwrap_or(0);
        if middle == 0 || middle + 1 == trials.len() {
            return trials[middle].side.clone();
        }
        let points = [middle - 1, middle, middle + 1].map(|i| {
            let Trial { side, cost } = &trials[i];
            (side.shape.square, *cost)
        });
        match parabola_minimum(points) {
            Some(square) => trials[middle].side.trial(tone, pixels, noise, square).side,
            None => trials[middle].side.clone(),
        }
    }
}

/// A side fitted with one shape, and half its robust sum of squares.
#[derive(Clone)]
struct Trial {
    side: SideModel,
    cost: f64,
}

/// Position of the minimum of the parabola through three points, of which the middle one is the
/// lowest.
fn parabola_minimum([(x0, y0), (x1, y1), (x2, y2)]: [(f64, f64); 3]) -> Option<f64> {
    let (before, after) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
    let curvature = (after - before) / (x2 - x0);
    let place = 0.5 * (x0 + x1) - 0.5 * before / curvature;
    (curvature > 0.0 && x0 <= place && place <= x2).then_some(place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_lowest_at_its_vertex() {
        let y = |x: f64| 2.0 * (x - 0.3) * (x - 0.3) + 1.0;
        let place = parabola_minimum([0.1, 0.25, 0.6].map(|x| (x, y(x)))).unwrap();
        assert!((place - 0.3).abs() < 1e-12);
        assert!(parabola_minimum([(0.0, 1.0), (0.5, 1.0), (1.0, 1.0)]).is_none());
    }
}
