//! Where the tool was and how far off the path, thinned out without losing peaks, in memory that no length of a run enlarges.

use control::path::AxisVector;

/// Places that are kept; twice as many are thinned out to it.
const PLACES_MAX: usize = 8192;

/// A place of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The tool, in mm (rotary axes in degrees).
    pub tool_mm: AxisVector,
    /// Largest contour error from the place before to this one, in mm.
    pub error_mm: f64,
}

/// The places of a run, in order of travel.
#[derive(Debug, Clone, PartialEq)]
pub struct Travelled {
    places: Vec<Place>,
    /// So many scans are one place.
    scans: u32,
    /// Scans since the last place, and their largest error, in mm.
    since: (u32, f64),
}

impl Default for Travelled {
    fn default() -> Self {
        Travelled {
            places: Vec::new(),
            scans: 1,
            since: (0, 0.0),
        }
    }
}

impl Travelled {
    /// Takes the place at the end of a scan, and the largest contour error within it, in mm. Rest is one place.
    pub fn take(&mut self, tool_mm: AxisVector, error_mm: f64) {
        self.since = (self.since.0 + 1, self.since.1.max(error_mm));
        if self.since.0 < self.scans {
            return;
        }
        let place = Place {
            tool_mm,
            error_mm: self.since.1,
        };
        self.since = (0, 0.0);
        match self.places.last_mut() {
            Some(last) if last.tool_mm == tool_mm => {
                last.error_mm = last.error_mm.max(place.error_mm);
            }
            _ => self.places.push(place),
        }
        if self.places.len() >= 2 * PLACES_MAX {
            self.thin();
        }
    }

    /// Makes one place of two: where the later one is, with the larger error.
    fn thin(&mut self) {
        let pairs = self.places.chunks(2).filter_map(|pair| {
            let error_mm = pair.iter().fold(0.0, |most: f64, of| most.max(of.error_mm));
            pair.last().map(|last| Place { error_mm, ..*last })
        });
        self.places = pairs.collect();
        self.scans = self.scans.saturating_mul(2);
    }

    /// What is kept, in order of travel.
    pub fn places(&self) -> &[Place] {
        &self.places
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_long_the_run_is_the_places_are_few_and_the_peak_is_among_them() {
        let mut travelled = Travelled::default();
        for scan in 0..200_000 {
            let mut tool_mm = AxisVector::zeros();
            tool_mm[0] = f64::from(scan) * 1e-3;
            travelled.take(tool_mm, if scan == 123_457 { 0.05 } else { 0.001 });
        }
        let places = travelled.places();
        assert!(places.len() < 2 * PLACES_MAX, "{}", places.len());
        let peak = places.iter().find(|place| place.error_mm == 0.05);
        let at_mm = peak.expect("the peak").tool_mm[0];
        assert!((at_mm - 123.457).abs() < 0.1, "{at_mm}");
        for _ in 0..1000 {
            travelled.take(AxisVector::zeros(), 0.0);
        }
        let rest = travelled.places().iter().rev();
        assert_eq!(
            rest.take_while(|place| place.tool_mm == AxisVector::zeros())
                .count(),
            1
        );
    }
}
