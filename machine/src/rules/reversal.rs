//! Rules of `[axis.reversal]`: what the friction pulse needs.

use crate::axis::Axis;
use crate::machine::Machine;
use crate::reversal::{PositionErrorPart, PulseShape, ReversalMethod, Trigger};
use crate::settings_file::{At, Rules};

pub fn judge(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    let reversal = &axis.reversal;
    if reversal.shape == PulseShape::Constant && reversal.presliding_um > 0.0 {
        let what = format!(
            "= {} µm: needs shape = \"decaying\", a constant pulse does not follow the distance",
            reversal.presliding_um
        );
        rules.say(&["reversal", "presliding_um"], at, &what);
    }
    let look_ahead_ms = machine.look_ahead_s() * 1e3;
    let path = ["reversal", "lead_ms"];
    rules.between(&path, at, reversal.lead_ms, "ms", 0.0, look_ahead_ms);
    if reversal.method == ReversalMethod::FrictionPulse
        && (reversal.pulse_mm_s == 0.0 || reversal.pulse_ms == 0.0)
    {
        let what = "method = \"friction-pulse\" needs pulse_mm_s and pulse_ms above 0";
        rules.say(&["reversal"], at, what);
    }
    trigger(rules, axis, at);
}

/// Settings of the trigger that belong together.
fn trigger(rules: &mut Rules<'_>, axis: &Axis, at: At<'_>) {
    let (reversal, forward) = (&axis.reversal, &axis.feed_forward);
    let pulses = reversal.method == ReversalMethod::FrictionPulse;
    let fed = forward.enabled && forward.coefficient > 0.0;
    if pulses && reversal.trigger == Trigger::FeedForward && !fed {
        let what = "= \"feed-forward\": needs feed_forward.enabled = true and a coefficient above 0, without them its sign never changes";
        rules.say(&["reversal", "trigger"], at, what);
    }
    let part = ["reversal", "position_error_part"];
    let clamped = reversal.position_error_part == PositionErrorPart::Clamped;
    if clamped && !(forward.enabled && forward.coefficient >= 0.5) {
        let what = "= \"clamped\": needs feed_forward.enabled = true and a coefficient of at least 0.5, below Kp·ε is most of the velocity command";
        rules.say(&part, at, what);
    }
    let judged = reversal.position_error_part != PositionErrorPart::None;
    if judged && reversal.trigger != Trigger::CommandAcceleration {
        let what = format!(
            "needs trigger = \"command-acceleration\", {:?} does not ask for it",
            reversal.trigger.word()
        );
        rules.say(&part, at, &what);
    }
}
