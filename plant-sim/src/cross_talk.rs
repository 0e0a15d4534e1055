//! What an axis gets of where another one is: errors of its guideways, and friction.

/// Share by which friction falls at most.
pub const FRICTION_SHARE_MIN: f64 = -0.9;

/// One axis disturbs another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossTalk {
    /// Index of the axis that is disturbed.
    pub of: usize,
    /// Index of the one that disturbs it.
    pub from: usize,
    /// Error of position for each mm of the other, in mm.
    pub squareness_mm_per_mm: f64,
    /// Amplitude of a wave over the other's travel, in mm.
    pub straightness_mm: f64,
    /// Its length, in mm.
    pub straightness_length_mm: f64,
    /// By how much friction rises for each mm of the other, as a share.
    pub friction_share_per_mm: f64,
}

impl CrossTalk {
    /// By how much the table is beside its place where the other's is there, in mm.
    pub fn error_mm(&self, from_mm: f64) -> f64 {
        let turns = from_mm / self.straightness_length_mm;
        let wave = libm::sin(2.0 * std::f64::consts::PI * (turns - libm::floor(turns)));
        self.squareness_mm_per_mm * from_mm + self.straightness_mm * wave
    }

    /// By which share friction is higher where the other's table is there.
    pub fn friction_share(&self, from_mm: f64) -> f64 {
        (self.friction_share_per_mm * from_mm).max(FRICTION_SHARE_MIN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_leans_with_the_other_axis_and_waves_over_its_travel() {
        let talk = CrossTalk {
            of: 0,
            from: 1,
            squareness_mm_per_mm: 2e-5,
            straightness_mm: 1e-3,
            straightness_length_mm: 200.0,
            friction_share_per_mm: 1e-3,
        };
        assert!((talk.error_mm(100.0) - 0.002).abs() < 1e-12);
        assert!((talk.error_mm(50.0) - 0.002).abs() < 1e-12);
        assert!((talk.error_mm(-50.0) + 0.002).abs() < 1e-12);
        assert_eq!(talk.friction_share(100.0), 0.1);
        assert_eq!(talk.friction_share(-5000.0), -0.9);
    }
}
