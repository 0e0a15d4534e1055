//! Rules of weight and brake.

use crate::axis::Axis;
use crate::machine::Machine;
use crate::settings_file::{At, Rules};

/// The weight is said once, the motor can hold it, and one motor does.
pub fn judge(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    two_motors(rules, machine, axis, at);
    let Some(gravity) = &axis.gravity else {
        return;
    };
    if gravity.force_n.is_some() == gravity.mass_kg.is_some() {
        let what = "needs one of force_n and mass_kg";
        rules.say(&["gravity"], at, what);
    }
    if gravity.force_n.is_some() && gravity.counterbalance_n != 0.0 {
        let what = "goes with mass_kg: force_n is what is left";
        rules.say(&["gravity", "counterbalance_n"], at, what);
    }
    let (weight_nm, rated_nm) = (axis.weight_nm().abs(), axis.motor.rated_torque_nm);
    if weight_nm > rated_nm {
        let what = format!(
            "pulls with {:.0} N, {weight_nm:.3} N·m at the motor: must be at most motor.rated_torque_nm = {rated_nm} N·m",
            axis.weight_n().abs()
        );
        rules.say(&["gravity"], at, &what);
    }
}

/// Two motors that share an axis are let go to relax their bridge: they would drop a weight, and brakes would not let them relax.
fn two_motors(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    let leads = |of: &Axis| of.gantry.as_ref().is_some_and(|of| of.leader == axis.name);
    if !axis.is_follower() && !machine.axes.iter().any(leads) {
        return;
    }
    for (table, is_there) in [
        ("gravity", axis.gravity.is_some()),
        ("brake", axis.brake.is_some()),
    ] {
        if is_there {
            let what =
                "goes with one motor: the two motors of a gantry are let go to relax their bridge";
            rules.say(&[table], at, what);
        }
    }
}
