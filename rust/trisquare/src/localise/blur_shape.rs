//! The shape of a blur across an edge: normal, or wider at its shoulders.
//!
//! A camera that moves while the shutter is open spreads light over a box, and a lens out of focus
//! over a disc. A tone curve turns what a normal blur misses of them, though symmetric, into a
//! shift of the edge: at a motion of 14 pixels and sRGB, fx is off by 0.2 %.

use super::band::Pixel;
use super::blur::{BlurShape, MOST};
use super::pixel_noise::robust_cost;
use super::side::{LAST_STEP, SideModel};
use crate::image::ToneCurve;

/// Blurs (px) that are mostly the pixel's own box and the lens, and taken as normal.
const NORMAL_BLUR: f64 = 1.0;
/// The fourth cumulant is that of a box, times the square of the box's share in the variance. These
/// squares are tried; a disc is alike one of 0.83.
const TRIED: [f64; 5] = [0.25, 0.45, 0.65, 0.8, 0.92];
/// A shape other than normal lowers the cost by so much: four standard deviations.
const MIN_GAIN: f64 = 8.0;
/// Squares this far on both sides are tried where all pixels tell.
const STEP: f64 = 0.08;
/// Steps of the side's fit for each trial.
const TRIAL_STEPS: usize = 4;

impl SideModel {
    /// Gives a side, fitted with a normal blur, the shape that its pixels ask for; false if that is
    /// the normal one.
    pub fn shape(&mut self, tone: &ToneCurve, pixels: &[Pixel], noise: f64) -> bool {
        if self.mean_blur() < NORMAL_BLUR {
            return false;
        }
        let normal = self.tried(tone, pixels, noise, 0.0);
        // If the nearest shape is no better, no other is.
        let nearest = self.tried(tone, pixels, noise, TRIED[0]);
        if nearest.cost > normal.cost - MIN_GAIN {
            return false;
        }
        let mut trials = vec![normal, nearest];
        for square in &TRIED[1..] {
            trials.push(self.tried(tone, pixels, noise, *square));
        }
        *self = self.best(tone, pixels, noise, trials);
        true
    }

    /// Settles the shape of a side that is not normal by all its pixels; false if it is normal.
    pub fn reshape(&mut self, tone: &ToneCurve, pixels: &[Pixel], noise: f64) -> bool {
        let square = self.shape.square;
        if square == 0.0 {
            return false;
        }
        let trials = [square - STEP, square, (square + STEP).min(MOST)]
            .map(|square| self.tried(tone, pixels, noise, square.max(0.0)));
        *self = self.best(tone, pixels, noise, trials.to_vec());
        true
    }

    fn tried(&self, tone: &ToneCurve, pixels: &[Pixel], noise: f64, square: f64) -> Trial {
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

    /// The side at the lowest point of the parabola through the best trial and those beside it.
    fn best(
        &self,
        tone: &ToneCurve,
        pixels: &[Pixel],
        noise: f64,
        trials: Vec<Trial>,
    ) -> SideModel {
        let least = |a: &usize, b: &usize| trials[*a].cost.total_cmp(&trials[*b].cost);
        let middle = (0..trials.len()).min_by(least).unwrap_or(0);
        if middle == 0 || middle + 1 == trials.len() {
            return trials[middle].side.clone();
        }
        let points = [middle - 1, middle, middle + 1].map(|i| {
            let Trial { side, cost } = &trials[i];
            (side.shape.square, *cost)
        });
        match lowest(points) {
            Some(square) => trials[middle].side.tried(tone, pixels, noise, square).side,
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

/// Where the parabola through three points, the middle one the lowest, is lowest.
fn lowest([(x0, y0), (x1, y1), (x2, y2)]: [(f64, f64); 3]) -> Option<f64> {
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
        let place = lowest([0.1, 0.25, 0.6].map(|x| (x, y(x)))).unwrap();
        assert!((place - 0.3).abs() < 1e-12);
        assert!(lowest([(0.0, 1.0), (0.5, 1.0), (1.0, 1.0)]).is_none());
    }
}
