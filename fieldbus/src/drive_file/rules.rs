//! What must hold between the keys of a drive file.

use machine::settings_file::Rules;

use crate::cia402::{self, DriveMode, Effect, OperatingMode, OptionCode};
use crate::drive_file::keys::{DriveFile, ManagerPurpose, Mapping, ProcessData};
use crate::process_data::{self, Pdo};

/// What a device transmits begins here; what it receives ends before.
const TRANSMIT_FIRST: u16 = 0x1A00;

/// Bit of a sync manager's control byte that lets it trigger the watchdog (ETG.1000.4).
pub const WATCHDOG: u8 = 0x40;

/// Judges a drive file by itself.
pub fn judge(rules: &mut Rules<'_>, drive: &DriveFile) {
    judge_scaling(rules, drive);
    judge_mode(rules, drive);
    judge_process_data(rules, drive);
    judge_start_up(rules, drive);
    judge_option_codes(rules, drive);
    judge_sync_managers(rules, drive);
}

/// One direction of the process data.
pub struct Direction<'a> {
    /// Its key.
    pub key: &'static str,
    /// Its PDOs.
    pub pdos: &'a [Pdo],
    /// What becomes of their entries.
    pub mapping: Mapping,
    /// Most entries of a PDO that is written.
    pub entries_max: Option<u32>,
    /// Most PDOs.
    pub pdos_max: Option<u32>,
    /// Most bytes.
    pub bytes_max: Option<u32>,
}

impl Direction<'_> {
    /// Says what is wrong with a key of a PDO, by its place.
    pub fn say(&self, rules: &mut Rules<'_>, at: usize, key: &str, what: &str) {
        let number = (at + 1).to_string();
        rules.say(&["process_data", self.key, &number, key], None, what);
    }

    /// Says what is wrong with an entry of a PDO, by their places.
    pub fn say_of_entry(&self, rules: &mut Rules<'_>, at: [usize; 2], what: &str) {
        let [pdo, entry] = at.map(|at| (at + 1).to_string());
        let path = ["process_data", self.key, &pdo, "entries", &entry];
        rules.say(&path, None, what);
    }
}

/// Both directions of the process data.
pub fn directions(data: &ProcessData) -> [Direction<'_>; 2] {
    let limits = &data.limits;
    [
        Direction {
            key: "receive",
            pdos: &data.receive,
            mapping: data.receive_mapping,
            entries_max: limits.receive_entries,
            pdos_max: limits.receive_pdos,
            bytes_max: limits.receive_bytes,
        },
        Direction {
            key: "transmit",
            pdos: &data.transmit,
            mapping: data.transmit_mapping,
            entries_max: limits.transmit_entries,
            pdos_max: limits.transmit_pdos,
            bytes_max: limits.transmit_bytes,
        },
    ]
}

fn judge_scaling(rules: &mut Rules<'_>, drive: &DriveFile) {
    let scaling = &drive.scaling;
    let transmit = &drive.process_data.transmit;
    let shows_position = process_data::find(transmit, cia402::POSITION, 0).is_some();
    let needs_position = shows_position || drive.mode.operate.drives_axes();
    #[rustfmt::skip] // a table
    let keys = [
        ("position_increments", scaling.position_increments == 0 && needs_position, "write the increments of the position (6064) in one turn of the motor, from 608F and 6091 or the data sheet"),
        ("velocity_units", scaling.velocity_units == 0, "write the value of the velocity (606C) at velocity_rpm: at 60 the increments of one turn where the drive counts increments/s"),
        ("rated_torque_nm", scaling.rated_torque_nm == 0.0, "write the rated torque of the motor in N·m, from its data sheet or 6076"),
        ("direction", scaling.direction == 0, "write 1 where the drive counts up in the positive direction of the axis, -1 where it counts down"),
        ("dead_time_scans", scaling.dead_time_scans == 0, "write 2 for a drive that follows SYNC0, 1 for one that does not, and more where the drive adds its own"),
    ];
    for (key, _, what) in keys.into_iter().filter(|(_, missing, _)| *missing) {
        let what = format!("is not filled in: {what}");
        rules.say(&["scaling", key], None, &what);
    }
}

fn judge_mode(rules: &mut Rules<'_>, drive: &DriveFile) {
    let mode = drive.mode.operate;
    let supported = &drive.mode.supported;
    if !supported.is_empty() && !supported.contains(&mode.as_drive_mode()) {
        let what = format!(
            "= \"{}\": the drive supports {}",
            mode.word(),
            DriveMode::words(supported)
        );
        rules.say(&["mode", "operate"], None, &what);
    }
    let data = &drive.process_data;
    for (key, pdos, needed) in [
        ("receive", &data.receive, mode.receive_needed()),
        ("transmit", &data.transmit, mode.transmit_needed()),
    ] {
        for index in process_data::missing(pdos, needed) {
            let object = cia402::named(index, 0);
            let mode = mode.word();
            let what = format!(
                "has no {object}: mode {mode} needs it; add it, take a PDO that holds it, or choose another mode.operate"
            );
            rules.say(&["process_data", key], None, &what);
        }
    }
    let mode_is_set = process_data::find(&data.receive, cia402::MODE, 0).is_some()
        || start_value(drive, cia402::MODE, 0) == Some(mode.value());
    if !mode_is_set {
        let value = mode.value();
        let what = format!(
            "does not set the mode: write {value} to 6060 with an [[start_up.sdo]], or add 6060 to process_data.receive"
        );
        rules.say(&["start_up"], None, &what);
    }
}

fn judge_process_data(rules: &mut Rules<'_>, drive: &DriveFile) {
    for direction in directions(&drive.process_data) {
        if direction.mapping == Mapping::Written && !drive.mailbox.pdo_config {
            let key = format!("{}_mapping", direction.key);
            let what = "= \"written\": mailbox.pdo_config = false: the drive's entries are fixed: write \"fixed\", and the drive's own entries";
            rules.say(&["process_data", &key], None, what);
        }
        judge_limits(rules, &direction);
        for (at, pdo) in direction.pdos.iter().enumerate() {
            if let Some(what) = wrong_index(direction.key, pdo) {
                direction.say(rules, at, "index", &what);
            }
            judge_entries(rules, &direction, at);
        }
    }
}

/// What is wrong with the index of a PDO of this direction.
pub fn wrong_index(key: &str, pdo: &Pdo) -> Option<String> {
    let index = pdo.index;
    ((index >= TRANSMIT_FIRST) != (key == "transmit")).then(|| {
        format!("= 0x{index:04X}: PDOs that a device receives are 0x1600 to 0x17FF, those that it transmits 0x1A00 to 0x1BFF")
    })
}

fn judge_limits(rules: &mut Rules<'_>, direction: &Direction<'_>) {
    let path = ["process_data", direction.key];
    let bits = process_data::bits(direction.pdos);
    if !bits.is_multiple_of(8) {
        let gap = 8 - bits % 8;
        let what = format!("is {bits} bits, no whole bytes: add a gap, {{ bits = {gap} }}");
        rules.say(&path, None, &what);
    }
    let bytes = process_data::bytes(direction.pdos);
    if let Some(most) = direction.bytes_max.filter(|most| bytes > *most) {
        let what = format!(
            "is {bytes} bytes: the drive takes {most}; leave out what the mode does not need"
        );
        rules.say(&path, None, &what);
    }
    let count = direction.pdos.len();
    if let Some(most) = direction.pdos_max.filter(|most| count > *most as usize) {
        let what = format!("has {count} PDOs: the drive takes {most}");
        rules.say(&path, None, &what);
    }
    for (at, pdo) in direction.pdos.iter().enumerate() {
        let count = pdo.entries.len();
        let written = direction.mapping == Mapping::Written;
        let most = direction
            .entries_max
            .filter(|most| written && count > *most as usize);
        if let Some(most) = most {
            let what = format!(
                "has {count} entries: the drive takes {most}; leave out what the mode does not need"
            );
            direction.say(rules, at, "entries", &what);
        }
    }
}

fn judge_entries(rules: &mut Rules<'_>, direction: &Direction<'_>, pdo_at: usize) {
    let Some(pdo) = direction.pdos.get(pdo_at) else {
        return;
    };
    for (entry_at, entry) in pdo.entries.iter().enumerate() {
        let mut say = |object: String, what: &str| {
            direction.say_of_entry(rules, [pdo_at, entry_at], &format!("is {object} {what}"));
        };
        let object = || cia402::number(entry.index, entry.sub);
        let standard = cia402::standard(entry.index, entry.sub);
        if let Some((name, bits)) = standard.filter(|(_, bits)| *bits != entry.bits) {
            let found = entry.bits;
            say(
                object(),
                &format!("({name}) with {found} bits: it has {bits}"),
            );
        }
        if !entry.is_gap() && stood_before(direction.pdos, pdo_at, entry_at) {
            say(
                object(),
                "once more: each object is in the process data once",
            );
        }
        if direction.key == "receive" && cia402::is_limit(entry.index) && entry.value == 0 {
            let what = "with value 0: the drive would be held back to 0; add value = …";
            say(cia402::named(entry.index, entry.sub), what);
        }
    }
}

/// Whether the object of an entry is in an entry before it.
fn stood_before(pdos: &[Pdo], pdo_at: usize, entry_at: usize) -> bool {
    let numbered = pdos.iter().enumerate().flat_map(|(pdo_at, pdo)| {
        let entries = pdo.entries.iter().enumerate();
        entries.map(move |(entry_at, entry)| ((pdo_at, entry_at), (entry.index, entry.sub)))
    });
    let own = numbered
        .clone()
        .find(|(at, _)| *at == (pdo_at, entry_at))
        .map(|(_, object)| object);
    let mut before = numbered.take_while(|(at, _)| *at < (pdo_at, entry_at));
    before.any(|(_, object)| Some(object) == own)
}

fn judge_start_up(rules: &mut Rules<'_>, drive: &DriveFile) {
    for (at, sdo) in drive.start_up.sdos.iter().enumerate() {
        let number = (at + 1).to_string();
        let object = cia402::named(sdo.index, sdo.sub);
        let (value, bits) = (sdo.value, sdo.bits);
        let mut say = |key, what: &str| rules.say(&["start_up", "sdo", &number, key], None, what);
        if ![8, 16, 32].contains(&bits) {
            say("bits", &format!("= {bits} bits: must be 8, 16 or 32"));
            continue;
        }
        let standard = cia402::standard(sdo.index, sdo.sub);
        if let Some((_, right)) = standard.filter(|(_, right)| *right != bits) {
            say("bits", &format!("= {bits} bits: {object} has {right}"));
        }
        let (low, high) = (-(1_i64 << (bits - 1)), (1_i64 << bits) - 1);
        if !(low..=high).contains(&value) {
            say(
                "value",
                &format!("= {value}: does not fit into {bits} bits"),
            );
        }
        let mode = drive.mode.operate;
        if sdo.index == cia402::MODE && value != mode.value() {
            let (word, right) = (mode.word(), mode.value());
            say(
                "value",
                &format!("= {value}: mode.operate = \"{word}\" is {right}"),
            );
        }
        let start_up = &drive.start_up;
        let set_anyway = match sdo.index {
            cia402::INTERPOLATION_TIME if start_up.interpolation_time => {
                "interpolation_time = true sets it to the scan"
            }
            cia402::FOLLOWING_ERROR_WINDOW if start_up.following_error_window => {
                "following_error_window = true sets it to the limit of the axis"
            }
            _ => continue,
        };
        let what = format!("is {object}: start_up.{set_anyway}; remove one of the two");
        rules.say(&["start_up", "sdo", &number], None, &what);
    }
}

/// What the start-up writes to an object.
fn start_value(drive: &DriveFile, index: u16, sub: u8) -> Option<i64> {
    let mut all = drive.start_up.sdos.iter().rev();
    all.find(|sdo| (sdo.index, sdo.sub) == (index, sub))
        .map(|sdo| sdo.value)
}

/// The code that is in force once the drive operates.
fn in_force(drive: &DriveFile, code: OptionCode) -> Option<i64> {
    let written = start_value(drive, code.index(), 0);
    written.or(drive.option_codes.of(code).map(i64::from))
}

/// A drive that coasts where it must brake is not driven.
fn judge_option_codes(rules: &mut Rules<'_>, drive: &DriveFile) {
    for code in [OptionCode::QuickStop, OptionCode::AbortConnection] {
        let Some(value) = in_force(drive, code) else {
            continue;
        };
        let effect = code.effect(value);
        if effect.may_coast() {
            let object = cia402::named(code.index(), 0);
            let what = format!(
                "= {value}: {object}: {}; set it to {} with an [[start_up.sdo]], or, where the manual says that it brakes, write here what \
                 means the same",
                effect.words(),
                code.braking()
            );
            rules.say(&["option_codes", code.key()], None, &what);
        }
    }
    judge_fault_at_silence(rules, drive);
}

/// Where silence of the bus is a fault, the fault reaction is what stops the axis.
fn judge_fault_at_silence(rules: &mut Rules<'_>, drive: &DriveFile) {
    let silence = in_force(drive, OptionCode::AbortConnection);
    let is_fault =
        silence.map(|value| OptionCode::AbortConnection.effect(value)) == Some(Effect::Fault);
    let code = OptionCode::FaultReaction;
    let Some(value) = in_force(drive, code).filter(|_| is_fault) else {
        return;
    };
    let effect = code.effect(value);
    if effect.may_coast() {
        let object = cia402::named(code.index(), 0);
        let what = format!(
            "= {value}: {object}: {}, and 6007 makes a fault of a bus that falls silent; set it to {} with an [[start_up.sdo]], or, where \
             the manual says that it brakes, write here what means the same",
            effect.words(),
            code.braking()
        );
        rules.say(&["option_codes", code.key()], None, &what);
    }
}

fn judge_sync_managers(rules: &mut Rules<'_>, drive: &DriveFile) {
    let order = [
        ManagerPurpose::MailboxOut,
        ManagerPurpose::MailboxIn,
        ManagerPurpose::Outputs,
        ManagerPurpose::Inputs,
    ];
    for (at, expected) in order.into_iter().enumerate() {
        let number = (at + 1).to_string();
        let Some(manager) = drive.sync_managers.get(at) else {
            continue;
        };
        let path = ["sync_manager", &number, "purpose"];
        if manager.purpose != expected {
            let what = format!(
                "= \"{}\": must be \"{}\": the order is mailbox-out, mailbox-in, outputs, inputs",
                manager.purpose.word(),
                expected.word()
            );
            rules.say(&path, None, &what);
        }
        if at < 2 && manager.size_bytes == 0 {
            let what = "= 0 bytes: a mailbox has a size, from the ESI file";
            rules.say(&["sync_manager", &number, "size_bytes"], None, what);
        }
    }
}

/// What the controller can do without, and what may not be meant so.
pub fn warnings(drive: &DriveFile) -> Vec<String> {
    let mut warnings = Vec::new();
    let mode = drive.mode.operate;
    let data = &drive.process_data;
    let received = process_data::missing(&data.receive, mode.receive_wanted());
    let transmitted = process_data::missing(&data.transmit, mode.transmit_wanted());
    for index in received.into_iter().chain(transmitted) {
        warnings.extend(lack_of(index, mode));
    }
    if drive.mode.supported.is_empty() {
        let mode = mode.word();
        warnings.push(format!(
            "modes: not known (6502); whether the drive has {mode} shows when it is switched on"
        ));
    }
    if !drive.start_up.interpolation_time {
        warnings.push(
            "60C2 (interpolation time): not set; set the drive's cycle to the scan of the machine with the vendor's own tool".into(),
        );
    }
    for code in OptionCode::ALL {
        warnings.extend(doubt_about(drive, code));
    }
    let mut managers = drive.sync_managers.iter();
    let outputs = managers.find(|manager| manager.purpose == ManagerPurpose::Outputs);
    if let Some(outputs) = outputs.filter(|outputs| outputs.control & WATCHDOG == 0) {
        let (found, with) = (outputs.control, outputs.control | WATCHDOG);
        warnings.push(format!(
            "sync manager of the outputs: its watchdog is off (control 0x{found:02X}): the drive may not notice that the bus falls silent; \
             write control = 0x{with:02X}, unless its manual forbids it"
        ));
    }
    warnings
}

/// What is lost without an object.
fn lack_of(index: u16, mode: OperatingMode) -> Option<String> {
    let without = match index {
        cia402::TORQUE_OFFSET => {
            "no torque is added by the controller: friction is not made up for at reversals"
        }
        cia402::VELOCITY_OFFSET => "no velocity is added by the controller: the axis lags behind",
        // Set at start-up then, which is judged.
        cia402::MODE => return None,
        cia402::VELOCITY => "the velocity is made from positions",
        cia402::POSITION => "no threads are cut and M19 is not done by the drive's encoder",
        cia402::TORQUE => "torque is not shown, and tuning finds no friction",
        cia402::ERROR_CODE => "the code of a fault is read after it, not with it",
        cia402::MODE_DISPLAY => "the mode is believed once it is read at start-up",
        _ => return None,
    };
    let object = cia402::named(index, 0);
    let mode = mode.word();
    Some(format!(
        "{object}: not in the process data of mode {mode}: {without}"
    ))
}

/// A code that may let the axis coast, or that nobody knows.
fn doubt_about(drive: &DriveFile, code: OptionCode) -> Option<String> {
    let object = cia402::named(code.index(), 0);
    let Some(value) = in_force(drive, code) else {
        let matters = !matches!(code, OptionCode::Halt | OptionCode::DisableOperation);
        return matters.then(|| {
            format!("{object}: not known; read in the manual what the drive does, and try it with an axis that may coast")
        });
    };
    let effect = code.effect(value);
    effect
        .may_coast()
        .then(|| format!("{object} = {value}: {}", effect.words()))
}
