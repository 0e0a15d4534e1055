//! Settings from what was found, each by a stated law (docs/methods/tuning.md).

use machine::{Axis, DriveMode, Machine};

use super::identify::{BREAK_UM, ELEMENTS, Found, Friction};

/// Bandwidth of the velocity loop, in rad/s: Kv = M·300.
const VELOCITY_BANDWIDTH_RAD_S: f64 = 300.0;
/// Ti, in ms: three times the velocity loop's own 1/300 s.
const INTEGRAL_TIME_MS: f64 = 10.0;
/// Kp, in 1/s: a sixth of the velocity loop's bandwidth, no overshoot.
const POSITION_GAIN_PER_S: f64 = 50.0;
/// Time constant of the current loop, in s: 1/(2π·1000 Hz).
pub const CURRENT_LOOP_S: f64 = 0.16e-3;
/// The gap is traversed in no less time, in ms: faster, the motor's own inertia makes a bump.
const TRAVERSAL_MS_MIN: f64 = 2.0;
/// Phase that the way of a command may cost at the bandwidth of a velocity loop that is closed over it, in rad, before the
/// bandwidth comes down.
const VELOCITY_PHASE_MAX_RAD: f64 = 0.45;

/// What the clocks of the cell and the drives of an axis make of every law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Tp, in s.
    pub scan_s: f64,
    /// D: scans from the feedback that a command answers to the scan that it acts in.
    pub dead_time_scans: f64,
    /// Which loops the drive closes.
    pub drive_mode: DriveMode,
    /// Period Td of a drive that closes it, in s.
    pub drive_period_s: f64,
}

impl Timing {
    /// Of an axis.
    pub fn of(machine: &Machine, axis: &Axis) -> Timing {
        Timing {
            scan_s: machine.scan_period_s(),
            // A drive that closes the position loop gets position and all that goes with it together.
            dead_time_scans: match axis.drive_mode {
                DriveMode::Velocity | DriveMode::Torque => machine.scan.dead_time_scans.into(),
                DriveMode::Position => 0.0,
            },
            drive_mode: axis.drive_mode,
            drive_period_s: f64::from(axis.velocity_loop.period_us) * 1e-6,
        }
    }

    /// The way of a command, in scans: the dead time, half a scan of hold, and one because speeds are centred that far back.
    pub fn way_scans(&self) -> f64 {
        self.dead_time_scans + 1.5
    }

    fn with_one_scan(&self) -> Timing {
        Timing {
            dead_time_scans: 1.0,
            ..*self
        }
    }

    /// Bandwidth of the velocity loop, in rad/s. A drive closes it by itself: 300. A servo closes it over the way of a command
    /// (torque mode): 300 as long as that costs 0.45 rad of phase there, less on a longer way; never less than what costs the
    /// phase that 300 cost with a dead time of one scan.
    pub fn velocity_bandwidth_rad_s(&self) -> f64 {
        if self.drive_mode != DriveMode::Torque {
            return VELOCITY_BANDWIDTH_RAD_S;
        }
        let phase_rad =
            |timing: &Timing| timing.way_scans() * timing.scan_s * VELOCITY_BANDWIDTH_RAD_S;
        let most_rad = phase_rad(&self.with_one_scan()).max(VELOCITY_PHASE_MAX_RAD);
        VELOCITY_BANDWIDTH_RAD_S * (most_rad / phase_rad(self)).min(1.0)
    }

    /// Kv, in N·s/m.
    pub fn velocity_gain_n_s_per_m(&self, mass_kg: f64) -> f64 {
        self.velocity_bandwidth_rad_s() * mass_kg
    }

    /// Ti, in ms: three times the velocity loop's own time constant.
    pub fn integral_time_ms(&self) -> f64 {
        INTEGRAL_TIME_MS * (VELOCITY_BANDWIDTH_RAD_S / self.velocity_bandwidth_rad_s())
    }

    /// Kp, in 1/s: 50 with a dead time of one scan. With a longer one less, so that Kp times the delay of its loop (velocity loop
    /// and way of a command) stays the same: no overshoot either.
    pub fn position_gain_per_s(&self) -> f64 {
        let delay_s = |timing: &Timing| {
            1.0 / timing.velocity_bandwidth_rad_s() + timing.way_scans() * timing.scan_s
        };
        POSITION_GAIN_PER_S * (delay_s(&self.with_one_scan()) / delay_s(self))
    }

    /// Advance of the feed-forward, in ms: the way of a command and the current loop.
    pub fn advance_ms(&self) -> f64 {
        (self.way_scans() * self.scan_s + CURRENT_LOOP_S) * 1e3
    }

    /// The same where the torque of the acceleration is fed forward: the velocity loop then has no lag to be made up for, and the
    /// speed command only has to fit the speed that the loop measures. A drive measures it over its last period Td, on average Td
    /// before the middle of the scan: the way of a command less Td. A servo that closes the loop itself (torque mode) compares it
    /// at once with the speed over its last scan: half a scan, whatever the dead time is. A drive that closes the position loop gets
    /// position and speed together: the one scan that speeds are centred back. Measured: a circle R10 F10000 is then
    /// true to size within 3 µm; 0.1 ms too much makes it 5 µm smaller (v²/R · 0.1 ms / Kp).
    pub fn advance_with_torque_ms(&self) -> f64 {
        1e3 * match self.drive_mode {
            DriveMode::Velocity => self.way_scans() * self.scan_s - self.drive_period_s,
            DriveMode::Torque => 0.5 * self.scan_s,
            DriveMode::Position => self.scan_s,
        }
    }

    /// Bandwidth of the disturbance observer, in rad/s: 200 where the way of a command takes at most 0.15 of its time constant
    /// with a dead time of one scan (2.5 scans); on longer scans it swings more than it observes, and is off. With a longer
    /// dead time less, so that the way is the same part of its time constant. Measured: docs/methods/disturbance-observer.md.
    pub fn observer_rad_s(&self) -> f64 {
        const BANDWIDTH_RAD_S: f64 = 200.0;
        let one = self.with_one_scan().way_scans();
        if one * self.scan_s * BANDWIDTH_RAD_S <= 0.15 {
            BANDWIDTH_RAD_S * (one / self.way_scans()).min(1.0)
        } else {
            0.0
        }
    }

    /// Height of the decaying friction pulse, in mm/s: 2F/Kv, so that the velocity loop puts out 2F.
    pub fn pulse_mm_s(&self, found: &Found) -> f64 {
        2.0 * found.coulomb_n() / self.velocity_gain_n_s_per_m(found.mass_kg()) * 1e3
    }

    /// Lead of the friction pulse, in ms: the velocity loop, the current loop, the dead time, one scan of quantisation.
    pub fn lead_ms(&self) -> f64 {
        let loop_s = 1.0 / self.velocity_bandwidth_rad_s();
        (loop_s + CURRENT_LOOP_S + (self.dead_time_scans + 1.0) * self.scan_s) * 1e3
    }
}

/// Largest deviation, in µm, that a step of this force leaves on an axis of this mass under the loops by law:
/// `M·x'' = F − M·ω·(1 + 1/(Ti·s))·(x' + Kp·x)`, ω = 300 rad/s. What a model is short of shows so at a reversal.
pub fn deviation_um(force_n: f64, mass_kg: f64) -> f64 {
    const STEP_S: f64 = 1e-4;
    const STEPS: u32 = 500;
    let (mut place_m, mut speed_m_s, mut sum_m, mut most_m) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for _ in 0..STEPS {
        let off_m_s = speed_m_s + POSITION_GAIN_PER_S * place_m;
        sum_m += off_m_s * STEP_S;
        let held = VELOCITY_BANDWIDTH_RAD_S * (off_m_s + sum_m / (INTEGRAL_TIME_MS * 1e-3));
        speed_m_s += STEP_S * (force_n / mass_kg - held);
        place_m += STEP_S * speed_m_s;
        most_m = most_m.max(place_m.abs());
    }
    most_m * 1e6
}

/// Time in which the backlash is traversed, in ms.
pub fn traversal_ms(scan_s: f64) -> f64 {
    (3.0 * scan_s * 1e3).max(TRAVERSAL_MS_MIN)
}

/// Distance of an exponential that turns friction round with the same lag: Σ F_i·Δ_i/Σ F_i, in µm.
pub fn presliding_um(found: &Found) -> f64 {
    let moment = |friction: &Friction| -> f64 {
        let pairs = friction.element_n.iter().zip(BREAK_UM);
        pairs.map(|(force_n, break_um)| force_n * break_um).sum()
    };
    let table = found.table.map_or(0.0, |t| moment(&t.friction));
    (moment(&found.motor) + table) / found.coulomb_n()
}

/// Shares of a curve, rounded so that their sum is 1 to the last digit written.
pub fn shares(friction: &Friction) -> [f64; ELEMENTS] {
    let coulomb_n = friction.coulomb_n();
    let mut shares = friction
        .element_n
        .map(|force_n| libm::round(force_n / coulomb_n * 1e4) / 1e4);
    let largest = (0..ELEMENTS).max_by(|a, b| shares[*a].total_cmp(&shares[*b]));
    if let Some(largest) = largest {
        let rest: f64 = shares.iter().sum::<f64>() - shares[largest];
        shares[largest] = libm::round((1.0 - rest) * 1e4) / 1e4;
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(scan_us: u32, dead_time_scans: f64, drive_mode: DriveMode) -> Timing {
        let scan_s = f64::from(scan_us) * 1e-6;
        Timing {
            scan_s,
            dead_time_scans,
            drive_mode,
            drive_period_s: match drive_mode {
                DriveMode::Velocity | DriveMode::Position => 250e-6_f64.min(0.5 * scan_s),
                DriveMode::Torque => scan_s,
            },
        }
    }

    /// The numbers that the shipped files were tuned to: to the bit, whatever the scan is.
    #[test]
    fn with_a_dead_time_of_one_scan_every_law_is_what_it_was_before_there_was_another() {
        for scan_us in [125, 250, 500, 1000, 2000] {
            for mode in [DriveMode::Velocity, DriveMode::Torque, DriveMode::Position] {
                let timing = timing(scan_us, 1.0, mode);
                let scan_s = timing.scan_s;
                assert_eq!(timing.velocity_bandwidth_rad_s(), 300.0);
                assert_eq!(timing.integral_time_ms(), 10.0);
                assert_eq!(timing.position_gain_per_s(), 50.0);
                assert_eq!(timing.advance_ms(), (2.5 * scan_s + 0.16e-3) * 1e3);
                let with_torque_s = match mode {
                    DriveMode::Velocity => 2.5 * scan_s - timing.drive_period_s,
                    DriveMode::Torque => 0.5 * scan_s,
                    DriveMode::Position => scan_s,
                };
                assert_eq!(timing.advance_with_torque_ms(), 1e3 * with_torque_s);
                assert_eq!(
                    timing.lead_ms(),
                    (1.0 / 300.0 + 0.16e-3 + 2.0 * scan_s) * 1e3
                );
                let observes = 2.5 * scan_s * 200.0 <= 0.15;
                assert_eq!(timing.observer_rad_s(), if observes { 200.0 } else { 0.0 });
            }
        }
    }

    #[test]
    fn each_scan_of_dead_time_takes_feed_forward_and_pulse_one_scan_further_ahead() {
        for scan_us in [250, 1000] {
            let ms = f64::from(scan_us) * 1e-3;
            for scans in 1..8 {
                let near = timing(scan_us, f64::from(scans), DriveMode::Velocity);
                let far = timing(scan_us, f64::from(scans + 1), DriveMode::Velocity);
                for law in [
                    Timing::advance_ms,
                    Timing::advance_with_torque_ms,
                    Timing::lead_ms,
                ] {
                    assert!((law(&far) - law(&near) - ms).abs() < 1e-9);
                }
            }
        }
        // A servo that closes the velocity loop itself compares at once, whatever is on its way.
        let torque = |scans| timing(250, scans, DriveMode::Torque).advance_with_torque_ms();
        assert_eq!(torque(4.0), torque(1.0));
    }

    #[test]
    fn gains_come_down_with_the_dead_time_of_the_loop_that_is_closed_over_it() {
        for scan_us in [125, 250, 1000] {
            for mode in [DriveMode::Velocity, DriveMode::Torque] {
                let at = |scans| timing(scan_us, scans, mode);
                for scans in 1..8 {
                    let (near, far) = (at(f64::from(scans)), at(f64::from(scans + 1)));
                    assert!(far.position_gain_per_s() < near.position_gain_per_s());
                    assert!(far.velocity_bandwidth_rad_s() <= near.velocity_bandwidth_rad_s());
                    // Kp times the delay of its loop is what it is with one scan.
                    let delay = |t: &Timing| {
                        t.position_gain_per_s()
                            * (1.0 / t.velocity_bandwidth_rad_s() + t.way_scans() * t.scan_s)
                    };
                    assert!((delay(&far) - delay(&at(1.0))).abs() < 1e-12);
                }
            }
        }
        // The drive's own loop does not wait for the bus; the servo's does: 5.5 scans of 0.25 ms cost 0.41 rad at 300 rad/s, 9.5 cost 0.71.
        let bandwidth = |scans, mode| timing(250, scans, mode).velocity_bandwidth_rad_s();
        assert_eq!(bandwidth(8.0, DriveMode::Velocity), 300.0);
        assert_eq!(bandwidth(4.0, DriveMode::Torque), 300.0);
        assert!((bandwidth(8.0, DriveMode::Torque) - 300.0 * 0.45 / 0.7125).abs() < 1e-9);
    }

    #[test]
    fn the_observer_is_off_on_long_scans_and_slower_with_a_longer_dead_time() {
        let observer =
            |scan_us, scans| timing(scan_us, scans, DriveMode::Velocity).observer_rad_s();
        assert_eq!((observer(1000, 1.0), observer(1000, 4.0)), (0.0, 0.0));
        assert_eq!(observer(250, 1.0), 200.0);
        assert!((observer(250, 2.0) - 200.0 * 2.5 / 3.5).abs() < 1e-9);
        assert!((observer(250, 4.0) - 200.0 * 2.5 / 5.5).abs() < 1e-9);
    }
}
