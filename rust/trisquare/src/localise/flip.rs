//! The change of a side's step by the lines that cross it.

/// Distance, in blurs, beyond which a change of sides is complete, to 6e-5 of the contrast.
pub(super) const COMPLETE_BLURS: f64 = 4.0;
/// Largest change of a step by other edges for which it is clear of them.
const MAX_CLEAR_CHANGE: f64 = 0.01;

/// Shape of an edge's profile.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeShape {
    /// Standard deviation of its blur, pixels.
    pub blur: f64,
    /// Displacement of the edge from its line towards the light, pixels.
    pub spread: f64,
}

impl EdgeShape {
    /// An edge that lies on its line.
    pub fn unspread(blur: f64) -> Self {
        Self { blur, spread: 0.0 }
    }
}

/// Effect of crossings on a blurred step, `2 Phi(d) - 1` from -1 to 1: the step is multiplied by
/// `slope`, and `shift` is added.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flip {
    /// 1 where light and dark are on the expected sides, -1 where they are exchanged.
    pub slope: f64,
    pub shift: f64,
}

impl Flip {
    /// The flip of a line without crossings.
    pub const NONE: Self = Self {
        slope: 1.0,
        shift: 0.0,
    };

    /// Whether the step is that of its own edge only: neither the spread of the others nor the
    /// effect of the tone curve on them matters.
    pub fn is_clear(self) -> bool {
        self.slope.abs() > 1.0 - MAX_CLEAR_CHANGE && self.shift.abs() < MAX_CLEAR_CHANGE
    }

    pub fn opposite(self) -> Self {
        Self {
            slope: -self.slope,
            shift: -self.shift,
        }
    }
}
