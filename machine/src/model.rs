//! What an axis has to move: the controller's own model of its mechanics, and what is made of it.

use serde::Deserialize;

use super::{Axis, ReversalMethod};
use crate::settings_file::{At, From, Rules};

/// Most slip elements of a friction curve.
pub const SLIP_ELEMENTS_MAX: usize = 6;
/// Highest bandwidth of a disturbance observer, as a phase of the scan: g·Tp at most this.
const OBSERVER_PHASE_MAX_RAD: f64 = 0.2;

/// Mass, friction and elasticity of one axis as felt at the table. Optional in the machine file; methods that reckon with
/// torque need it. `quadrant tune` identifies it.
///
/// Rotary axes use the same keys with a thousand degrees in place of the metre.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisModel {
    /// Total moved mass: motor and screw (inertia · (2π/lead)²) and table, in kg.
    pub mass_kg: f64,
    /// Coulomb friction of motor and table together, in N.
    pub coulomb_n: f64,
    /// Viscous friction of motor and table together, in N·s/m.
    #[serde(default)]
    pub viscous_n_s_per_m: f64,
    /// How the motor's friction turns round over distance; the table's as well where it has no curve of its own.
    pub friction: Option<FrictionCurve>,
    /// The table's part of it all, and how it is coupled.
    pub table: Option<TableModel>,
}

/// The table behind the screw.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableModel {
    /// Its mass, in kg.
    pub mass_kg: f64,
    /// Its Coulomb friction, in N.
    pub coulomb_n: f64,
    /// Its viscous friction, in N·s/m.
    #[serde(default)]
    pub viscous_n_s_per_m: f64,
    /// Stiffness of screw and nut, in N/µm.
    pub stiffness_n_per_um: f64,
    /// Gap between motor and table, in µm.
    pub gap_um: f64,
    /// Time in which the gap is crossed, in ms.
    pub crossing_ms: f64,
    /// Its own friction curve.
    pub friction: Option<FrictionCurve>,
}

/// Friction over distance: springs side by side that slip (Maxwell slip elements), and the Stribeck curve.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrictionCurve {
    /// Share of each element in Coulomb friction; the sum is 1.
    pub share: [f64; SLIP_ELEMENTS_MAX],
    /// Distance over which each is wound up from rest until it slips, in µm.
    pub break_um: [f64; SLIP_ELEMENTS_MAX],
    /// Break-away friction over Coulomb friction.
    pub static_ratio: f64,
    /// Stribeck velocity, in mm/s.
    pub stribeck_mm_s: f64,
}

/// Torque that is fed forward, part by part.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorqueFeedForward {
    /// Mass times acceleration.
    #[serde(default)]
    pub acceleration: bool,
    /// Viscous friction.
    #[serde(default)]
    pub viscous: bool,
    /// Friction over the distance since the reversal.
    #[serde(default)]
    pub friction: bool,
    /// Time by which the force lags behind the torque command, in ms: 1/(2π · 1000 Hz) of a usual current loop.
    #[serde(default = "current_loop_ms")]
    pub current_loop_ms: f64,
}

fn current_loop_ms() -> f64 {
    0.16
}

impl Default for TorqueFeedForward {
    fn default() -> Self {
        TorqueFeedForward {
            acceleration: false,
            viscous: false,
            friction: false,
            current_loop_ms: current_loop_ms(),
        }
    }
}

/// Disturbance observer.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct DisturbanceObserver {
    /// Bandwidth g, in rad/s; 0 switches it off.
    pub bandwidth_rad_s: f64,
}

impl Default for TableModel {
    /// No table apart from the motor: the axis is one mass, with a screw that does not give.
    fn default() -> Self {
        TableModel {
            mass_kg: 0.0,
            coulomb_n: 0.0,
            viscous_n_s_per_m: 0.0,
            stiffness_n_per_um: 1e6,
            gap_um: 0.0,
            crossing_ms: 3.0,
            friction: None,
        }
    }
}

impl Default for FrictionCurve {
    /// Friction that turns round at once.
    fn default() -> Self {
        FrictionCurve {
            share: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            break_um: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
            static_ratio: 1.0,
            stribeck_mm_s: 1.0,
        }
    }
}

impl TorqueFeedForward {
    /// Whether any part is on.
    pub fn any(&self) -> bool {
        self.acceleration || self.viscous || self.friction
    }
}

impl Axis {
    /// Force at the table that the motor's continuous torque makes: T·2π/lead, in N.
    pub fn rated_force_n(&self) -> f64 {
        self.motor.rated_torque_nm * std::f64::consts::TAU / (self.lead_mm * 1e-3)
    }
}

/// Checks the model of one axis, if it has one, and what is asked of it.
pub(super) fn judge(rules: &mut Rules, axis: &Axis, at: At, scan_s: f64) {
    judge_use(rules, axis, at, scan_s);
    let Some(model) = &axis.model else { return };
    let at_least_0 = From::AtLeast(0.0);
    for (key, value, unit, from, high) in [
        ("mass_kg", model.mass_kg, "kg", From::Above(0.0), 1e6),
        ("coulomb_n", model.coulomb_n, "N", at_least_0, 1e6),
        (
            "viscous_n_s_per_m",
            model.viscous_n_s_per_m,
            "N·s/m",
            at_least_0,
            1e7,
        ),
    ] {
        rules.range(&["model", key], at, value, unit, from, high);
    }
    let rated_n = axis.rated_force_n();
    if model.coulomb_n >= rated_n {
        rules.say(
            &["model", "coulomb_n"],
            at,
            &format!(
                "= {} N: must be below {rated_n:.0} N, the force of rated_torque_nm = {} N·m on a lead of {} mm",
                model.coulomb_n, axis.motor.rated_torque_nm, axis.lead_mm
            ),
        );
    }
    if let Some(curve) = &model.friction {
        judge_curve(rules, curve, &["model", "friction"], at);
    }
    let Some(table) = &model.table else { return };
    let above_0 = From::Above(0.0);
    for (key, value, unit, from, high) in [
        ("mass_kg", table.mass_kg, "kg", above_0, model.mass_kg),
        (
            "coulomb_n",
            table.coulomb_n,
            "N",
            at_least_0,
            model.coulomb_n,
        ),
        (
            "viscous_n_s_per_m",
            table.viscous_n_s_per_m,
            "N·s/m",
            at_least_0,
            model.viscous_n_s_per_m,
        ),
        (
            "stiffness_n_per_um",
            table.stiffness_n_per_um,
            "N/µm",
            above_0,
            1e6,
        ),
        ("gap_um", table.gap_um, "µm", at_least_0, 1000.0),
        (
            "crossing_ms",
            table.crossing_ms,
            "ms",
            From::AtLeast(2.0 * scan_s * 1e3),
            100.0,
        ),
    ] {
        rules.range(&["model", "table", key], at, value, unit, from, high);
    }
    if let Some(curve) = &table.friction {
        judge_curve(rules, curve, &["model", "table", "friction"], at);
    }
}

/// What the axis makes use of must be known of it.
fn judge_use(rules: &mut Rules, axis: &Axis, at: At, scan_s: f64) {
    let crosses = axis.reversal.method == ReversalMethod::ContactForce;
    if crosses && axis.model.is_none_or(|model| model.table.is_none()) {
        rules.say(
            &["reversal", "method"],
            at,
            "= \"contact-force\": needs [axis.model] and [axis.model.table]; `quadrant tune` identifies them",
        );
    }
    let torque = &axis.torque_feed_forward;
    rules.between(
        &["torque_feed_forward", "current_loop_ms"],
        at,
        torque.current_loop_ms,
        "ms",
        0.0,
        0.9 * scan_s * 1e3,
    );
    if torque.any() && axis.model.is_none() {
        let key = if torque.acceleration {
            "acceleration"
        } else if torque.viscous {
            "viscous"
        } else {
            "friction"
        };
        rules.say(
            &["torque_feed_forward", key],
            at,
            "= true: needs [axis.model]; `quadrant tune` identifies it",
        );
    }
    if torque.friction && axis.reversal.method == ReversalMethod::Kick {
        rules.say(
            &["torque_feed_forward", "friction"],
            at,
            "= true: the kick of reversal.method = \"kick\" makes up for the same friction; use \"backlash\" or \
             \"contact-force\"",
        );
    }
    let bandwidth_rad_s = axis.disturbance_observer.bandwidth_rad_s;
    let key = ["disturbance_observer", "bandwidth_rad_s"];
    rules.range(
        &key,
        at,
        bandwidth_rad_s,
        "rad/s",
        From::AtLeast(0.0),
        OBSERVER_PHASE_MAX_RAD / scan_s,
    );
    if bandwidth_rad_s > 0.0 && axis.model.is_none() {
        rules.say(
            &key,
            at,
            &format!(
                "= {bandwidth_rad_s} rad/s: needs [axis.model]; `quadrant tune` identifies it"
            ),
        );
    }
}

fn judge_curve(rules: &mut Rules, curve: &FrictionCurve, table: &[&str], at: At) {
    let key = |name: &'static str| -> Vec<&str> { table.iter().copied().chain([name]).collect() };
    let sum: f64 = curve.share.iter().sum();
    if !curve.share.iter().all(|share| (0.0..=1.0).contains(share))
        || !((1.0 - 1e-6)..=(1.0 + 1e-6)).contains(&sum)
    {
        rules.say(
            &key("share"),
            at,
            &format!("= {:?}: each must be 0 to 1 and the sum 1", curve.share),
        );
    }
    let mut pairs = curve.share.iter().zip(&curve.break_um);
    if !pairs.all(|(share, um)| (0.0..=10_000.0).contains(um) && (*share == 0.0 || *um >= 0.01)) {
        rules.say(
            &key("break_um"),
            at,
            &format!(
                "= {:?} µm: each must be 0.01 to 10000 µm where its share is not 0",
                curve.break_um
            ),
        );
    }
    rules.range(
        &key("static_ratio"),
        at,
        curve.static_ratio,
        "",
        From::AtLeast(1.0),
        10.0,
    );
    rules.range(
        &key("stribeck_mm_s"),
        at,
        curve.stribeck_mm_s,
        "mm/s",
        From::Above(0.0),
        1000.0,
    );
}
