//! Reads one `Device` of an ESI file.

use roxmltree::Node;

use super::number;
use super::xml::{
    at, child, children, english, flag_in, line, number_in, number_of, text, text_of,
};
use super::{
    Device, Dictionary, InitCommand, Mailbox, Pdo, PdoEntry, Purpose, SyncManager, SyncMode,
};

/// What cannot be understood, and its line.
pub(super) type Wrong = (u32, String);

impl Device {
    /// Reads a device; its line is for the caller to set.
    ///
    /// # Errors
    /// Identity or process data cannot be understood.
    pub(super) fn read<'a>(node: Node<'a, 'a>) -> Result<Device, Wrong> {
        let of_type = child(node, "Type");
        let identity = |attribute| match of_type {
            Some(of_type) if of_type.has_attribute(attribute) => {
                let found = of_type.attribute(attribute).unwrap_or_default();
                let number = number_in::<u32>(of_type, attribute);
                number.ok_or_else(|| {
                    let what =
                        format!("{attribute} = {found:?}: must be a number such as #x00010420");
                    (line(of_type), what)
                })
            }
            _ => Ok(0),
        };
        let type_name = of_type.map(text).unwrap_or_default().to_string();
        let profile = child(node, "Profile");
        let dictionary = profile.and_then(|profile| child(profile, "Dictionary"));
        let pdos = |name| children(node, name).map(pdo).collect::<Result<Vec<_>, _>>();
        Ok(Device {
            line: 0,
            product_code: identity("ProductCode")?,
            revision: identity("RevisionNo")?,
            name: english(node, "Name").unwrap_or(&type_name).to_string(),
            type_name,
            profiles: profile.map(profiles).unwrap_or_default(),
            receive: pdos("RxPdo")?,
            transmit: pdos("TxPdo")?,
            sync_managers: children(node, "Sm").map(sync_manager).collect(),
            mailbox: child(node, "Mailbox").map(|mailbox| mailbox_of(node, mailbox)),
            sync_modes: child(node, "Dc").map(sync_modes).unwrap_or_default(),
            init_commands: init_commands(node),
            dictionary: dictionary.map(Dictionary::read).unwrap_or_default(),
            modular: child(node, "Slots").is_some(),
            variants: Vec::new(),
        })
    }
}

/// The profiles of a device, or of the channels of one with several.
pub(super) fn profiles<'a>(profile: Node<'a, 'a>) -> Vec<u32> {
    let own = number_of::<u32>(profile, "ProfileNo");
    let channels = children(profile, "ChannelInfo");
    let channels = channels.filter_map(|channel| number_of::<u32>(channel, "ProfileNo"));
    own.into_iter().chain(channels).collect()
}

pub(super) fn pdo<'a>(node: Node<'a, 'a>) -> Result<Pdo, Wrong> {
    let index = number_of::<u16>(node, "Index").ok_or_else(|| {
        let what = "a PDO without an index: <Index> must be a number such as #x1600";
        (line(node), what.to_string())
    })?;
    // What can be mapped and is not may stand there as an entry without a size.
    let is_there = |entry: &Node<'_, '_>| {
        let is_gap = number_of::<u16>(*entry, "Index").unwrap_or(0) == 0;
        !is_gap || number_of::<u32>(*entry, "BitLen") != Some(0)
    };
    let entries = children(node, "Entry").filter(is_there).map(|entry| {
        let wrong = |what: &str| {
            (
                line(entry),
                format!("an entry of PDO 0x{index:04X}: {what}"),
            )
        };
        // A gap has index 0, or none.
        let object = match text_of(entry, "Index") {
            Some(text) => number::narrow(text)
                .ok_or_else(|| wrong("<Index> must be a number such as #x6040"))?,
            None => 0,
        };
        let bits = number_of::<u32>(entry, "BitLen").filter(|bits| (1..=64 * 1024).contains(bits));
        let bits = bits.ok_or_else(|| wrong("<BitLen> must be a number of bits from 1"))?;
        Ok(PdoEntry {
            index: object,
            sub: number_of(entry, "SubIndex").unwrap_or(0),
            bits,
            name: english(entry, "Name").unwrap_or_default().to_string(),
            data_type: text_of(entry, "DataType").unwrap_or_default().to_string(),
        })
    });
    Ok(Pdo {
        index,
        name: english(node, "Name").unwrap_or_default().to_string(),
        fixed: flag_in(node, "Fixed"),
        sync_manager: number_in(node, "Sm"),
        excludes: children(node, "Exclude")
            .filter_map(|exclude| number::narrow(text(exclude)))
            .collect(),
        entries: entries.collect::<Result<_, Wrong>>()?,
    })
}

fn sync_manager(node: Node<'_, '_>) -> SyncManager {
    let purpose = match node.text().unwrap_or_default().trim() {
        "MBoxOut" => Some(Purpose::MailboxOut),
        "MBoxIn" => Some(Purpose::MailboxIn),
        "Outputs" => Some(Purpose::Outputs),
        "Inputs" => Some(Purpose::Inputs),
        _ => None,
    };
    SyncManager {
        purpose,
        start: number_in(node, "StartAddress").unwrap_or(0),
        control: number_in(node, "ControlByte").unwrap_or(0),
        size: number_in(node, "DefaultSize").unwrap_or(0),
        size_max: number_in(node, "MaxSize").filter(|size| *size > 0),
    }
}

fn mailbox_of<'a>(device: Node<'a, 'a>, mailbox: Node<'a, 'a>) -> Mailbox {
    let timeout = |name| {
        let timeouts = at(device, &["Info", "Mailbox", "Timeout"])?;
        number_of(timeouts, name)
    };
    let coe = child(mailbox, "CoE");
    let can = |attribute| coe.is_some_and(|coe| flag_in(coe, attribute));
    Mailbox {
        coe: coe.is_some(),
        complete_access: can("CompleteAccess"),
        pdo_assign: can("PdoAssign"),
        pdo_config: can("PdoConfig"),
        sdo_info: can("SdoInfo"),
        request_timeout_ms: timeout("RequestTimeout"),
        response_timeout_ms: timeout("ResponseTimeout"),
    }
}

fn sync_modes<'a>(dc: Node<'a, 'a>) -> Vec<SyncMode> {
    let modes = children(dc, "OpMode").map(|mode| {
        let cycle = child(mode, "CycleTimeSync0");
        SyncMode {
            name: text_of(mode, "Name").unwrap_or_default().to_string(),
            assign_activate: number_of(mode, "AssignActivate").unwrap_or(0),
            sync0_cycle_ns: number_of(mode, "CycleTimeSync0").unwrap_or(0),
            sync0_cycle_factor: cycle
                .and_then(|cycle| number_in(cycle, "Factor"))
                .unwrap_or(1),
            sync0_shift_ns: number_of(mode, "ShiftTimeSync0").unwrap_or(0),
            sync1_shift_ns: number_of(mode, "ShiftTimeSync1").unwrap_or(0),
        }
    });
    modes.collect()
}

/// SDOs before operation; those that only a change of other states wants are left out.
fn init_commands<'a>(device: Node<'a, 'a>) -> Vec<InitCommand> {
    let Some(coe) = at(device, &["Mailbox", "CoE"]) else {
        return Vec::new();
    };
    let commands = children(coe, "InitCmd").filter(|command| {
        children(*command, "Transition").any(|transition| text(transition) == "PS")
    });
    let commands = commands.filter_map(|command| {
        let data = text_of(command, "Data")?;
        let digits = data.chars().filter(char::is_ascii_hexdigit).count();
        Some(InitCommand {
            index: number_of(command, "Index")?,
            sub: number_of(command, "SubIndex").unwrap_or(0),
            bits: u32::try_from(digits).ok()? * 4,
            value: number::little_endian(data)?,
            comment: english(command, "Comment").unwrap_or_default().to_string(),
        })
    });
    commands.collect()
}
