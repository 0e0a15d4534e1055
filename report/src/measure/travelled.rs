//! Where the tool was and how far off the path, thinned out without losing peaks, in memory that no length of a run enlarges.

use path::geometry::AxisVector;

/// A peak smaller than this part of the largest is none.
const PEAK_SHARE_MIN: f64 = 0.2;
/// Peaks are farther apart than this part of the longest way along an axis.
const APART_SHARE: f64 = 0.06;
/// Places that are kept; twice as many are thinned out to it.
const PLACES_MAX: usize = 8192;

/// A place of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The tool, in mm (rotary axes in degrees).
    pub tool_mm: AxisVector,
    /// Largest contour error from the place before to this one.
    pub error: Error,
}

/// A contour error, and where it was.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Error {
    /// How large, in mm.
    pub mm: f64,
    /// Scan.
    pub scan: u64,
    /// Line of the program that the command was in; 0 where there is none.
    pub line: u32,
}

impl Error {
    /// The larger one; the earlier of two that are alike.
    fn larger(self, other: Error) -> Error {
        if other.mm > self.mm { other } else { self }
    }
}

/// The places of a run, in order of travel.
#[derive(Debug, Clone, PartialEq)]
pub struct Travelled {
    places: Vec<Place>,
    /// So many scans are one place.
    scans: u32,
    /// Scans since the last place, and their largest error.
    since: (u32, Error),
}

impl Default for Travelled {
    fn default() -> Self {
        Travelled {
            places: Vec::new(),
            scans: 1,
            since: (0, Error::default()),
        }
    }
}

impl Travelled {
    /// Takes the place at the end of a scan, and the largest contour error within it. Rest is one place.
    pub fn take(&mut self, tool_mm: AxisVector, error: Error) {
        self.since = (self.since.0 + 1, self.since.1.larger(error));
        if self.since.0 < self.scans {
            return;
        }
        let place = Place {
            tool_mm,
            error: self.since.1,
        };
        self.since = (0, Error::default());
        match self.places.last_mut() {
            Some(last) if last.tool_mm == tool_mm => {
                last.error = last.error.larger(place.error);
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
            let errors = pair.iter().map(|place| place.error);
            let error = errors.fold(Error::default(), Error::larger);
            pair.last().map(|last| Place { error, ..*last })
        });
        self.places = pairs.collect();
        self.scans = self.scans.saturating_mul(2);
    }

    /// What is kept, in order of travel.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// Where the contour error was largest, the largest first: at most so many places, one of each line of the program, apart
    /// from each other by 6 % of the longest way along an axis, and none below a fifth of the largest.
    pub fn peaks(&self, most: usize) -> Vec<Place> {
        let mut falling: Vec<&Place> = self.places.iter().collect();
        falling.sort_by(|a, b| b.error.mm.total_cmp(&a.error.mm));
        let least_mm = falling
            .first()
            .map_or(0.0, |first| PEAK_SHARE_MIN * first.error.mm);
        let apart_mm = APART_SHARE * self.longest_way_mm();
        let mut peaks: Vec<Place> = Vec::new();
        for place in falling {
            if peaks.len() == most || place.error.mm <= 0.0 || place.error.mm < least_mm {
                break;
            }
            let known = peaks.iter().any(|peak| {
                let away_mm = (peak.tool_mm - place.tool_mm).norm();
                peak.error.line == place.error.line || away_mm < apart_mm
            });
            if !known {
                peaks.push(*place);
            }
        }
        peaks
    }

    fn longest_way_mm(&self) -> f64 {
        let tools = || self.places.iter().map(|place| place.tool_mm);
        let low = tools().reduce(|a, b| a.inf(&b));
        let high = tools().reduce(|a, b| a.sup(&b));
        low.zip(high).map_or(0.0, |(low, high)| (high - low).max())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error in a scan; a line of the program every thousand scans.
    fn error(mm: f64, scan: u32) -> Error {
        Error {
            mm,
            scan: scan.into(),
            line: scan / 1000,
        }
    }

    #[test]
    fn peaks_are_of_different_lines_and_places_and_what_is_small_is_none() {
        let mut travelled = Travelled::default();
        // 100 mm of travel, ten lines; two bumps in line 2, one at the very end of line 4 and the beginning of line 5.
        let bumps = [
            (2300.0, 0.008),
            (2800.0, 0.010),
            (5000.0, 0.006),
            (8500.0, 0.0019),
        ];
        for scan in 0..10_000u32 {
            let mut tool_mm = AxisVector::zeros();
            tool_mm[0] = f64::from(scan) * 0.01;
            let of = |(at, mm): (f64, f64)| {
                let away = (f64::from(scan) - at) / 100.0;
                mm * libm::exp(-away * away)
            };
            let mm = bumps.into_iter().map(of).fold(0.0, f64::max);
            travelled.take(tool_mm, error(mm, scan));
        }
        let peaks = travelled.peaks(5);
        let found: Vec<u32> = peaks.iter().map(|peak| peak.error.line).collect();
        assert_eq!(found, [2, 5]);
        assert_eq!(peaks[0].error, error(0.010, 2800));
        assert_eq!(travelled.peaks(1).len(), 1);
        assert_eq!(Travelled::default().peaks(5), []);
    }

    #[test]
    fn however_long_the_run_is_the_places_are_few_and_the_peak_is_among_them() {
        let mut travelled = Travelled::default();
        for scan in 0..200_000 {
            let mut tool_mm = AxisVector::zeros();
            tool_mm[0] = f64::from(scan) * 1e-3;
            travelled.take(
                tool_mm,
                error(if scan == 123_457 { 0.05 } else { 0.001 }, scan),
            );
        }
        let places = travelled.places();
        assert!(places.len() < 2 * PLACES_MAX, "{}", places.len());
        let peak = places.iter().find(|place| place.error.mm == 0.05);
        let peak = peak.expect("the peak");
        assert!((peak.tool_mm[0] - 123.457).abs() < 0.1, "{peak:?}");
        assert_eq!((peak.error.scan, peak.error.line), (123_457, 123));
        for _ in 0..1000 {
            travelled.take(AxisVector::zeros(), Error::default());
        }
        let rest = travelled.places().iter().rev();
        assert_eq!(
            rest.take_while(|place| place.tool_mm == AxisVector::zeros())
                .count(),
            1
        );
    }
}
