//! The mean profile of edges, and its difference from the model.

/// Half the width of a profile, and the width of its bins, in blurs.
const PROFILE_REACH: f64 = 3.5;
const PROFILE_BIN: f64 = 0.5;
const PROFILE_BINS: usize = 14;

/// Number of standard deviations of the misfit by noise above which a misfit counts.
const MISFIT_DEVIATIONS: f64 = 2.0;

/// The residuals about a side, by distance from the edge.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ResidualProfile {
    bins: [ProfileBin; PROFILE_BINS],
}

#[derive(Debug, Clone, Copy, Default)]
struct ProfileBin {
    sum: f64,
    squares: f64,
    count: f64,
}

impl ResidualProfile {
    /// Adds a pixel at a distance in blurs from its edge, positive on the light side.
    pub fn add(&mut self, place: f64, residual: f64) {
        let position = (place + PROFILE_REACH) * (1.0 / PROFILE_BIN);
        if let Some(bin) = self
            .bins
            .get_mut(position as usize)
            .filter(|_| position >= 0.0)
        {
            bin.sum += residual;
            bin.squares += residual * residual;
            bin.count += 1.0;
        }
    }

    pub fn relative_to(mut self, contrast: f64) -> Self {
        for bin in &mut self.bins {
            bin.sum /= contrast.abs();
            bin.squares /= contrast * contrast;
        }
        self
    }

    pub fn merge(&mut self, other: &Self) {
        for (bin, other) in self.bins.iter_mut().zip(&other.bins) {
            bin.sum += other.sum;
            bin.squares += other.squares;
            bin.count += other.count;
        }
    }

    /// Root mean square of the bins' means, minus what noise may contribute.
    pub fn misfit(&self) -> f64 {
        let (mut total, mut noise, mut bins) = (0.0, 0.0, 0.0);
        for bin in self.bins.iter().filter(|bin| bin.count > 1.0) {
            let mean = bin.sum / bin.count;
            total += mean * mean;
            noise += (bin.squares / bin.count - mean * mean) / bin.count;
            bins += 1.0;
        }
        // The expected sum of squares from noise, plus some standard deviations of it.
        let noise_limit = noise * (1.0 + MISFIT_DEVIATIONS * (2.0_f64 / bins).sqrt());
        if total > noise_limit {
            ((total - noise_limit) / bins).sqrt()
        } else {
            0.0
        }
    }
}
