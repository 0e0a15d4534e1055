//! The radial deviation over the angle of one circle in one direction, in bins: memory that no number of turns enlarges.

use std::f64::consts::TAU;

/// Bins of a turn: 0.25° each. What a distance of 10 µm behind a reversal takes, sqrt(2 · 10 µm / radius), is 0.8° at
/// 100 mm.
pub const BINS: usize = 1440;

/// What was taken in one bin.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bin {
    count: u32,
    sum_um: f64,
    sum_squares_um2: f64,
    /// Lowest and highest deviation, and the angle each was taken at.
    low: (f64, f64),
    high: (f64, f64),
}

const EMPTY: Bin = Bin {
    count: 0,
    sum_um: 0.0,
    sum_squares_um2: 0.0,
    low: (f64::INFINITY, 0.0),
    high: (f64::NEG_INFINITY, 0.0),
};

/// Deviation of the samples of one bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Middle of the bin, about the programmed centre, from the first axis of the plane, in rad.
    pub angle_rad: f64,
    /// Mean distance from the programmed centre minus programmed radius, in µm.
    pub radial_um: f64,
    /// Variance of the samples about that mean, in µm².
    pub scatter_um2: f64,
}

/// Deviations of one circle in one direction, all its turns together.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    bins: Vec<Bin>,
}

impl Default for Profile {
    fn default() -> Self {
        Profile {
            bins: vec![EMPTY; BINS],
        }
    }
}

impl Profile {
    /// Takes a sample: its angle and its distance from the programmed circle, outward positive. One that is not finite is
    /// left out.
    pub fn take(&mut self, angle_rad: f64, radial_um: f64) {
        if !angle_rad.is_finite() || !radial_um.is_finite() {
            return;
        }
        let turn = angle_rad / TAU - libm::floor(angle_rad / TAU);
        let index = ((turn * BINS as f64) as usize).min(BINS - 1);
        let Some(bin) = self.bins.get_mut(index) else {
            return;
        };
        bin.count = bin.count.saturating_add(1);
        bin.sum_um += radial_um;
        bin.sum_squares_um2 += radial_um * radial_um;
        if radial_um < bin.low.0 {
            bin.low = (radial_um, angle_rad);
        }
        if radial_um > bin.high.0 {
            bin.high = (radial_um, angle_rad);
        }
    }

    /// One reading per bin; none where nothing was taken.
    pub fn readings(&self) -> impl Iterator<Item = Option<Reading>> + '_ {
        self.bins.iter().enumerate().map(|(index, bin)| {
            let count = f64::from(bin.count);
            (bin.count > 0).then(|| {
                let radial_um = bin.sum_um / count;
                let square_um2 = bin.sum_squares_um2 / count;
                Reading {
                    angle_rad: (index as f64 + 0.5) * TAU / BINS as f64,
                    radial_um,
                    scatter_um2: (square_um2 - radial_um * radial_um).max(0.0),
                }
            })
        })
    }

    /// Lowest and highest deviation about another centre, which lies there from the programmed one, in µm.
    pub fn range_um(&self, centre_um: [f64; 2]) -> (f64, f64) {
        let about = |(radial_um, angle_rad): (f64, f64)| about_um(radial_um, angle_rad, centre_um);
        let bins = self.bins.iter().filter(|bin| bin.count > 0);
        bins.fold((f64::INFINITY, f64::NEG_INFINITY), |range, bin| {
            (range.0.min(about(bin.low)), range.1.max(about(bin.high)))
        })
    }

    /// Part of a turn that has readings, in degrees.
    pub fn measured_deg(&self) -> f64 {
        let taken = self.bins.iter().filter(|bin| bin.count > 0).count();
        taken as f64 * 360.0 / BINS as f64
    }
}

/// A deviation about a centre that lies some µm from the programmed one: to first order, for offsets far below the radius.
fn about_um(radial_um: f64, angle_rad: f64, [x_um, y_um]: [f64; 2]) -> f64 {
    radial_um - x_um * libm::cos(angle_rad) - y_um * libm::sin(angle_rad)
}

/// Hysteresis H: the largest distance between the mean curves of both directions, and its angle in degrees. The centre
/// cancels.
pub fn hysteresis(counter_clockwise: &Profile, clockwise: &Profile) -> Option<(f64, f64)> {
    let pairs = counter_clockwise.readings().zip(clockwise.readings());
    let both = pairs.filter_map(|(one, other)| one.zip(other));
    both.map(|(one, other)| {
        let apart_um = (one.radial_um - other.radial_um).abs();
        (apart_um, one.angle_rad.to_degrees())
    })
    .max_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_about_another_centre_is_that_of_the_samples_and_a_bin_keeps_its_extremes() {
        let mut profile = Profile::default();
        for sample in 0..36_000 {
            let angle_rad = f64::from(sample).to_radians() / 100.0;
            let radial_um = 12.0 * libm::cos(angle_rad) - 5.0 * libm::sin(angle_rad);
            let spike_um = if sample == 4_711 { 3.0 } else { 0.0 };
            profile.take(angle_rad, radial_um + spike_um);
        }
        profile.take(f64::NAN, 1.0);
        profile.take(0.0, f64::NAN);
        let (low_um, high_um) = profile.range_um([12.0, -5.0]);
        assert!(low_um.abs() < 1e-9 && (high_um - 3.0).abs() < 1e-9);
        assert_eq!(profile.measured_deg(), 360.0);
    }

    #[test]
    fn hysteresis_is_read_where_both_directions_were_measured() {
        let (mut one, mut other) = (Profile::default(), Profile::default());
        for degree in 0..360 {
            let angle_rad = (f64::from(degree) + 0.1).to_radians();
            one.take(angle_rad, if degree == 77 { 4.0 } else { 1.0 });
            if degree < 180 {
                other.take(angle_rad, 0.5);
            }
        }
        one.take(200.1f64.to_radians(), 90.0);
        let (apart_um, at_deg) = hysteresis(&one, &other).unwrap();
        assert_eq!(apart_um, 3.5);
        assert!((at_deg - 77.0).abs() < 0.5);
        assert_eq!(hysteresis(&one, &Profile::default()), None);
    }
}
