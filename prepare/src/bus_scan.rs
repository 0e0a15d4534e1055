//! `quadrant bus scan`: who is on a segment, for people and for scripts.

use std::path::Path;
use std::rc::Rc;

use anyhow::Context;

use bus::drive_codes::{al_state, al_status};
use fieldbus::cia402;
use fieldbus::link::Socket;
use fieldbus::process::claim::Claim;
use fieldbus::setups;
use fieldbus::start_up::{self, FoundPdo, FoundSlave, FoundSync};
use machine::{Machine, machine_file};
use serde::Serialize;

use crate::options::BusScanOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::{self, say};

/// Widest line.
const COLUMNS: usize = 100;
/// Letters of a name in the table.
const NAME_LETTERS: usize = 18;

/// `quadrant bus scan`.
///
/// # Errors
/// The interface cannot be used, is used by a cell, or nobody answers.
pub fn scan(options: &BusScanOptions) -> Outcome {
    let places = options.machine.as_deref().map(places).transpose().input()?;
    let (_claim, socket) = open(&options.interface)?;
    let slaves = start_up::scan(&socket, options.dc).environment()?;
    if options.json {
        say(&json(&options.interface, &slaves));
    } else {
        say(&text(&options.interface, &slaves));
    }
    for line in places.unwrap_or_default() {
        say(&line);
    }
    Ok(())
}

/// What a machine has at each place on the cable, after an empty line.
fn places(machine: &Path) -> anyhow::Result<Vec<String>> {
    let file = machine_file(machine);
    let machine = Machine::load(&file)?;
    let setups = setups::load(&machine, &file)?;
    let setups = setups.with_context(|| format!("{}: has no [bus]", file.display()))?;
    let mut lines = vec![String::new(), format!("As {} has it:", file.display())];
    for (place, words) in setups.places_in_words(&machine) {
        lines.extend(wrapped("  ", &format!("place {place}: {words}")));
    }
    Ok(lines)
}

/// Opens an interface that no cell drives.
pub(crate) fn open(interface: &str) -> Result<(Claim, Rc<Socket>), Failure> {
    let claim = Claim::of(interface).environment()?;
    let socket = Socket::open(interface).environment()?;
    socket.ignore_own();
    Ok((claim, Rc::new(socket)))
}

/// A table of the slaves, and their process data, those that are the same once.
fn text(interface: &str, slaves: &[FoundSlave]) -> String {
    let count = match slaves.len() {
        1 => "1 slave".to_string(),
        count => format!("{count} slaves"),
    };
    let mut lines = vec![
        format!("{count} on {interface}, in PRE-OP now"),
        String::new(),
        format!(
            "place  {:NAME_LETTERS$}  vendor      product     revision    {:>10}  profile  clocks",
            "name", "serial"
        ),
    ];
    for (place, slave) in slaves.iter().enumerate() {
        let [vendor, product, revision, serial] = slave.identity;
        let name = shortened(&slave.name);
        let profile = slave
            .profile
            .map_or("-".into(), |profile| profile.to_string());
        let clocks = if slave.clocks { "yes" } else { "no" };
        lines.push(format!(
            "{place:>5}  {name:NAME_LETTERS$}  {vendor:#010x}  {product:#010x}  {revision:#010x}  {serial:>10}  {profile:>7}  {clocks}"
        ));
    }
    lines.push(String::new());
    for (words, places) in grouped(slaves, state_words) {
        let beginning = format!("Before the scan {} in ", was(&places));
        lines.extend(wrapped(&beginning, &words));
    }
    lines.extend(clocks(slaves));
    for (words, places) in grouped(slaves, process_data_words) {
        lines.push(String::new());
        lines.push(format!("Process data of {}:", places_words(&places)));
        for line in words.lines() {
            lines.extend(wrapped("  ", line));
        }
    }
    lines.join("\n")
}

/// How the slaves keep time, where that was asked for.
fn clocks(slaves: &[FoundSlave]) -> Vec<String> {
    let asked = slaves.iter().enumerate();
    let asked = asked.filter_map(|(place, slave)| Some((place, slave, slave.sync?)));
    let shown = |value: Option<String>| value.unwrap_or_else(|| "-".into());
    let count = |value: Option<u64>| shown(value.map(|value| value.to_string()));
    let us = |ns: f64| format!("{:.3}", ns * 1e-3);
    let rows = asked.map(|(place, slave, sync)| {
        let delay = slave.clocks.then(|| us(slave.delay_ns.into()));
        let [off, cycle, copying] = [
            sync.clock_off_ns.map(|ns| us(ns.into())),
            sync.cycle_min_ns.map(|ns| us(ns as f64)),
            sync.taking_in_ns.map(|ns| us(ns as f64)),
        ];
        let error = sync.has_error.map(|error| if error { "yes" } else { "no" });
        format!(
            "{place:>5}  {:>8}  {:>8}  {:12}  {:>8}  {:>8}  {:>6}  {:>6}  {:>5}  {:>5}",
            shown(delay),
            shown(off),
            shown(sync.kinds.map(kinds)),
            shown(cycle),
            shown(copying),
            count(sync.error_limit),
            count(sync.missed),
            count(sync.too_short),
            shown(error.map(String::from)),
        )
    });
    let rows: Vec<String> = rows.collect();
    if rows.is_empty() {
        return rows;
    }
    let head = [
        String::new(),
        "Clocks, in µs: cable delay, off the reference; then what 1C32 and 10F1 say of synchronisation:".into(),
        String::new(),
        format!(
            "place  {:>8}  {:>8}  {:12}  {:>8}  {:>8}  {:>6}  {:>6}  {:>5}  {:>5}",
            "delay", "off", "can", "cycle >=", "takes in", "limit", "missed", "short", "error"
        ),
    ];
    head.into_iter().chain(rows).collect()
}

/// Ways of synchronisation in words (1C32:4, ETG.1020).
fn kinds(bits: u64) -> String {
    let kinds = [(0b1, "free"), (0b10, "frame"), (0b1_1100, "SYNC")];
    let kinds = kinds.iter().filter(|(bit, _)| bits & bit != 0);
    let words: Vec<&str> = kinds.map(|(_, word)| *word).collect();
    words.join(" ")
}

/// The first letters of a name that is long.
fn shortened(name: &str) -> String {
    if name.chars().count() <= NAME_LETTERS {
        return name.into();
    }
    let mut short: String = name.chars().take(NAME_LETTERS - 1).collect();
    short.push('…');
    short
}

/// Places that have the same words, in the order of the cable.
fn grouped(slaves: &[FoundSlave], words: fn(&FoundSlave) -> String) -> Vec<(String, Vec<usize>)> {
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    for (place, slave) in slaves.iter().enumerate() {
        let words = words(slave);
        match groups.iter_mut().find(|(others, _)| *others == words) {
            Some((_, places)) => places.push(place),
            None => groups.push((words, vec![place])),
        }
    }
    groups
}

fn was(places: &[usize]) -> String {
    let verb = if places.len() == 1 { "was" } else { "were" };
    format!("{} {verb}", places_words(places))
}

fn places_words(places: &[usize]) -> String {
    let numbers: Vec<String> = places.iter().map(usize::to_string).collect();
    let word = if places.len() == 1 { "place" } else { "places" };
    format!("{word} {}", numbers.join(", "))
}

/// The state in which a slave was found.
fn state_words(slave: &FoundSlave) -> String {
    let state = al_state(slave.al_status_before);
    match slave.al_status_code_before {
        0 => state.to_string(),
        code => format!("{state}: {}", al_status(code)),
    }
}

fn process_data_words(slave: &FoundSlave) -> String {
    if slave.profile.is_none() {
        return "not known: it has no mailbox, or does not tell".into();
    }
    let mut lines = Vec::new();
    for (verb, pdos) in [("takes", &slave.receive), ("sends", &slave.transmit)] {
        if pdos.is_empty() {
            lines.push(format!("{verb} nothing"));
        }
        for pdo in pdos {
            let entries: Vec<String> = pdo.entries.iter().map(entry_words).collect();
            let bits = bits(pdo);
            let bytes = bits.div_ceil(8);
            let list = entries.join(", ");
            lines.push(format!("{verb} {:04X}, {bytes} bytes: {list}", pdo.index));
        }
    }
    lines.join("\n")
}

fn bits(pdo: &FoundPdo) -> u32 {
    let bits = pdo.entries.iter().map(|(_, _, bits)| u32::from(*bits));
    bits.sum()
}

fn entry_words(&(index, sub, bits): &(u16, u8, u8)) -> String {
    if index == 0 {
        return format!("gap /{bits}");
    }
    let number = cia402::number(index, sub);
    match cia402::standard(index, sub) {
        Some((name, _)) => format!("{number} {name} /{bits}"),
        None => format!("{number} /{bits}"),
    }
}

fn wrapped(beginning: &str, text: &str) -> Vec<String> {
    output::wrapped(COLUMNS, beginning, "    ", text)
}

#[derive(Serialize)]
struct Json<'a> {
    interface: &'a str,
    slaves: Vec<JsonSlave<'a>>,
}

#[derive(Serialize)]
struct JsonSlave<'a> {
    place: usize,
    name: &'a str,
    vendor: u32,
    product_code: u32,
    revision: u32,
    serial: u32,
    station_address: u16,
    al_state_before: &'a str,
    al_status_code_before: u16,
    profile: Option<u16>,
    distributed_clocks: bool,
    cable_delay_ns: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    sync: Option<FoundSync>,
    receive: Vec<JsonPdo>,
    transmit: Vec<JsonPdo>,
}

#[derive(Serialize)]
struct JsonPdo {
    index: u16,
    size_bits: u32,
    entries: Vec<JsonEntry>,
}

#[derive(Serialize)]
struct JsonEntry {
    index: u16,
    sub: u8,
    size_bits: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<&'static str>,
}

fn json_pdos(pdos: &[FoundPdo]) -> Vec<JsonPdo> {
    let entry = |&(index, sub, size_bits): &(u16, u8, u8)| JsonEntry {
        index,
        sub,
        size_bits,
        name: cia402::standard(index, sub).map(|(name, _)| name),
    };
    let pdos = pdos.iter().map(|pdo| JsonPdo {
        index: pdo.index,
        size_bits: bits(pdo),
        entries: pdo.entries.iter().map(entry).collect(),
    });
    pdos.collect()
}

fn json(interface: &str, slaves: &[FoundSlave]) -> String {
    let slaves = slaves.iter().enumerate().map(|(place, slave)| {
        let [vendor, product_code, revision, serial] = slave.identity;
        JsonSlave {
            place,
            name: &slave.name,
            vendor,
            product_code,
            revision,
            serial,
            station_address: slave.address,
            al_state_before: al_state(slave.al_status_before),
            al_status_code_before: slave.al_status_code_before,
            profile: slave.profile,
            distributed_clocks: slave.clocks,
            cable_delay_ns: slave.delay_ns,
            sync: slave.sync,
            receive: json_pdos(&slave.receive),
            transmit: json_pdos(&slave.transmit),
        }
    });
    let json = Json {
        interface,
        slaves: slaves.collect(),
    };
    serde_json::to_string_pretty(&json).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slave(name: &str) -> FoundSlave {
        let gaps = (0..20).map(|_| (0, 0, 7));
        FoundSlave {
            name: name.into(),
            identity: [0xFFFF_FFFF; 4],
            address: 0x1000,
            al_status_before: 0x14,
            al_status_code_before: 0x001B,
            clocks: true,
            profile: Some(402),
            receive: vec![FoundPdo {
                index: 0x1600,
                entries: vec![(0x6040, 0, 16), (0x60C2, 1, 8), (0x60B2, 0, 16), (0, 0, 7)],
            }],
            transmit: vec![FoundPdo {
                index: 0x1A00,
                entries: gaps.collect(),
            }],
            delay_ns: 300,
            sync: None,
        }
    }

    #[test]
    fn a_table_fits_into_100_columns_whatever_a_slave_is_called() {
        let long = "EtherCAT servo drive of a vendor with a long name";
        let shown = text("eth0", &[slave("AM M"), slave(long), slave("AM M")]);
        for line in shown.lines() {
            assert!(line.chars().count() <= COLUMNS, "{line}");
        }
        assert!(shown.starts_with("3 slaves on eth0"), "{shown}");
        // What all have in common is said once.
        assert_eq!(shown.matches("Process data of").count(), 1, "{shown}");
        assert!(shown.contains("Process data of places 0, 1, 2:"), "{shown}");
        assert!(shown.contains("6040 controlword /16"), "{shown}");
        assert!(shown.contains("sends 1A00, 18 bytes"), "{shown}");
    }

    #[test]
    fn json_says_units_in_its_names() {
        let json: serde_json::Value =
            serde_json::from_str(&json("eth0", &[slave("AM M")])).expect("JSON");
        let first = &json["slaves"][0];
        assert_eq!(first["cable_delay_ns"], 300);
        assert_eq!(first["receive"][0]["size_bits"], 47);
        assert_eq!(first["receive"][0]["entries"][0]["name"], "controlword");
    }
}
