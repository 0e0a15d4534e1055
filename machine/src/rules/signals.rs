//! Rules of `[[signal]]`, `[functions]` and `[axis.limit_switches]`: names are unique, each value has one source, each output one signal.

use bus::sample::{ALARMS_MAX, SIGNALS_MAX};

use crate::machine::Machine;
use crate::settings_file::Rules;
use crate::signals::{MachineState, SetBy, Signal, SignalKind, SignalSource};

const NAME_LENGTH_MAX: usize = 40;

fn is_name(name: &str) -> bool {
    let mut letters = name.bytes();
    letters
        .next()
        .is_some_and(|first| first.is_ascii_lowercase())
        && letters.all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
        && name.len() <= NAME_LENGTH_MAX
}

pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    if machine.signals.len() > SIGNALS_MAX {
        let what = format!(
            "is there {} times: at most {SIGNALS_MAX}",
            machine.signals.len()
        );
        rules.say(&["signal"], None, &what);
    }
    for index in 0..machine.signals.len() {
        one(rules, machine, index);
    }
    for (mut keys, name, switch) in machine.functions.named() {
        if let Some(what) = wrong_name(machine, name, switch) {
            keys.insert(0, "functions");
            rules.say(&keys, None, &what);
        }
    }
    m_codes(rules, machine);
    handwheel(rules, machine);
    alarms(rules, machine);
    limit_switches(rules, machine);
}

fn m_codes(rules: &mut Rules<'_>, machine: &Machine) {
    let shown = |signal: &Signal| signal.from.state == Some(MachineState::MCode);
    if machine.functions.m_codes.is_some() && !machine.signals.iter().any(shown) {
        let what =
            "needs a [[signal]] with from = { state = \"m-code\" }, that shows what is to be done";
        rules.say(&["functions", "m_codes"], None, what);
    }
}

fn handwheel(rules: &mut Rules<'_>, machine: &Machine) {
    let Some(wheel) = &machine.functions.handwheel else {
        return;
    };
    for axis in wheel.axes.keys() {
        if let Err(what) = machine.axis_index(axis) {
            rules.say(&["functions", "handwheel", "axes", axis], None, &what);
        }
    }
    let mut say = |key, what| rules.say(&["functions", "handwheel", key], None, what);
    if wheel.axes.is_empty() {
        say("axes", "must choose an axis, as in { X = \"wheel_x\" }");
    }
    if wheel.step_mm == 0.0 {
        say("step_mm", "= 0: a click moves by a way other than 0");
    }
}

/// One signal: its name, what it can show, where it comes from and goes.
fn one(rules: &mut Rules<'_>, machine: &Machine, index: usize) {
    let Some(signal) = machine.signals.get(index) else {
        return;
    };
    let before = machine.signals.get(..index).unwrap_or_default();
    let number = (index + 1).to_string();
    let mut say = |key: &str, what: &str| {
        rules.say(&["signal", number.as_str(), key], None, what);
    };
    if !is_name(&signal.name) {
        let what = format!(
            "= {:?}: must be 1 to {NAME_LENGTH_MAX} lower-case letters, digits or underscores, a letter first",
            signal.name
        );
        say("name", &what);
    } else if before.iter().any(|other| other.name == signal.name) {
        say("name", &format!("= {:?}: is there twice", signal.name));
    }
    if signal.keeps && signal.inverted {
        let what = "= true: one that keeps its value is not inverted besides: say it the other way round where it is set";
        say("inverted", what);
    }
    for (key, value) in [("default", Some(signal.default)), ("lost", signal.lost)] {
        if let Some(value) = value.filter(|value| !signal.kind.can_show(*value)) {
            let kind = signal.kind.word();
            let what = format!("= {value}: a signal of the kind {kind} cannot show it");
            say(key, &what);
        }
    }
    if signal.inverted && signal.kind != SignalKind::Bool {
        say("inverted", "= true: goes with kind = \"bool\" alone");
    }
    let to = signal.to.as_ref();
    if signal.keeps && to.is_some_and(|to| to.drive.is_some() || to.terminal.is_some()) {
        let what = "= true: goes to a device, whose output would stay on when nobody commands it";
        say("keeps", what);
    }
    if let Some(what) = wrong_source(machine, signal) {
        say("from", &what);
    }
    if let Some(what) = wrong_sink(machine, signal, before) {
        say("to", &what);
    }
}

fn limit_switches(rules: &mut Rules<'_>, machine: &Machine) {
    for (index, axis) in machine.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        let Some(switches) = &axis.limit_switches else {
            continue;
        };
        let ends = [
            ("negative", &switches.negative),
            ("positive", &switches.positive),
        ];
        for (key, name) in ends {
            let wrong = name
                .as_ref()
                .and_then(|name| wrong_name(machine, name, true));
            if let Some(what) = wrong {
                rules.say(&["limit_switches", key], at, &what);
            }
        }
    }
}

/// Each alarm has a number of its own, and a signal or logic that brings it.
fn alarms(rules: &mut Rules<'_>, machine: &Machine) {
    if machine.alarms.len() > ALARMS_MAX {
        let what = format!(
            "is there {} times: at most {ALARMS_MAX}",
            machine.alarms.len()
        );
        rules.say(&["alarm"], None, &what);
    }
    for (index, alarm) in machine.alarms.iter().enumerate() {
        let number = (index + 1).to_string();
        let before = machine.alarms.get(..index).unwrap_or_default();
        if before.iter().any(|other| other.number == alarm.number) {
            let what = format!("= {}: is there twice", alarm.number);
            rules.say(&["alarm", &number, "number"], None, &what);
        }
        match &alarm.signal {
            Some(name) if machine.signal(name).is_none() => {
                let what = format!("= {name:?}: there is no [[signal]] of that name");
                rules.say(&["alarm", &number, "signal"], None, &what);
            }
            None if machine.logic.is_none() => {
                let what = "is missing: without [logic] nobody else raises the alarm";
                rules.say(&["alarm", &number, "signal"], None, what);
            }
            _ => {}
        }
    }
}

/// What is wrong with a function's signal.
fn wrong_name(machine: &Machine, name: &str, switch: bool) -> Option<String> {
    let Some(index) = machine.signal(name) else {
        return Some(format!("= {name:?}: there is no [[signal]] of that name"));
    };
    let is_switch = machine.signals.get(index)?.kind == SignalKind::Bool;
    match (switch, is_switch) {
        (true, false) => Some(format!("= {name:?}: must be a switch (kind = \"bool\")")),
        (false, true) => Some(format!(
            "= {name:?}: must be a number (kind = \"int\" or \"float\")"
        )),
        _ => None,
    }
}

/// Whether a place on the cable, or a drive, is not one of the machine, with what belongs to it.
fn wrong_device(
    machine: &Machine,
    (drive, bit): (&Option<String>, Option<u32>),
    (terminal, channel): (Option<u32>, Option<u32>),
) -> Option<String> {
    if drive.is_some() != bit.is_some() {
        return Some("has drive and bit together: the axis, and the bit of its drive".into());
    }
    if terminal.is_some() != channel.is_some() {
        return Some(
            "has terminal and channel together: the place on the cable, and the channel there"
                .into(),
        );
    }
    if let Some(name) = drive
        && let Err(what) = machine.axis_index(name)
    {
        return Some(what);
    }
    let (Some(place), Some(bus)) = (terminal, &machine.bus) else {
        return None;
    };
    let mut terminals = bus.terminals.iter();
    (!terminals.any(|terminal| terminal.slave == place)).then(|| {
        format!("names terminal {place}: there is no [[bus.terminal]] with slave = {place}")
    })
}

fn wrong_source(machine: &Machine, signal: &Signal) -> Option<String> {
    let from = &signal.from;
    if from.count() != 1 {
        return Some(
            "must name one source: drive and bit, terminal and channel, output, analog_output, state, by, or travel, every_m and for_ms"
                .into(),
        );
    }
    let of_travel = [
        from.travel.is_some(),
        from.every_m.is_some(),
        from.for_ms.is_some(),
    ];
    if of_travel.iter().any(|there| *there != of_travel[0]) {
        return Some("has travel, every_m and for_ms together: the axis, and a pulse of for_ms each time it has gone so far".into());
    }
    if let Some(axis) = &from.travel
        && let Err(what) = machine.axis_index(axis)
    {
        return Some(what);
    }
    if from.travel.is_some() && signal.kind != SignalKind::Bool {
        return Some("travel is a switch: kind = \"bool\"".into());
    }
    if from.by == Some(SetBy::Logic) && machine.logic.is_none() {
        return Some("names the logic, and the file has no [logic]".into());
    }
    if from.output.is_some() && signal.kind != SignalKind::Bool {
        return Some("output is a switch: kind = \"bool\"".into());
    }
    let device = (&from.drive, from.bit);
    wrong_device(machine, device, (from.terminal, from.channel))
}

fn wrong_sink(machine: &Machine, signal: &Signal, before: &[Signal]) -> Option<String> {
    let to = signal.to.as_ref()?;
    let device = (&to.drive, to.bit);
    if let Some(what) = wrong_device(machine, device, (to.terminal, to.channel)) {
        return Some(what);
    }
    let of_drive = machine
        .axes
        .iter()
        .find(|axis| Some(&axis.name) == to.drive.as_ref());
    if to.bit == Some(0) && of_drive.is_some_and(|axis| axis.commanded_brake().is_some()) {
        return Some("is bit 0 of a drive whose brake the controller opens by it".into());
    }
    let outward = to.drive.is_some() || to.terminal.is_some();
    if outward && signal.from.is_outside() {
        return Some("goes to a device, and comes from one: an input is no output".into());
    }
    if to.input.is_some() && signal.kind != SignalKind::Bool {
        return Some("input is a switch: kind = \"bool\"".into());
    }
    let same = |other: &&Signal| {
        other.to.as_ref().is_some_and(|other| {
            let at_drive = to.drive.is_some() && (&to.drive, to.bit) == (&other.drive, other.bit);
            let at_terminal = to.terminal.is_some()
                && (to.terminal, to.channel) == (other.terminal, other.channel);
            let at_input = to.input.is_some() && to.input == other.input;
            let at_analog = to.analog_input.is_some() && to.analog_input == other.analog_input;
            at_drive || at_terminal || at_input || at_analog
        })
    };
    let other = before.iter().find(same)?;
    Some(format!(
        "is where {:?} goes already: one place, one signal",
        other.name
    ))
}

impl SignalSource {
    /// In words: `drive X bit 4`.
    pub fn words(&self) -> String {
        if let (Some(drive), Some(bit)) = (&self.drive, self.bit) {
            return format!("drive {drive}, bit {bit}");
        }
        if let (Some(terminal), Some(channel)) = (self.terminal, self.channel) {
            return format!("terminal {terminal}, channel {channel}");
        }
        if let (Some(axis), Some(every_m)) = (&self.travel, self.every_m) {
            return format!("each {every_m} m of {axis}");
        }
        match (self.output, self.analog_output, self.state, self.by) {
            (Some(output), ..) => format!("the program (M64 P{output})"),
            (_, Some(output), ..) => format!("the program (M68 E{output})"),
            (_, _, Some(_), _) => "the controller".into(),
            (_, _, _, Some(SetBy::Logic)) => "the logic".into(),
            _ => "the operator".into(),
        }
    }
}
