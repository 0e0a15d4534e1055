//! Rules of `[axis.model]`, and of what is computed from it.

use crate::axis::Axis;
use crate::machine::Machine;
use crate::model::{Adaptation, AdaptationMode, AxisModel, FrictionCurve, TableModel};
use crate::reversal::ReversalMethod;
use crate::settings_file::{At, From, Rules};

/// Highest bandwidth of a disturbance observer, as a phase of the scan: g·Tp at most this.
const OBSERVER_PHASE_MAX_RAD: f64 = 0.2;
/// Longest lag of the current loop, in scans.
const CURRENT_LOOP_SCANS_MAX: f64 = 0.9;
/// Shortest traversal of the backlash, in scans.
const TRAVERSAL_SCANS_MIN: f64 = 2.0;

pub fn judge(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    let scan_s = machine.scan_period_s();
    torque(rules, axis, at, scan_s);
    observer(rules, axis, at, scan_s);
    adaptation(rules, axis, at);
    let traverses = axis.reversal.method == ReversalMethod::ContactForce;
    if traverses && axis.model.is_none_or(|model| model.table.is_none()) {
        let what = "= \"contact-force\": needs [axis.model] and [axis.model.table]; `quadrant tune` identifies them";
        rules.say(&["reversal", "method"], at, what);
    }
    let Some(model) = &axis.model else { return };
    let rated_n = axis.rated_force_n();
    if model.coulomb_n >= rated_n {
        let what = format!(
            "= {} N: must be below {rated_n:.0} N, the force of rated_torque_nm = {} N·m on a lead of {} mm",
            model.coulomb_n, axis.motor.rated_torque_nm, axis.lead_mm
        );
        rules.say(&["model", "coulomb_n"], at, &what);
    }
    if let Some(friction) = &model.friction {
        curve(rules, friction, &["model", "friction"], at);
    }
    if let Some(behind) = &model.table {
        table(rules, model, behind, at, scan_s);
    }
}

/// The table has no more than the whole axis.
fn table(rules: &mut Rules<'_>, whole: &AxisModel, table: &TableModel, at: At<'_>, scan_s: f64) {
    let path = |key| ["model", "table", key];
    rules.range(
        &path("mass_kg"),
        at,
        table.mass_kg,
        "kg",
        From::Above(0.0),
        whole.mass_kg,
    );
    rules.between(
        &path("coulomb_n"),
        at,
        table.coulomb_n,
        "N",
        0.0,
        whole.coulomb_n,
    );
    let (viscous, most) = (table.viscous_n_s_per_m, whole.viscous_n_s_per_m);
    rules.between(&path("viscous_n_s_per_m"), at, viscous, "N·s/m", 0.0, most);
    let least_ms = TRAVERSAL_SCANS_MIN * scan_s * 1e3;
    rules.between(
        &path("traversal_ms"),
        at,
        table.traversal_ms,
        "ms",
        least_ms,
        100.0,
    );
    if let Some(friction) = &table.friction {
        curve(rules, friction, &["model", "table", "friction"], at);
    }
}

/// Torque that is fed forward is known.
fn torque(rules: &mut Rules<'_>, axis: &Axis, at: At<'_>, scan_s: f64) {
    let torque = &axis.torque_feed_forward;
    let most_ms = CURRENT_LOOP_SCANS_MAX * scan_s * 1e3;
    let path = ["torque_feed_forward", "current_loop_ms"];
    rules.between(&path, at, torque.current_loop_ms, "ms", 0.0, most_ms);
    let parts = [
        ("acceleration", torque.acceleration),
        ("viscous", torque.viscous),
        ("friction", torque.friction),
    ];
    let first = parts.iter().find(|(_, on)| *on);
    if let (Some((key, _)), None) = (first, &axis.model) {
        let what = "= true: needs [axis.model]; `quadrant tune` identifies it";
        rules.say(&["torque_feed_forward", key], at, what);
    }
    if torque.friction && axis.reversal.method == ReversalMethod::FrictionPulse {
        let what = "= true: the pulse of reversal.method = \"friction-pulse\" makes up for the same friction; use \"backlash\" or \
                    \"contact-force\"";
        rules.say(&["torque_feed_forward", "friction"], at, what);
    }
}

/// The disturbance observer is slow beside the scan, and knows the mass.
fn observer(rules: &mut Rules<'_>, axis: &Axis, at: At<'_>, scan_s: f64) {
    let bandwidth_rad_s = axis.disturbance_observer.bandwidth_rad_s;
    let path = ["disturbance_observer", "bandwidth_rad_s"];
    let most_rad_s = OBSERVER_PHASE_MAX_RAD / scan_s;
    rules.between(&path, at, bandwidth_rad_s, "rad/s", 0.0, most_rad_s);
    if bandwidth_rad_s > 0.0 && axis.model.is_none() {
        let what =
            format!("= {bandwidth_rad_s} rad/s: needs [axis.model]; `quadrant tune` identifies it");
        rules.say(&path, at, &what);
    }
}

/// Friction that is followed is known and fed forward; a level that nobody goes by is refused.
fn adaptation(rules: &mut Rules<'_>, axis: &Axis, at: At<'_>) {
    let Adaptation { mode, level } = axis.adaptation;
    if mode == AdaptationMode::Off {
        if level != 1.0 {
            let what = format!("= {level}: needs adaptation.mode = \"on\" or \"frozen\"");
            rules.say(&["adaptation", "level"], at, &what);
        }
    } else if axis.model.is_none() || !axis.torque_feed_forward.friction {
        let what = ": needs [axis.model] and torque_feed_forward.friction = true; `quadrant tune` sets them";
        rules.say(&["adaptation", "mode"], at, what);
    }
}

/// Shares sum to 1, and a share has a distance.
fn curve(rules: &mut Rules<'_>, curve: &FrictionCurve, table: &[&str], at: At<'_>) {
    let key = |name: &'static str| -> Vec<&str> { table.iter().copied().chain([name]).collect() };
    let sum: f64 = curve.share.iter().sum();
    if !((1.0 - 1e-6)..=(1.0 + 1e-6)).contains(&sum) {
        let what = format!("= {:?}: each must be 0 to 1 and the sum 1", curve.share);
        rules.say(&key("share"), at, &what);
    }
    let mut pairs = curve.share.iter().zip(&curve.break_um);
    if !pairs.all(|(share, um)| *share == 0.0 || *um >= 0.01) {
        let what = format!(
            "= {:?} µm: each must be 0.01 to 10000 µm where its share is not 0",
            curve.break_um
        );
        rules.say(&key("break_um"), at, &what);
    }
}
