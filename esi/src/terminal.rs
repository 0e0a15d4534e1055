//! Makes a terminal file of what a vendor's ESI file says.

use fieldbus::drive_file::Mapping;
use fieldbus::process_data::{self, Entry, Pdo};
use fieldbus::terminal_file::{Channel, ChannelDirection, ChannelKind, TerminalData, TerminalFile};

use crate::from_esi::{NotMade, identity_of, mailbox_of, vendors_sdos};
use crate::{Device, Esi, Pdo as EsiPdo, PdoEntry};

/// Most PDOs of a direction, and channels, that a terminal file holds.
const PDOS_MAX: usize = 64;
const CHANNELS_MAX: usize = 256;

/// Makes a terminal file of a device: a channel of each switch, and of each number of up to 32 bits, that it exchanges from the factory.
///
/// # Errors
/// It exchanges nothing, or too much.
pub fn terminal_from_esi(esi: &Esi, device: &Device) -> Result<TerminalFile, NotMade> {
    let not_made = |what: String| NotMade::of(esi, device, what);
    let (outputs, inputs) = (exchanged(&device.receive), exchanged(&device.transmit));
    if outputs.is_empty() && inputs.is_empty() {
        return Err(not_made(
            "exchanges nothing from the factory, or has it in modules".into(),
        ));
    }
    let mut channels = Vec::new();
    for (direction, pdos) in [
        (ChannelDirection::Input, &inputs),
        (ChannelDirection::Output, &outputs),
    ] {
        for pdo in pdos {
            let entries = pdo.entries.iter().filter(|entry| entry.index != 0);
            let fit = entries.filter(|entry| entry.bits <= 32 || is_switches(entry));
            channels.extend(fit.flat_map(|entry| channels_of(direction, pdo, entry)));
        }
    }
    if outputs.len().max(inputs.len()) > PDOS_MAX || channels.len() > CHANNELS_MAX {
        return Err(not_made(
            "exchanges more than a terminal file can hold".into(),
        ));
    }
    for (number, channel) in (1..).zip(&mut channels) {
        channel.number = number;
    }
    let mailbox = device.mailbox.filter(|mailbox| mailbox.coe);
    Ok(TerminalFile {
        identity: identity_of(esi, device),
        process_data: TerminalData {
            mapping: Mapping::Fixed,
            receive: in_image(&outputs),
            transmit: in_image(&inputs),
        },
        sdos: mailbox.map_or_else(Vec::new, |_| vendors_sdos(device).collect()),
        mailbox: mailbox.as_ref().map(mailbox_of),
        channels,
    })
}

/// The PDOs that are exchanged from the factory, in the order of their sync managers.
fn exchanged(pdos: &[EsiPdo]) -> Vec<&EsiPdo> {
    let assigned = pdos.iter().filter(|pdo| pdo.sync_manager.is_some());
    let mut assigned: Vec<&EsiPdo> = assigned.filter(|pdo| !pdo.entries.is_empty()).collect();
    assigned.sort_by_key(|pdo| pdo.sync_manager);
    assigned
}

/// They as they lie in the image: what belongs to another sync manager begins with a byte.
fn in_image(pdos: &[&EsiPdo]) -> Vec<Pdo> {
    let mut image: Vec<Pdo> = Vec::new();
    let mut before = None;
    for pdo in pdos {
        let open_bits = process_data::bits(&image) % 8;
        let begins = before.is_some_and(|before| before != pdo.sync_manager);
        if begins
            && open_bits != 0
            && let Some(last) = image.last_mut()
        {
            last.entries.push(Entry::of(0, 0, 8 - open_bits));
        }
        before = Some(pdo.sync_manager);
        image.push(as_it_is(pdo));
    }
    image
}

pub(crate) fn as_it_is(pdo: &EsiPdo) -> Pdo {
    let entries = pdo.entries.iter();
    Pdo {
        index: pdo.index,
        entries: entries
            .map(|entry| Entry::of(entry.index, entry.sub, entry.bits))
            .collect(),
    }
}

/// Whether an entry is so many switches.
fn is_switches(entry: &PdoEntry) -> bool {
    entry.data_type.starts_with("BITARR")
}

/// The channels of an entry; their numbers are for the caller to set.
fn channels_of(direction: ChannelDirection, pdo: &EsiPdo, entry: &PdoEntry) -> Vec<Channel> {
    let name = format!("{} {}", pdo.name, entry.name).trim().to_string();
    let is_input = direction == ChannelDirection::Input;
    let of_type = entry.data_type.as_str();
    let counts = is_input && entry.name.to_lowercase().contains("counter");
    let kind = match (entry.bits, of_type) {
        (1, _) => ChannelKind::Bool,
        _ if is_switches(entry) => ChannelKind::Bool,
        (32, "REAL") => ChannelKind::Real,
        (bits, _) if counts && bits >= 8 => ChannelKind::Counter,
        _ => ChannelKind::Int,
    };
    let channel = Channel {
        number: 0,
        name,
        direction,
        kind,
        index: entry.index,
        sub: entry.sub,
        first_bit: 0,
        bits: None,
        signed: kind == ChannelKind::Int && matches!(of_type, "SINT" | "INT" | "DINT"),
        scale: 1.0,
        offset: 0.0,
        unit: String::new(),
    };
    if kind != ChannelKind::Bool || entry.bits == 1 {
        return vec![channel];
    }
    let bits = 0..entry.bits;
    bits.map(|bit| Channel {
        name: format!("{} bit {bit}", channel.name),
        first_bit: bit,
        ..channel.clone()
    })
    .collect()
}
