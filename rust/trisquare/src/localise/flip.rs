//! What lines that cross a side make of its step.

/// From so many blurs on a change of sides is complete, to 6e-5 of the contrast.
pub(super) const COMPLETE: f64 = 4.0;
/// What others may make of a step that is clear of them.
const CLEAR: f64 = 0.01;

/// How an edge looks across it.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeShape {
    /// Standard deviation of its blur, pixels.
    pub blur: f64,
    /// How far it lies from its line toward the light, pixels.
    pub spread: f64,
}

impl EdgeShape {
    /// Of an edge that lies on its line.
    pub fn unspread(blur: f64) -> Self {
        Self { blur, spread: 0.0 }
    }
}

/// What crossings make of a blurred step, `2 Phi(d) - 1` from -1 to 1: it times `slope`, and
/// `shift`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flip {
    /// 1 where light and dark are on the wanted sides, -1 where they are exchanged.
    pub slope: f64,
    pub shift: f64,
}

impl Flip {
    /// Of a line without crossings.
    pub const NONE: Self = Self {
        slope: 1.0,
        shift: 0.0,
    };

    /// Whether the step is that of its own edge: what the others' spread does to it, and the tone
    /// curve to them, is not felt.
    pub fn is_clear(self) -> bool {
        self.slope.abs() > 1.0 - CLEAR && self.shift.abs() < CLEAR
    }

    pub fn opposite(self) -> Self {
        Self {
            slope: -self.slope,
            shift: -self.shift,
        }
    }
}
