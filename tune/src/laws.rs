//! Settings from what was found, each by a stated law (docs/methods/tuning.md).

use machine::DriveMode;

use super::identify::{BREAK_UM, ELEMENTS, Found, Friction};

/// Bandwidth of the velocity loop, in rad/s: Kv = M·300.
const VELOCITY_BANDWIDTH_RAD_S: f64 = 300.0;
/// Ti, in ms: three times the velocity loop's own 1/300 s.
pub const INTEGRAL_TIME_MS: f64 = 10.0;
/// Kp, in 1/s: a sixth of the velocity loop's bandwidth, no overshoot.
pub const POSITION_GAIN_PER_S: f64 = 50.0;
/// Time constant of the current loop, in s: 1/(2π·1000 Hz).
const CURRENT_LOOP_S: f64 = 0.16e-3;
/// The gap is crossed in no less time, in ms: faster, the motor's own inertia makes a bump.
const TRAVERSAL_MS_MIN: f64 = 2.0;

/// Kv, in N·s/m.
pub fn velocity_gain_n_s_per_m(mass_kg: f64) -> f64 {
    VELOCITY_BANDWIDTH_RAD_S * mass_kg
}

/// Advance of the feed-forward, in ms: one scan of transport, half a scan of hold, one because it is centred that far back,
/// and the current loop.
pub fn advance_ms(scan_s: f64) -> f64 {
    (2.5 * scan_s + CURRENT_LOOP_S) * 1e3
}

/// The same where the torque of the acceleration is fed forward: the velocity loop then has no lag to be made up for, and the
/// speed command only has to fit the speed that the loop measures. A drive measures it over its last period Td, on average Td
/// before the middle of the scan: 2.5 scans − Td. A servo that closes the loop itself (torque mode) compares it at once with
/// the speed over its last scan: half a scan. Measured: a circle R10 F10000 is then true to size within 3 µm; 0.1 ms too much
/// makes it 5 µm smaller (v²/R · 0.1 ms / Kp).
pub fn advance_with_torque_ms(scan_s: f64, drive_mode: DriveMode, drive_period_s: f64) -> f64 {
    1e3 * match drive_mode {
        DriveMode::Velocity => 2.5 * scan_s - drive_period_s,
        DriveMode::Torque => 0.5 * scan_s,
    }
}

/// Bandwidth of the disturbance observer, in rad/s: 200 where the way round (2.5 scans) takes at most 0.15 of its time
/// constant; on longer scans it swings more than it observes, and is off. Measured: docs/methods/disturbance-observer.md.
pub fn observer_rad_s(scan_s: f64) -> f64 {
    const BANDWIDTH_RAD_S: f64 = 200.0;
    if 2.5 * scan_s * BANDWIDTH_RAD_S <= 0.15 {
        BANDWIDTH_RAD_S
    } else {
        0.0
    }
}

/// Time in which the backlash is traversed, in ms.
pub fn traversal_ms(scan_s: f64) -> f64 {
    (3.0 * scan_s * 1e3).max(TRAVERSAL_MS_MIN)
}

/// Height of the decaying friction pulse, in mm/s: 2F/Kv, so that the velocity loop puts out 2F.
pub fn pulse_mm_s(found: &Found) -> f64 {
    2.0 * found.coulomb_n() / velocity_gain_n_s_per_m(found.mass_kg()) * 1e3
}

/// Lead of the friction pulse, in ms: the velocity loop, the current loop, one scan of transport, one of quantisation.
pub fn lead_ms(scan_s: f64) -> f64 {
    (1.0 / VELOCITY_BANDWIDTH_RAD_S + CURRENT_LOOP_S + 2.0 * scan_s) * 1e3
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
