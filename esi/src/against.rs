//! A drive file against the vendor's ESI file.

use machine::settings_file::Rules;

use crate::mapping;
use crate::terminal::{as_it_is, terminal_from_esi};
use crate::{Device, Esi, Pdo as EsiPdo, Purpose};
use fieldbus::cia402;
use fieldbus::drive_file::rules::{Direction, WATCHDOG, directions};
use fieldbus::drive_file::{DriveFile, Identity, ManagerPurpose, Mapping};
use fieldbus::process_data::Pdo;
use fieldbus::terminal_file::TerminalFile;

/// Judges a drive file against an ESI file; where that has no such drive, nothing else is said.
pub fn judge(rules: &mut Rules<'_>, drive: &DriveFile, esi: &Esi) {
    let Some(device) = same_device(rules, &drive.identity, esi) else {
        return;
    };
    let device = with_its_modules(device, drive);
    for direction in directions(&drive.process_data) {
        judge_direction(rules, &direction, drive, device);
    }
    judge_limits(rules, drive, device);
    judge_start_up(rules, drive, device);
    judge_mode(rules, drive, device);
    judge_mailbox(rules, drive, device);
    judge_sync_managers(rules, drive, device);
    judge_sync_modes(rules, drive, device);
}

/// The device with the modules that a drive file was made for: those that have its PDOs.
fn with_its_modules<'a>(device: &'a Device, drive: &DriveFile) -> &'a Device {
    let data = &drive.process_data;
    let has = |variant: &&Device| {
        let receives = |pdo: &Pdo| variant.receive_pdo(pdo.index).is_some();
        let transmits = |pdo: &Pdo| variant.transmit_pdo(pdo.index).is_some();
        data.receive.iter().all(receives) && data.transmit.iter().all(transmits)
    };
    // Where several have PDOs of these numbers, it is the one whose module is written.
    let modules = |device: &Device| -> Vec<(u16, u8, i64)> {
        let commands = device.init_commands.iter();
        let of_modules = commands.filter(|of| of.index == cia402::CONFIGURED_MODULES);
        of_modules
            .map(|of| (of.index, of.sub, of.value as i64))
            .collect()
    };
    let writes = |variant: &&Device| {
        let sdos = &drive.start_up.sdos;
        modules(variant).iter().all(|wanted| {
            let written = |sdo: &fieldbus::drive_file::Sdo| (sdo.index, sdo.sub, sdo.value);
            sdos.iter().any(|sdo| written(sdo) == *wanted)
        })
    };
    let variants = device.variants.iter();
    let mut fitting = variants.filter(has);
    fitting
        .clone()
        .find(writes)
        .or(fitting.next())
        .unwrap_or(device)
}

/// Judges a terminal file against an ESI file; where that has no such device, nothing else is said.
pub fn judge_terminal(rules: &mut Rules<'_>, terminal: &TerminalFile, esi: &Esi) {
    let Some(device) = same_device(rules, &terminal.identity, esi) else {
        return;
    };
    let data = &terminal.process_data;
    // As they are, and with what fills up the bytes of a sync manager.
    let offered = device.receive.iter().chain(&device.transmit);
    let mut known: Vec<Pdo> = offered.map(as_it_is).collect();
    if let Ok(TerminalFile { process_data, .. }) = terminal_from_esi(esi, device) {
        known.extend(
            process_data
                .receive
                .into_iter()
                .chain(process_data.transmit),
        );
    }
    let objects = |pdo: &Pdo| -> Vec<(u16, u8, u32)> {
        let entries = pdo.entries.iter();
        entries.map(|of| (of.index, of.sub, of.bits)).collect()
    };
    for (key, pdos) in [("receive", &data.receive), ("transmit", &data.transmit)] {
        for (at, pdo) in pdos.iter().enumerate() {
            let same = |known: &Pdo| known.index == pdo.index && objects(known) == objects(pdo);
            if data.mapping == Mapping::Fixed && !known.iter().any(same) {
                let (number, index, file) = ((at + 1).to_string(), pdo.index, &esi.file);
                let what = format!(
                    "= 0x{index:04X}: is another one in {file}: make the terminal file again"
                );
                rules.say(&["process_data", key, &number, "index"], None, &what);
            }
        }
    }
}

/// The device that a file names.
fn same_device<'a>(rules: &mut Rules<'_>, identity: &Identity, esi: &'a Esi) -> Option<&'a Device> {
    let file = &esi.file;
    if identity.vendor != esi.vendor {
        let what = format!(
            "= 0x{:08X}: {file} is of vendor 0x{:08X} ({}): take the ESI file of this device",
            identity.vendor, esi.vendor, esi.vendor_name
        );
        rules.say(&["identity", "vendor"], None, &what);
        return None;
    }
    let devices = esi.devices.iter();
    let is_of_product = |device: &&Device| device.product_code == identity.product_code;
    let of_product: Vec<&Device> = devices.clone().filter(is_of_product).collect();
    if of_product.is_empty() {
        let mut codes: Vec<u32> = devices.map(|device| device.product_code).collect();
        codes.dedup();
        let (code, codes) = (identity.product_code, hexadecimal(8, codes));
        let what = format!("= 0x{code:08X}: {file} has {codes}");
        rules.say(&["identity", "product_code"], None, &what);
        return None;
    }
    let revisions = || of_product.iter().map(|device| device.revision);
    let found = revisions().position(|revision| revision == identity.revision);
    if found.is_none() {
        let (revision, revisions) = (identity.revision, hexadecimal(8, revisions()));
        let what = format!(
            "= 0x{revision:08X}: of this product {file} has {revisions}: make the file again with --revision, or take the ESI file of this revision"
        );
        rules.say(&["identity", "revision"], None, &what);
    }
    of_product.get(found?).copied()
}

/// Numbers of so many digits, with commas between.
fn hexadecimal(digits: usize, numbers: impl IntoIterator<Item: Into<u32>>) -> String {
    let numbers = numbers.into_iter().map(Into::<u32>::into);
    let numbers = numbers.map(|number| format!("0x{number:0digits$X}"));
    numbers.collect::<Vec<_>>().join(", ")
}

fn judge_direction(
    rules: &mut Rules<'_>,
    direction: &Direction<'_>,
    drive: &DriveFile,
    device: &Device,
) {
    let receives = direction.key == "receive";
    for (at, pdo) in direction.pdos.iter().enumerate() {
        let (found, all) = if receives {
            (device.receive_pdo(pdo.index), &device.receive)
        } else {
            (device.transmit_pdo(pdo.index), &device.transmit)
        };
        let index = pdo.index;
        let Some(of_esi) = found else {
            let there = hexadecimal(4, all.iter().map(|pdo| pdo.index));
            let what = format!("= 0x{index:04X}: the drive has no such PDO: it has {there}");
            direction.say(rules, at, "index", &what);
            continue;
        };
        judge_exclusion(rules, direction, at, of_esi);
        let assigns = device.mailbox.is_some_and(|mailbox| mailbox.pdo_assign);
        if of_esi.sync_manager.is_none() && !assigns {
            let what =
                format!("= 0x{index:04X}: the drive exchanges another PDO, and takes no choice");
            direction.say(rules, at, "index", &what);
        }
        match direction.mapping {
            Mapping::Written => {
                // Where the drive file itself says that nothing can be written, it is judged already.
                if drive.mailbox.pdo_config {
                    judge_written(rules, direction, device, of_esi);
                }
                judge_objects(rules, direction, at, device);
            }
            Mapping::Fixed => judge_fixed(rules, direction, at, pdo, of_esi),
        }
    }
}

fn judge_exclusion(rules: &mut Rules<'_>, direction: &Direction<'_>, at: usize, of_esi: &EsiPdo) {
    let mut before = direction.pdos.iter().take(at);
    if let Some(other) = before.find(|other| of_esi.excludes.contains(&other.index)) {
        let what = format!(
            "= 0x{:04X}: the drive does not exchange it together with 0x{:04X}; leave out one of the two",
            of_esi.index, other.index
        );
        direction.say(rules, at, "index", &what);
    }
}

fn judge_written(
    rules: &mut Rules<'_>,
    direction: &Direction<'_>,
    device: &Device,
    of_esi: &EsiPdo,
) {
    if mapping::can_be_written(device, of_esi) {
        return;
    }
    let key = format!("{}_mapping", direction.key);
    let what = format!(
        "= \"written\": the entries of PDO 0x{:04X} are fixed: write \"fixed\", and its own entries",
        of_esi.index
    );
    rules.say(&["process_data", &key], None, &what);
}

/// Whether the drive has every object of a PDO that is written, in this size, and lets it be mapped.
fn judge_objects(rules: &mut Rules<'_>, direction: &Direction<'_>, at: usize, device: &Device) {
    let Some(pdo) = direction.pdos.get(at) else {
        return;
    };
    for (entry_at, entry) in pdo.entries.iter().enumerate() {
        if entry.is_gap() {
            continue;
        }
        let mut say = |what: &str| direction.say_of_entry(rules, [at, entry_at], what);
        let object = cia402::named(entry.index, entry.sub);
        let Some(known) = device.object(entry.index, entry.sub) else {
            say(&format!(
                "is {object}: the drive has no such object; remove the entry"
            ));
            continue;
        };
        let (bits, right) = (entry.bits, known.bits);
        if right != 0 && right != bits {
            say(&format!("is {object} with {bits} bits: it has {right}"));
        }
        let (may, where_to) = match direction.key {
            "receive" => (known.receive, "receives"),
            _ => (known.transmit, "transmits"),
        };
        if !may {
            say(&format!(
                "is {object}: the drive does not let it be mapped into what it {where_to}; remove the entry"
            ));
        }
    }
}

/// A PDO that is taken as it is must be the one that the drive has, entry by entry.
fn judge_fixed(
    rules: &mut Rules<'_>,
    direction: &Direction<'_>,
    at: usize,
    pdo: &Pdo,
    of_esi: &EsiPdo,
) {
    let expected = |entry_at: usize| of_esi.entries.get(entry_at);
    for (entry_at, entry) in pdo.entries.iter().enumerate() {
        let found = entry.words();
        let what = match expected(entry_at) {
            Some(of_esi) => {
                let is = fieldbus::process_data::Entry::of(of_esi.index, of_esi.sub, of_esi.bits);
                let same = (entry.index, entry.bits) == (is.index, is.bits)
                    && (entry.is_gap() || entry.sub == is.sub);
                if same {
                    continue;
                }
                format!("is {found}: the fixed PDO has {} there", is.words())
            }
            None => format!(
                "is {found}: the fixed PDO has {} entries",
                of_esi.entries.len()
            ),
        };
        // What follows is shifted, and would be wrong too.
        return direction.say_of_entry(rules, [at, entry_at], &what);
    }
    if let Some(lacking) = expected(pdo.entries.len()) {
        let is = fieldbus::process_data::Entry::of(lacking.index, lacking.sub, lacking.bits);
        let what = format!(
            "ends before {}, which the fixed PDO has; add it",
            is.words()
        );
        direction.say(rules, at, "entries", &what);
    }
}

fn judge_limits(rules: &mut Rules<'_>, drive: &DriveFile, device: &Device) {
    let purposes = [
        (Purpose::Outputs, cia402::RECEIVE_ASSIGN),
        (Purpose::Inputs, cia402::TRANSMIT_ASSIGN),
    ];
    for (direction, (purpose, assign)) in directions(&drive.process_data).iter().zip(purposes) {
        let key = direction.key;
        let manager = device.sync_manager(purpose);
        let bytes_max = manager.and_then(|manager| manager.size_max).map(u32::from);
        let written = direction
            .pdos
            .iter()
            .filter(|_| direction.mapping == Mapping::Written);
        let entries_max = written
            .filter_map(|pdo| mapping::entries_max(device, pdo.index))
            .min();
        let pdos_max = mapping::entries_max(device, assign);
        for (name, found, most) in [
            ("entries", direction.entries_max, entries_max),
            ("pdos", direction.pdos_max, pdos_max),
            ("bytes", direction.bytes_max, bytes_max),
        ] {
            let Some(most) = most.filter(|most| found.is_none_or(|found| found > *most)) else {
                continue;
            };
            let found = found.map_or("is left out".into(), |found| format!("= {found}"));
            let key = format!("{key}_{name}");
            let what = format!("{found}: the drive takes {most}; write {most}");
            rules.say(&["process_data", "limits", &key], None, &what);
        }
    }
}

fn judge_start_up(rules: &mut Rules<'_>, drive: &DriveFile, device: &Device) {
    let dictionary = &device.dictionary;
    if dictionary.is_empty() {
        return;
    }
    if drive.start_up.interpolation_time {
        for sub in [1, 2] {
            if !dictionary.writes(cia402::INTERPOLATION_TIME, sub) {
                let what =
                    format!("= true: the drive has no 60C2:{sub} that can be written; write false");
                rules.say(&["start_up", "interpolation_time"], None, &what);
                break;
            }
        }
    }
    if drive.start_up.following_error_window
        && !dictionary.writes(cia402::FOLLOWING_ERROR_WINDOW, 0)
    {
        let what = "= true: the drive has no 6065 that can be written; write false";
        rules.say(&["start_up", "following_error_window"], None, what);
    }
    for (at, sdo) in drive.start_up.sdos.iter().enumerate() {
        let number = (at + 1).to_string();
        let path = ["start_up", "sdo", &number];
        let object = cia402::named(sdo.index, sdo.sub);
        let Some(known) = device.object(sdo.index, sdo.sub) else {
            let what = format!("writes {object}: the drive has no such object; remove it");
            rules.say(&path, None, &what);
            continue;
        };
        if known.writable == Some(false) {
            let what = format!("writes {object}: the drive lets it be read only; remove it");
            rules.say(&path, None, &what);
        }
        if known.bits != 0 && known.bits != sdo.bits {
            let what = format!("= {} bits: {object} has {}", sdo.bits, known.bits);
            rules.say(&["start_up", "sdo", &number, "bits"], None, &what);
        }
        let (low, high) = (known.min.unwrap_or(i64::MIN), known.max.unwrap_or(i64::MAX));
        if low <= high && !(low..=high).contains(&sdo.value) {
            let value = sdo.value;
            let what = format!("= {value}: {object} takes {low} to {high}");
            rules.say(&["start_up", "sdo", &number, "value"], None, &what);
        }
    }
}

fn judge_mode(rules: &mut Rules<'_>, drive: &DriveFile, device: &Device) {
    let supported = device.dictionary.default_of(cia402::SUPPORTED_MODES, 0);
    let supported = cia402::DriveMode::of(supported.unwrap_or(0));
    let mode = drive.mode.operate;
    // Where the drive file itself says that the drive has no such mode, it is judged already.
    let own = &drive.mode.supported;
    if !own.is_empty() && !own.contains(&mode.as_drive_mode()) {
        return;
    }
    if !supported.is_empty() && !supported.contains(&mode.as_drive_mode()) {
        let (mode, can) = (mode.word(), cia402::DriveMode::words(&supported));
        let what = format!("= \"{mode}\": the drive supports {can} (6502)");
        rules.say(&["mode", "operate"], None, &what);
    }
}

fn judge_mailbox(rules: &mut Rules<'_>, drive: &DriveFile, device: &Device) {
    let Some(known) = device.mailbox else {
        rules.say(&["mailbox"], None, "is there: the drive has none");
        return;
    };
    let own = &drive.mailbox;
    let mut differs = |key: &str, found: bool, is: bool| {
        if found != is {
            let what = format!("= {found}: the drive has {is}; write {is}");
            rules.say(&["mailbox", key], None, &what);
        }
    };
    differs(
        "complete_access",
        own.complete_access,
        known.complete_access,
    );
    differs("pdo_assign", own.pdo_assign, known.pdo_assign);
    differs("pdo_config", own.pdo_config, known.pdo_config);
    differs("sdo_info", own.sdo_info, known.sdo_info);
}

fn judge_sync_managers(rules: &mut Rules<'_>, drive: &DriveFile, device: &Device) {
    let (found, known) = (drive.sync_managers.len(), device.sync_managers.len());
    if found != known {
        let what = format!("is there {found} times: the drive has {known} sync managers");
        rules.say(&["sync_manager"], None, &what);
    }
    let pairs = drive.sync_managers.iter().zip(&device.sync_managers);
    for (at, (own, known)) in pairs.enumerate() {
        let number = (at + 1).to_string();
        let mut differs = |key: &str, found: u32, is: u32| {
            if found != is {
                let what = format!("= 0x{found:X}: the drive has 0x{is:X}; write 0x{is:X}");
                rules.say(&["sync_manager", &number, key], None, &what);
            }
        };
        differs("start", own.start.into(), known.start.into());
        // The watchdog of the outputs may be switched on where the vendor leaves it off.
        let watchdog = match own.purpose {
            ManagerPurpose::Outputs => own.control & WATCHDOG,
            _ => 0,
        };
        let control = known.control | watchdog;
        differs("control", own.control.into(), control.into());
        let is_mailbox =
            [ManagerPurpose::MailboxOut, ManagerPurpose::MailboxIn].contains(&own.purpose);
        if is_mailbox {
            differs("size_bytes", own.size_bytes.into(), known.size.into());
        }
    }
}

fn judge_sync_modes(rules: &mut Rules<'_>, drive: &DriveFile, device: &Device) {
    for (at, mode) in drive.sync_modes.iter().enumerate() {
        let mut known = device.sync_modes.iter();
        if !known.any(|known| known.assign_activate == mode.assign_activate) {
            let number = (at + 1).to_string();
            let all = device.sync_modes.iter();
            let all = match hexadecimal(4, all.map(|known| known.assign_activate)) {
                none if none.is_empty() => "none".into(),
                all => all,
            };
            let found = mode.assign_activate;
            let what =
                format!("= 0x{found:04X}: the drive has {all}; remove it or write one of them");
            rules.say(&["sync_mode", &number, "assign_activate"], None, &what);
        }
    }
}
