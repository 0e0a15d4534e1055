//! What must hold between the keys of a terminal file.

use machine::settings_file::Rules;

use super::keys::{Channel, ChannelDirection, ChannelKind, TerminalFile};
use crate::cia402;
use crate::drive_file::Mapping;
use crate::drive_file::rules::wrong_index;
use crate::process_data;

/// Judges a terminal file by itself.
pub fn judge(rules: &mut Rules<'_>, terminal: &TerminalFile) {
    let data = &terminal.process_data;
    let configures = terminal.mailbox.is_some_and(|mailbox| mailbox.pdo_config);
    if data.mapping == Mapping::Written && !configures {
        let what = "= \"written\": the terminal has no [mailbox] with pdo_config = true: its entries are fixed";
        rules.say(&["process_data", "mapping"], None, what);
    }
    if terminal.mailbox.is_none() && !terminal.sdos.is_empty() {
        let what =
            "is there: the terminal has no [mailbox] through which an object could be written";
        rules.say(&["sdo"], None, what);
    }
    for (key, pdos) in [("receive", &data.receive), ("transmit", &data.transmit)] {
        for (at, pdo) in pdos.iter().enumerate() {
            if let Some(what) = wrong_index(key, pdo) {
                let number = (at + 1).to_string();
                rules.say(&["process_data", key, &number, "index"], None, &what);
            }
        }
    }
    for (at, sdo) in terminal.sdos.iter().enumerate() {
        if ![8, 16, 32].contains(&sdo.bits) {
            let number = (at + 1).to_string();
            let what = format!("= {} bits: must be 8, 16 or 32", sdo.bits);
            rules.say(&["sdo", &number, "bits"], None, &what);
        }
    }
    for (at, channel) in terminal.channels.iter().enumerate() {
        let before = terminal.channels.get(..at).unwrap_or_default();
        let number = (at + 1).to_string();
        for (key, what) in wrong(terminal, channel, before) {
            rules.say(&["channel", &number, key], None, &what);
        }
    }
}

/// What is wrong with a channel: keys, and what of them.
fn wrong(
    terminal: &TerminalFile,
    channel: &Channel,
    before: &[Channel],
) -> Vec<(&'static str, String)> {
    let mut wrong = Vec::new();
    if before.iter().any(|other| other.number == channel.number) {
        wrong.push(("number", format!("= {}: is there twice", channel.number)));
    }
    let (kind, direction) = (channel.kind, channel.direction);
    if kind == ChannelKind::Counter && direction == ChannelDirection::Output {
        wrong.push(("kind", "= \"counter\": goes with inputs alone".into()));
    }
    let scaled = (channel.scale, channel.offset) != (1.0, 0.0);
    if scaled && kind != ChannelKind::Float {
        let what = format!(
            "is there: kind = \"{}\" has none; write \"float\"",
            kind.word()
        );
        let key = if channel.scale == 1.0 {
            "offset"
        } else {
            "scale"
        };
        wrong.push((key, what));
    }
    if channel.scale == 0.0 {
        wrong.push(("scale", "= 0: must be another number".into()));
    }
    if channel.signed && matches!(kind, ChannelKind::Bool | ChannelKind::Real) {
        let what = format!("= true: goes not with kind = \"{}\"", kind.word());
        wrong.push(("signed", what));
    }
    wrong.extend(wrong_bits(terminal, channel, before));
    wrong
}

/// What is wrong with where a channel lies in the process data.
fn wrong_bits(
    terminal: &TerminalFile,
    channel: &Channel,
    before: &[Channel],
) -> Vec<(&'static str, String)> {
    let mut wrong = Vec::new();
    let (kind, direction) = (channel.kind, channel.direction);
    let object = cia402::number(channel.index, channel.sub);
    let pdos = terminal.process_data.of(direction);
    let Some((_, entry)) = process_data::find(pdos, channel.index, channel.sub) else {
        let key = match direction {
            ChannelDirection::Input => "transmit",
            ChannelDirection::Output => "receive",
        };
        let what = format!("is {object}, which process_data.{key} does not have");
        wrong.push(("index", what));
        return wrong;
    };
    let Some(code) = terminal.code(channel) else {
        let what = format!(
            "does not fit into {object} of {} bits; a channel has at most 32",
            entry.bits
        );
        wrong.push((
            if channel.bits.is_some() {
                "bits"
            } else {
                "first_bit"
            },
            what,
        ));
        return wrong;
    };
    let right = match kind {
        ChannelKind::Bool => Some(1),
        ChannelKind::Real => Some(32),
        _ => None,
    };
    if let Some(right) = right.filter(|right| *right != code.field.bits) {
        let (bits, kind) = (code.field.bits, kind.word());
        wrong.push(("bits", format!("= {bits}: kind = \"{kind}\" has {right}")));
    }
    let span = |code: super::ChannelCode| {
        let from = code.field.at_bits;
        (from, from + code.field.bits as usize)
    };
    let (from, to) = span(code);
    let shares = before.iter().find(|other| {
        let other = terminal
            .code(other)
            .filter(|_| other.direction == direction)
            .map(span);
        other.is_some_and(|(other_from, other_to)| from < other_to && other_from < to)
    });
    if let Some(other) = shares.filter(|_| direction == ChannelDirection::Output) {
        let what = format!(
            "has bits of channel {}: each bit of an output is in one channel",
            other.number
        );
        wrong.push(("index", what));
    }
    wrong
}
