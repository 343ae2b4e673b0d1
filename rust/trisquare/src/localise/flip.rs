//! What lines that cross a side make of its step.

/// From so many blurs on a change of sides is complete, to 6e-5 of the contrast.
pub(super) const COMPLETE: f64 = 4.0;

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

    pub fn opposite(self) -> Self {
        Self {
            slope: -self.slope,
            shift: -self.shift,
        }
    }
}
