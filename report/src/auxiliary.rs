//! Spindle, coolant, outputs, tool and stops in words: for the report, the live view and one look at a cell.

use bus::sample::{
    ANALOG_OUTPUTS, Auxiliaries, DIGITAL_OUTPUTS, FLOOD, Inputs, Levels, MIST, SpindleCommand,
};
use console::output::joined;
use monitor::words::{rev_min, shown, waiting};

/// The coolant that is on.
pub fn coolant(levels: &Levels) -> &'static str {
    match (levels.coolant & MIST != 0, levels.coolant & FLOOD != 0) {
        (false, false) => "off",
        (true, false) => "mist",
        (false, true) => "flood",
        (true, true) => "mist and flood",
    }
}

/// Numbers of the digital outputs that are on.
pub fn digital_outputs(levels: &Levels) -> Vec<u32> {
    let all = 0..DIGITAL_OUTPUTS as u32;
    all.filter(|output| levels.digital >> output & 1 == 1)
        .collect()
}

/// What the spindle is commanded to do.
pub fn spindle(levels: &Levels) -> String {
    match SpindleCommand::from_wire(levels.spindle) {
        SpindleCommand::Stop => "stopped".into(),
        SpindleCommand::Orient => format!("at {}°", shown(levels.orientation_deg, 3)),
        SpindleCommand::Follow => "in step with the tap".into(),
        SpindleCommand::Turn => {
            let way = if levels.spindle_rpm < 0.0 {
                "counter-clockwise"
            } else {
                "clockwise"
            };
            format!("{} {way}", rev_min(levels.spindle_rpm))
        }
    }
}

/// What is on, in a few words; none if nothing is and nothing was.
pub fn summary(auxiliary: &Auxiliaries) -> Option<String> {
    let levels = &auxiliary.levels;
    let mut words = Vec::new();
    if levels.spindle != SpindleCommand::Stop as u32 || auxiliary.spindle_rpm.abs() >= 1.0 {
        words.push(format!(
            "spindle {} ({:.0} rev/min)",
            spindle(levels),
            auxiliary.spindle_rpm.abs()
        ));
    }
    if auxiliary.coupled != 0 && levels.spindle != SpindleCommand::Follow as u32 {
        words.push("the tap is in its thread".into());
    }
    if levels.coolant != 0 {
        words.push(format!("coolant {}", coolant(levels)));
    }
    if auxiliary.tool != 0 {
        words.push(format!("tool {}", auxiliary.tool));
    }
    let outputs = digital_outputs(levels);
    if !outputs.is_empty() {
        words.push(format!("outputs {}", joined(outputs, " ")));
    }
    if auxiliary.optional_stop == 1 {
        words.push("optional stop on".into());
    }
    (!words.is_empty()).then(|| words.join(", "))
}

/// What a switch shows.
pub fn on_or_off(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

/// What the operator has switched otherwise than at the start of a cell, in a few words.
pub fn panel(single_block: bool, rapid_percent: u32, jog_percent: u32) -> Option<String> {
    let mut words = Vec::new();
    if single_block {
        words.push("single block".into());
    }
    for (what, percent) in [("rapids", rapid_percent), ("jogs", jog_percent)] {
        if percent != 100 {
            words.push(format!("{what} {percent} %"));
        }
    }
    (!words.is_empty()).then(|| words.join(", "))
}

/// What the operator has switched from one scan to a later one.
pub fn switched(before: &Inputs, now: &Inputs) -> Vec<String> {
    let mut changes = Vec::new();
    if before.single_block() != now.single_block() {
        changes.push(format!("single block {}", on_or_off(now.single_block())));
    }
    for (what, [was, is]) in [
        ("rapid", [before, now].map(Inputs::rapid_override_percent)),
        ("jog", [before, now].map(Inputs::jog_override_percent)),
    ] {
        if was != is {
            changes.push(format!("{what} override {was} % → {is} %"));
        }
    }
    changes
}

/// What differs from one scan to a later one, in the order of cause and effect.
pub fn changes(before: &Auxiliaries, now: &Auxiliaries) -> Vec<String> {
    let mut changes = Vec::new();
    let (was, is) = (&before.levels, &now.levels);
    if spindle(was) != spindle(is) {
        changes.push(format!("spindle {}", spindle(is)));
    }
    if before.coupled != 0 && now.coupled != 0 {
        let [followed, follows] =
            [was, is].map(|levels| levels.spindle == SpindleCommand::Follow as u32);
        if followed && !follows {
            changes.push("stopped with the tap in its thread: `resume` goes on in step".into());
        }
    }
    if was.coolant != is.coolant {
        changes.push(format!("coolant {}", coolant(is)));
    }
    for output in 0..DIGITAL_OUTPUTS {
        let [old, new] = [was, is].map(|levels| levels.digital >> output & 1);
        if old != new {
            changes.push(format!("output {output} {}", on_or_off(new == 1)));
        }
    }
    for output in 0..ANALOG_OUTPUTS {
        let [old, new] = [was, is].map(|levels| levels.analog.get(output).copied());
        if let (true, Some(value)) = (old != new, new) {
            changes.push(format!("analogue output {output} at {}", shown(value, 4)));
        }
    }
    if was.tool_prepared != is.tool_prepared {
        changes.push(format!("tool {} made ready", is.tool_prepared));
    }
    if before.tool != now.tool {
        changes.push(format!("tool {} in the spindle", now.tool));
    }
    if before.override_disabled != now.override_disabled {
        let word = on_or_off(now.override_disabled != 1);
        changes.push(format!("override switched {word} by the program"));
    }
    if before.optional_stop != now.optional_stop {
        changes.push(format!(
            "optional stop {}",
            on_or_off(now.optional_stop == 1)
        ));
    }
    if before.start_line != now.start_line {
        changes.push(match now.start_line {
            0 => format!("begins at line {}", before.start_line),
            line => format!("to begin at line {line}"),
        });
    }
    if (before.waiting, before.line) != (now.waiting, now.line) {
        let waits = waiting(now).map(|what| format!("waits for {what}"));
        changes.push(waits.unwrap_or("waits no longer".into()));
    }
    changes
}

#[cfg(test)]
mod tests {
    use bus::sample::Waiting;

    use super::*;

    #[test]
    fn what_changes_is_said_once_and_what_does_not_is_not() {
        let before = Auxiliaries::default();
        assert_eq!(changes(&before, &before), [] as [String; 0]);
        assert_eq!(summary(&before), None);
        let mut now = before;
        now.levels.spindle = SpindleCommand::Turn as u32;
        now.levels.spindle_rpm = -1500.0;
        now.levels.coolant = FLOOD;
        now.levels.digital = 1 << 3 | 1 << 63;
        now.waiting = Waiting::SpindleSpeed as u32;
        now.line = 7;
        now.spindle_rpm = -600.0;
        assert_eq!(
            changes(&before, &now),
            [
                "spindle 1500 rev/min counter-clockwise",
                "coolant flood",
                "output 3 on",
                "output 63 on",
                "waits for the spindle to reach its speed: 600 of 1500 rev/min, line 7",
            ]
        );
        assert_eq!(
            summary(&now).as_deref(),
            Some(
                "spindle 1500 rev/min counter-clockwise (600 rev/min), coolant flood, outputs 3 63"
            )
        );
        let mut later = now;
        later.spindle_rpm = -900.0;
        assert_eq!(changes(&now, &later), [] as [String; 0]);
        later.waiting = 0;
        assert_eq!(changes(&now, &later), ["waits no longer"]);
    }
}
