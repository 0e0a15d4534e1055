//! The ball-bar test (ISO 230-4): what circles that are travelled both ways show together.
//!
//! All runs on one circle at one feed and in one direction are taken together, their steady parts, in bins of 0.25°
//! (`profile`). Of a circle this gives
//!
//! - *G(b)*, the bidirectional circular deviation: highest minus lowest of both paths about one centre, the mean of the
//!   least-squares centres of both directions;
//! - *H*, the hysteresis: largest distance between the mean curves of both directions at one angle;
//! - the causes of the deviation, ranked (`diagnosis`), where the axes are those of the program.
//!
//! A circle that has one direction only has no G(b) and no H, and squareness is not told from servo mismatch.

mod cause;
mod diagnosis;
mod profile;
#[cfg(test)]
mod tests;

pub use cause::{Cause, CauseKind, Setting};
pub use diagnosis::{Diagnosis, Part, diagnose};
pub use profile::{Profile, Reading};

use super::arc::plots::{PLOTS_MAX, in_one_plot, shown};
use super::arc::{ArcResult, Circle};
use crate::turns::window_rad;

/// Circles that are kept: as many as are drawn.
const CIRCLES_MAX: usize = PLOTS_MAX;
/// Part of a turn that each direction must have for causes to be told apart, in degrees.
const DIAGNOSED_DEG_MIN: f64 = 270.0;

/// One direction of a circle, all its runs together.
#[derive(Debug, Clone)]
struct Way {
    profile: Profile,
    runs: u32,
    line: u32,
    speed_mm_s: f64,
    circular_um: f64,
    radial_um: (f64, f64),
    centre_sum_um: [f64; 2],
}

/// What was measured of one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneWay {
    /// Line of the program of its first run.
    pub line: u32,
    /// How many runs.
    pub runs: u32,
    /// Part of a turn that was measured, in degrees.
    pub measured_deg: f64,
    /// Circular deviation G, in µm: the largest of its runs.
    pub circular_um: f64,
    /// Radial deviation Fmax and Fmin about the least-squares centre, in µm, over its runs.
    pub radial_um: (f64, f64),
}

/// A circle that was travelled both ways, or one way.
#[derive(Debug, Clone)]
pub struct BallBar {
    /// The circle; its direction means nothing.
    pub circle: Circle,
    /// Counter-clockwise; none where it was not travelled so.
    pub counter_clockwise: Option<OneWay>,
    /// Clockwise; none where it was not travelled so.
    pub clockwise: Option<OneWay>,
    /// The common centre, from the programmed one, in µm.
    pub centre_um: [f64; 2],
    /// Bidirectional circular deviation G(b), in µm; none of one direction.
    pub bidirectional_um: Option<f64>,
    /// Hysteresis H, in µm, and where, in degrees from the first axis.
    pub hysteresis: Option<(f64, f64)>,
    /// What causes it; none where it cannot be told.
    pub diagnosis: Option<Diagnosis>,
}

/// The circles of a run, being collected.
#[derive(Debug, Default)]
pub struct BallBarMeter {
    /// Counter-clockwise, clockwise.
    circles: Vec<(Circle, [Option<Way>; 2])>,
}

impl BallBarMeter {
    /// Takes a measured arc and the steady samples of its table: points about the programmed centre, in mm.
    pub fn take(&mut self, arc: &ArcResult, samples: impl Iterator<Item = [f64; 2]>) {
        if !shown(arc) {
            return;
        }
        let mut known = self.circles.iter();
        let place = known.position(|(circle, _)| in_one_plot(circle, &arc.circle));
        if place.is_none() && self.circles.len() < CIRCLES_MAX {
            self.circles.push((arc.circle.clone(), [None, None]));
        }
        let place = place.unwrap_or(self.circles.len() - 1);
        let Some((circle, ways)) = self.circles.get_mut(place) else {
            return;
        };
        if !in_one_plot(circle, &arc.circle) {
            return;
        }
        let [counter_clockwise, clockwise] = ways;
        let way = if arc.circle.clockwise {
            clockwise
        } else {
            counter_clockwise
        };
        let way = way.get_or_insert_with(|| Way {
            profile: Profile::default(),
            runs: 0,
            line: arc.line,
            speed_mm_s: 0.0,
            circular_um: 0.0,
            radial_um: (f64::NEG_INFINITY, f64::INFINITY),
            centre_sum_um: [0.0; 2],
        });
        way.add(arc);
        for [x, y] in samples {
            let radial_mm = (x * x + y * y).sqrt() - arc.circle.radius_mm;
            way.profile.take(libm::atan2(y, x), radial_mm * 1e3);
        }
    }

    /// What the circles show: those with both directions, and those with one that was measured nearly all round. `lead_mm`
    /// gives the lead of an axis of the program's coordinates; none where coordinates are not axes.
    pub fn finish(self, lead_mm: impl Fn(usize) -> Option<f64>) -> Vec<BallBar> {
        let circles = self.circles.into_iter();
        circles
            .filter(|(_, ways)| match ways {
                [Some(_), Some(_)] => true,
                [Some(way), None] | [None, Some(way)] => way.is_diagnosed(),
                [None, None] => false,
            })
            .map(|(circle, ways)| {
                let leads = circle.plane.map(&lead_mm);
                together(circle, &ways, leads)
            })
            .collect()
    }
}

impl Way {
    fn add(&mut self, arc: &ArcResult) {
        self.runs += 1;
        self.speed_mm_s = self.speed_mm_s.max(arc.speed_mm_s);
        self.circular_um = self.circular_um.max(arc.table.circular_um);
        self.radial_um.0 = self.radial_um.0.max(arc.table.radial_um.0);
        self.radial_um.1 = self.radial_um.1.min(arc.table.radial_um.1);
        for (sum_um, mm) in self.centre_sum_um.iter_mut().zip(arc.table.fit.centre_mm) {
            *sum_um += mm * 1e3;
        }
    }

    /// Whether enough of a turn was measured for causes to be told apart.
    fn is_diagnosed(&self) -> bool {
        self.profile.measured_deg() >= DIAGNOSED_DEG_MIN
    }

    fn centre_um(&self) -> [f64; 2] {
        self.centre_sum_um
            .map(|sum_um| sum_um / f64::from(self.runs.max(1)))
    }

    fn result(&self) -> OneWay {
        OneWay {
            line: self.line,
            runs: self.runs,
            measured_deg: self.profile.measured_deg(),
            circular_um: self.circular_um,
            radial_um: self.radial_um,
        }
    }
}

fn together(circle: Circle, ways: &[Option<Way>; 2], leads_mm: [Option<f64>; 2]) -> BallBar {
    let [one, other] = ways;
    let known = || ways.iter().flatten();
    let count = known().count().max(1) as f64;
    let centres = known().map(Way::centre_um);
    let centre_um = centres.fold([0.0; 2], |sum, [x_um, y_um]| {
        [sum[0] + x_um / count, sum[1] + y_um / count]
    });
    let both = one.as_ref().zip(other.as_ref());
    let bidirectional_um = both.map(|(one, other)| {
        let [range, of_other] = [one, other].map(|way| way.profile.range_um(centre_um));
        range.1.max(of_other.1) - range.0.min(of_other.0)
    });
    let hysteresis =
        both.and_then(|(one, other)| profile::hysteresis(&one.profile, &other.profile));
    let speed_mm_s = known().map(|way| way.speed_mm_s).fold(0.0, f64::max);
    let angular_speed_rad_s = speed_mm_s / circle.radius_mm;
    let [first, second] = leads_mm;
    let leads_mm = first.zip(second);
    let leads_mm = leads_mm.filter(|_| known().all(Way::is_diagnosed));
    let diagnosis = leads_mm.and_then(|(first_mm, second_mm)| {
        let setting = Setting {
            radius_mm: circle.radius_mm,
            centre_mm: circle.centre_mm,
            angular_speed_rad_s,
            window_rad: window_rad(angular_speed_rad_s),
            lead_mm: [first_mm, second_mm],
        };
        let signs = [1.0, -1.0].into_iter().zip(ways);
        let directions = signs.filter_map(|(sign, way)| {
            let readings = way.as_ref()?.profile.readings();
            Some((sign, readings.collect::<Vec<_>>()))
        });
        let directions: Vec<_> = directions.collect();
        let readings = directions.iter();
        let readings: Vec<_> = readings
            .map(|(sign, all)| (*sign, all.as_slice()))
            .collect();
        diagnose(&setting, &readings)
    });
    BallBar {
        counter_clockwise: one.as_ref().map(Way::result),
        clockwise: other.as_ref().map(Way::result),
        centre_um,
        bidirectional_um,
        hysteresis,
        diagnosis,
        circle,
    }
}
