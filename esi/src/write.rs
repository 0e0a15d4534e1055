//! Writes a drive file with its comments.

use std::fmt::Write as _;

use crate::Device;
use fieldbus::cia402::{self, OptionCode};
use fieldbus::drive_file::rules::directions;
use fieldbus::drive_file::{DriveFile, Identity, Limits, Mailbox, SyncManager};
use fieldbus::process_data::Pdo;
use fieldbus::terminal_file::TerminalFile;

/// Longest name of an object in a comment, in characters.
const NAME_CHARS_MAX: usize = 60;

/// Adds lines; writing into a text cannot fail.
macro_rules! add {
    ($text:expr, $($line:tt)*) => {{
        let _ = writeln!($text, $($line)*);
    }};
}

/// What stands before all keys.
const HEAD: &str = "\
# Drive file: what the controller must know of this drive. All keys: docs/reference/drive-file.md
#
# A 0 that is marked FILL IN is refused until it is filled in. Then, with the vendor's ESI file:
#   quadrant bus check DRIVE.toml --esi ESI.xml
#
# No drive file makes a machine safe: emergency stop and STO stay wired.
";

/// What stands before all keys of a terminal file.
const TERMINAL_HEAD: &str = "\
# Terminal file: what the controller must know of a device with inputs and outputs. All keys: docs/reference/terminal-file.md
#
# Numbers of channels are what [[signal]] of the machine file names: from = { terminal = PLACE, channel = NUMBER }. They may be changed
# here, and channels that nobody needs left out. No ESI file tells what a number means: of one that is volts or degrees write
# kind = \"float\" with scale, offset and unit.
";

/// The text of a terminal file that was made of this device.
pub fn write_terminal(terminal: &TerminalFile, device: &Device) -> String {
    let mut text = TERMINAL_HEAD.to_string();
    identity(&mut text, &terminal.identity);
    let data = &terminal.process_data;
    add!(text, "\n[process_data]");
    add!(text, "mapping = {}", quoted(data.mapping.word()));
    for (key, pdos) in [("receive", &data.receive), ("transmit", &data.transmit)] {
        for pdo in pdos {
            one_pdo(&mut text, key, pdo, device);
        }
    }
    for sdo in &terminal.sdos {
        add!(text, "\n[[sdo]] # {}", name(device, sdo.index, sdo.sub));
        let (index, sub, bits, value) = (sdo.index, sdo.sub, sdo.bits, sdo.value);
        add!(
            text,
            "index = 0x{index:04X}\nsub = {sub}\nbits = {bits}\nvalue = {value}"
        );
    }
    if let Some(of) = &terminal.mailbox {
        mailbox(&mut text, of);
    }
    for channel in &terminal.channels {
        add!(text, "\n[[channel]]");
        let (name, direction) = (quoted(&channel.name), quoted(channel.direction.word()));
        add!(
            text,
            "number = {}\nname = {name}\ndirection = {direction}",
            channel.number
        );
        add!(
            text,
            "kind = {}\nindex = 0x{:04X}",
            quoted(channel.kind.word()),
            channel.index
        );
        let (sub, first_bit, signed) = (channel.sub, channel.first_bit, channel.signed);
        add!(
            text,
            "sub = {sub}\nfirst_bit = {first_bit}\nsigned = {signed}"
        );
    }
    text
}

/// What must be filled in.
const SCALING: &str = "
# No ESI file tells these; 608F, 6091, 6076 of the drive and the data sheet of the motor do.
[scaling]
position_increments = 0   # FILL IN: increments of the position (6064) in position_turns turns of the motor
position_turns = 1
velocity_units = 0        # FILL IN: value of the velocity (606C) at velocity_rpm; at 60 the increments of one turn, if it counts increments/s
velocity_rpm = 60
rated_torque_nm = 0.0     # FILL IN: rated torque of the motor (6076), in N·m
direction = 0             # FILL IN: 1, or -1 where the drive counts down in the positive direction of the axis
dead_time_scans = 0       # FILL IN: 2 with SYNC0, 1 without, and what the drive adds
";

/// The text of a drive file that was made of this device; what must be filled in is 0.
pub fn write(drive: &DriveFile, device: &Device) -> String {
    let mut text = HEAD.to_string();
    identity(&mut text, &drive.identity);
    mode(&mut text, drive);
    text.push_str(SCALING);
    process_data(&mut text, drive, device);
    start_up(&mut text, drive, device);
    option_codes(&mut text, drive);
    mailbox(&mut text, &drive.mailbox);
    for (number, manager) in drive.sync_managers.iter().enumerate() {
        sync_manager(&mut text, number, manager);
    }
    sync_modes(&mut text, drive);
    text
}

/// Text as TOML has it.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_string()).to_string()
}

/// The name of an object, fit for a comment: one line, not too long.
fn name(device: &Device, index: u16, sub: u8) -> String {
    let own = device.object(index, sub).map(|object| object.name);
    let standard = || cia402::standard(index, sub).map(|(name, _)| name.to_string());
    let name = own.filter(|name| !name.is_empty()).or_else(standard);
    comment(&name.unwrap_or_default())
}

/// Text that is fit for a comment: one line, not too long.
fn comment(text: &str) -> String {
    let shown = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    let shown: String = shown.take(NAME_CHARS_MAX).collect();
    shown.trim().to_string()
}

fn identity(text: &mut String, identity: &Identity) {
    add!(text, "\n[identity]");
    add!(text, "vendor = 0x{:08X}", identity.vendor);
    add!(text, "vendor_name = {}", quoted(&identity.vendor_name));
    add!(text, "product_code = 0x{:08X}", identity.product_code);
    add!(text, "revision = 0x{:08X}", identity.revision);
    add!(text, "name = {}", quoted(&identity.name));
}

fn mode(text: &mut String, drive: &DriveFile) {
    let supported = drive.mode.supported.iter();
    let supported: Vec<String> = supported.map(|mode| quoted(mode.word())).collect();
    let known = if supported.is_empty() {
        "not known"
    } else {
        "as the drive comes (6502)"
    };
    add!(text, "\n[mode]");
    add!(text, "operate = {}", quoted(drive.mode.operate.word()));
    add!(text, "supported = [{}] # {known}", supported.join(", "));
}

fn process_data(text: &mut String, drive: &DriveFile, device: &Device) {
    let data = &drive.process_data;
    add!(
        text,
        "\n# fixed: PDOs as the drive has them; written: their entries are written at start-up."
    );
    add!(text, "[process_data]");
    add!(
        text,
        "receive_mapping = {}",
        quoted(data.receive_mapping.word())
    );
    add!(
        text,
        "transmit_mapping = {}",
        quoted(data.transmit_mapping.word())
    );
    limits(text, &data.limits);
    for direction in directions(data) {
        for pdo in direction.pdos {
            one_pdo(text, direction.key, pdo, device);
        }
    }
}

fn limits(text: &mut String, limits: &Limits) {
    add!(
        text,
        "\n# What the drive can take; what is left out is not known."
    );
    add!(text, "[process_data.limits]");
    for (key, most) in [
        ("receive_entries", limits.receive_entries),
        ("transmit_entries", limits.transmit_entries),
        ("receive_pdos", limits.receive_pdos),
        ("transmit_pdos", limits.transmit_pdos),
        ("receive_bytes", limits.receive_bytes),
        ("transmit_bytes", limits.transmit_bytes),
    ] {
        if let Some(most) = most {
            add!(text, "{key} = {most}");
        }
    }
}

fn one_pdo(text: &mut String, key: &str, pdo: &Pdo, device: &Device) {
    add!(text, "\n[[process_data.{key}]]");
    add!(text, "index = 0x{:04X}", pdo.index);
    add!(text, "entries = [");
    for entry in &pdo.entries {
        let bits = entry.bits;
        if entry.is_gap() {
            add!(text, "    {{ bits = {bits} }}, # gap");
            continue;
        }
        let index = entry.index;
        let sub = match entry.sub {
            0 => String::new(),
            sub => format!(", sub = {sub}"),
        };
        let value = match entry.value {
            0 => String::new(),
            value => format!(", value = {value}"),
        };
        let name = name(device, index, entry.sub);
        add!(
            text,
            "    {{ index = 0x{index:04X}{sub}, bits = {bits}{value} }}, # {name}"
        );
    }
    add!(text, "]");
}

fn start_up(text: &mut String, drive: &DriveFile, device: &Device) {
    let start_up = &drive.start_up;
    add!(
        text,
        "\n# Written to the drive, and read back, before it operates."
    );
    add!(text, "[start_up]");
    add!(
        text,
        "interpolation_time = {} # 60C2: the scan of the machine",
        start_up.interpolation_time
    );
    if start_up.following_error_window {
        add!(
            text,
            "following_error_window = true # 6065: following_error_limit_mm of the axis"
        );
    }
    for sdo in &start_up.sdos {
        add!(
            text,
            "\n[[start_up.sdo]] # {}",
            name(device, sdo.index, sdo.sub)
        );
        add!(text, "index = 0x{:04X}", sdo.index);
        if sdo.sub != 0 {
            add!(text, "sub = {}", sdo.sub);
        }
        add!(text, "bits = {}", sdo.bits);
        let mut codes = OptionCode::ALL.iter();
        let code = codes.find(|code| code.index() == sdo.index && sdo.sub == 0);
        let meaning = code.map_or(String::new(), |code| {
            format!(" # {}", code.effect(sdo.value).words())
        });
        add!(text, "value = {}{meaning}", sdo.value);
    }
}

fn option_codes(text: &mut String, drive: &DriveFile) {
    add!(
        text,
        "\n# What the drive does as it comes from the factory; what is written above counts instead."
    );
    add!(text, "[option_codes]");
    for code in OptionCode::ALL {
        let index = code.index();
        let Some(value) = drive.option_codes.of(code) else {
            add!(text, "# {}: {index:04X} is not known", code.key());
            continue;
        };
        let effect = code.effect(value.into());
        let mark = if effect.may_coast() { "WARNING: " } else { "" };
        add!(
            text,
            "{} = {value} # {index:04X}: {mark}{}",
            code.key(),
            effect.words()
        );
    }
}

fn mailbox(text: &mut String, mailbox: &Mailbox) {
    add!(text, "\n[mailbox]");
    add!(text, "complete_access = {}", mailbox.complete_access);
    add!(text, "pdo_assign = {}", mailbox.pdo_assign);
    add!(text, "pdo_config = {}", mailbox.pdo_config);
    add!(text, "sdo_info = {}", mailbox.sdo_info);
    add!(text, "request_timeout_ms = {}", mailbox.request_timeout_ms);
    add!(
        text,
        "response_timeout_ms = {}",
        mailbox.response_timeout_ms
    );
}

fn sync_manager(text: &mut String, number: usize, manager: &SyncManager) {
    add!(text, "\n[[sync_manager]] # {number}");
    add!(text, "purpose = {}", quoted(manager.purpose.word()));
    add!(text, "start = 0x{:04X}", manager.start);
    add!(text, "control = 0x{:02X}", manager.control);
    if manager.size_bytes != 0 {
        add!(text, "size_bytes = {}", manager.size_bytes);
    }
}

fn sync_modes(text: &mut String, drive: &DriveFile) {
    for mode in &drive.sync_modes {
        add!(text, "\n[[sync_mode]]");
        add!(text, "name = {}", quoted(&mode.name));
        add!(text, "assign_activate = 0x{:04X}", mode.assign_activate);
        add!(text, "sync0_cycle_ns = {}", mode.sync0_cycle_ns);
        add!(text, "sync0_cycle_factor = {}", mode.sync0_cycle_factor);
        add!(text, "sync0_shift_ns = {}", mode.sync0_shift_ns);
        if mode.sync1_shift_ns != 0 {
            add!(text, "sync1_shift_ns = {}", mode.sync1_shift_ns);
        }
    }
}
