//! `signal`: the named inputs and outputs of a running cell, shown, set and forced.

use std::path::PathBuf;

use anyhow::{Context, anyhow};
use bus::files::open_to_read;
use bus::sample::{OperatorRequest, Order, Signals, has_bit};
use console::exit::{Failure, Kind, Outcome};
use console::output::{joined, say};
use launcher::children::children_of;
use launcher::retention::EVENTS_FILE;
use machine::{Machine, Signal, SignalKind};
use remote::state::{AlarmState, SignalState};
use serde_json::Value;

use super::client::{Client, soon_held};
use crate::eyes::Eyes;
use crate::options::{AlarmsChangeOptions, AlarmsOptions, SignalChangeOptions, SignalOptions};

/// What the signals of a machine show, in the order of its file.
pub fn shown(machine: &Machine, signals: &Signals) -> Vec<SignalState> {
    let values = machine.signals.iter().zip(signals.values());
    let state = |(index, (signal, value)): (usize, (&Signal, &f64))| SignalState {
        name: signal.name.clone(),
        kind: signal.kind.word().into(),
        value: *value,
        unit: signal.unit.clone(),
        source: signal.from.words(),
        lost: signals.lost.has(index),
        forced: signals.forced.has(index),
    };
    values.enumerate().map(state).collect()
}

/// Alarms of a machine that are there, or that nobody has acknowledged, in the order of its file.
pub fn alarms(machine: &Machine, signals: &Signals) -> Vec<AlarmState> {
    let all = machine.alarms.iter().enumerate();
    let states = all.map(|(index, alarm)| {
        let scan = signals.alarm_scans.get(index).copied().unwrap_or(0);
        AlarmState {
            number: alarm.number,
            text: alarm.text.clone(),
            remedy: alarm.remedy.clone(),
            active: has_bit(signals.alarms, index),
            acknowledged: !has_bit(signals.unacknowledged, index),
            scan,
            time_s: scan as f64 * machine.scan_period_s(),
        }
    });
    states
        .filter(|state| state.active || !state.acknowledged)
        .collect()
}

/// An alarm in a line.
pub fn alarm_words(state: &AlarmState) -> String {
    let (number, text) = (state.number, &state.text);
    let is = match (state.active, state.acknowledged) {
        (true, true) => ", acknowledged",
        (true, false) => "",
        (false, _) => ", over, not acknowledged",
    };
    let remedy = if state.remedy.is_empty() {
        String::new()
    } else {
        format!(": {}", state.remedy)
    };
    format!("{number} at {:.3} s, {text}{remedy}{is}", state.time_s)
}

/// `alarms`.
pub fn alarms_of(options: &AlarmsOptions) -> Outcome {
    let cell = options.cell.as_deref();
    if let Some(AlarmsChangeOptions::Acknowledge { number }) = &options.change {
        let client = Client::to_order(cell)?;
        let number = f64::from(number.unwrap_or(0));
        let request = OperatorRequest {
            value: number,
            ..OperatorRequest::default()
        };
        client.ask(Order::Acknowledge, request)?;
        client.say("acknowledged");
        return Ok(());
    }
    if let Some(AlarmsChangeOptions::History { folder }) = &options.change {
        return history(cell, folder.clone(), options.json);
    }
    let client = Client::find(cell, "alarms")?;
    let states = now(&client)?.map_or(Vec::new(), |signals| alarms(&client.machine, &signals));
    match states.is_empty() {
        _ if options.json => say(&serde_json::to_string_pretty(&states).unwrap_or_default()),
        true => client.say("no alarm"),
        false => say(&joined(states.iter().map(alarm_words), "\n")),
    }
    Ok(())
}

/// What the events of a run, or of a cell and its runs, tell of alarms.
fn history(cell: Option<&str>, folder: Option<PathBuf>, json: bool) -> Outcome {
    let folder = match folder {
        Some(folder) => folder,
        None => {
            let client = Client::find(cell, "alarms history")?;
            let children = children_of(client.cell.page.launcher_pid());
            let of_recorder = children.into_iter().find_map(|child| child.out);
            of_recorder.ok_or_else(|| {
                Failure::Stopped(anyhow!(
                    "nobody records: name the directory, as in `quadrant alarms history DIR`"
                ))
            })?
        }
    };
    let machine = Machine::load(&folder).input()?;
    let file = folder.join(EVENTS_FILE);
    let text = open_to_read(&file).and_then(std::io::read_to_string);
    let text = text.with_context(|| file.display().to_string()).input()?;
    let all = text.lines().filter_map(|line| {
        let event: Value = serde_json::from_str(line).ok()?;
        let of_alarm = event["event"].as_str()?.starts_with("alarm");
        of_alarm.then_some((event["scan"].as_u64()?, event["text"].as_str()?.to_string()))
    });
    let all: Vec<(u64, String)> = all.collect();
    let time_s = |scan: u64| scan as f64 * machine.scan_period_s();
    if json {
        let all = all.iter().map(|(scan, text)| {
            serde_json::json!({ "scan": scan, "time_s": time_s(*scan), "text": text })
        });
        say(&serde_json::to_string_pretty(&all.collect::<Vec<_>>()).unwrap_or_default());
    } else if all.is_empty() {
        say("no alarm");
    } else {
        let line = |(scan, text): &(u64, String)| format!("{:.3} s  {text}", time_s(*scan));
        say(&joined(all.iter().map(line), "\n"));
    }
    Ok(())
}

/// A value in words: of a switch on or off, of a number with its unit.
pub fn value_words(state: &SignalState) -> String {
    let value = match state.kind.as_str() {
        "bool" if state.value != 0.0 => "on".into(),
        "bool" => "off".into(),
        _ if state.unit.is_empty() => monitor::words::shown(state.value, 6),
        _ => format!("{} {}", monitor::words::shown(state.value, 6), state.unit),
    };
    match (state.forced, state.lost) {
        (true, _) => format!("{value}, forced"),
        (_, true) => format!("{value}, its source is lost"),
        _ => value,
    }
}

/// A line for each.
fn table(states: &[SignalState]) -> String {
    let widest = |of: fn(&SignalState) -> usize| states.iter().map(of).max().unwrap_or(0);
    let name_width = widest(|state| state.name.len());
    let value_width = widest(|state| value_words(state).len());
    let line = |state: &SignalState| {
        let (name, value) = (&state.name, value_words(state));
        format!(
            "{name:<name_width$}  {value:<value_width$}  {}",
            state.source
        )
    };
    joined(states.iter().map(line), "\n")
}

/// `signal`.
pub fn signal(options: &SignalOptions) -> Outcome {
    let cell = options.cell.as_deref();
    let (name, value, order) = match &options.change {
        None | Some(SignalChangeOptions::List) => {
            let client = Client::find(cell, "signals")?;
            let states = signals_of(&client)?;
            say(&if options.json {
                serde_json::to_string_pretty(&states).unwrap_or_default()
            } else {
                table(&states)
            });
            return Ok(());
        }
        Some(SignalChangeOptions::Set { name, value }) => (name, value.as_str(), Order::Signal),
        Some(SignalChangeOptions::Force { name, value }) => {
            (name, value.as_str(), Order::SignalForce)
        }
        Some(SignalChangeOptions::Release { name }) => (name, "0", Order::SignalRelease),
    };
    let client = Client::to_order(cell)?;
    let index = index_of(&client.machine, name)?;
    let of = client.machine.signals.get(index);
    let kind = of.map_or(SignalKind::Float, |signal| signal.kind);
    let request = OperatorRequest {
        axis: index as u32,
        value: value_of(name, kind, value)?,
        ..OperatorRequest::default()
    };
    client.ask(order, request)?;
    let mut eyes = Eyes::open(&client)?;
    // What was ordered shows in the scan after the order.
    eyes.look()?;
    let states = signals_of(&client)?;
    let words = states.get(index).map(value_words).unwrap_or_default();
    client.say(&format!("{name} is {words}"));
    Ok(())
}

fn signals_of(client: &Client) -> Result<Vec<SignalState>, Failure> {
    let signals = now(client)?;
    Ok(signals.map_or(Vec::new(), |signals| shown(&client.machine, &signals)))
}

/// What the cell's signals show from now on; none of a machine without any.
fn now(client: &Client) -> Result<Option<Signals>, Failure> {
    let mut reader = soon_held(&client.cell, || client.bus.signals_reader(1))?;
    let Some(reader) = reader.as_mut() else {
        return Ok(None);
    };
    let mut eyes = Eyes::open(client)?;
    let scan = eyes.look()?.scan;
    loop {
        let newest = reader.newest(u64::MAX);
        if let Some(signals) = newest.filter(|signals| signals.scan > scan) {
            return Ok(Some(signals));
        }
        eyes.look()?;
        std::thread::sleep(super::client::LOOK);
    }
}

fn index_of(machine: &Machine, name: &str) -> Result<usize, Failure> {
    machine.signal(name).ok_or_else(|| {
        let names = joined(machine.signals.iter().map(|signal| &signal.name), " ");
        let known = if names.is_empty() { "none" } else { &names };
        Failure::input(format!(
            "signal {name:?}: the machine has none of that name; it has {known}"
        ))
    })
}

/// A value as it is typed: of a switch on, off, 1 or 0.
fn value_of(name: &str, kind: SignalKind, text: &str) -> Result<f64, Failure> {
    let value = match (kind, text) {
        (SignalKind::Bool, "on" | "true") => Some(1.0),
        (SignalKind::Bool, "off" | "false") => Some(0.0),
        _ => text.parse().ok(),
    };
    value.filter(|value| kind.can_show(*value)).ok_or_else(|| {
        let right = match kind {
            SignalKind::Bool => "on or off",
            SignalKind::Int => "a whole number",
            SignalKind::Float => "a number",
        };
        Failure::input(format!("{text:?}: signal {name} takes {right}"))
    })
}
