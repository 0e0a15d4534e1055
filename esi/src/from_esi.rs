//! Makes a drive file of what a vendor's ESI file says.

use crate::mapping::{self, Side};
use crate::{Device, Esi, Purpose};
use fieldbus::cia402::{self, DriveMode, OperatingMode, OptionCode};
use fieldbus::drive_file::rules;
use fieldbus::drive_file::{
    DriveFile, Identity, Mailbox, ManagerPurpose, Mapping, Mode, OptionCodes, ProcessData, Scaling,
    Sdo, StartUp, SyncManager, SyncMode,
};
use fieldbus::process_data;

/// Time to take a request where the ESI file has none, in ms.
const REQUEST_TIMEOUT_MS: u32 = 100;
/// Time to answer where the ESI file has none, in ms.
const RESPONSE_TIMEOUT_MS: u32 = 2000;
/// Longest time that a drive file may have, in ms.
const TIMEOUT_MAX_MS: u32 = 600_000;

/// A drive file, and what its user should know.
#[derive(Debug, Clone, PartialEq)]
pub struct Made {
    /// What it says.
    pub drive: DriveFile,
    /// Of how many of its axes the process data are.
    pub axes: u16,
    /// What the controller can do without, or what may not be meant so; a line each.
    pub warnings: Vec<String>,
}

/// Why no drive or terminal file can be made of a device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}:{line}: {name}: {what}")]
pub struct NotMade {
    file: String,
    line: u32,
    name: String,
    what: String,
}

impl NotMade {
    pub(crate) fn of(esi: &Esi, device: &Device, what: String) -> NotMade {
        NotMade {
            file: esi.file.clone(),
            line: device.line,
            name: device.name.clone(),
            what,
        }
    }
}

/// Who a device is.
pub(crate) fn identity_of(esi: &Esi, device: &Device) -> Identity {
    Identity {
        vendor: esi.vendor,
        vendor_name: esi.vendor_name.clone(),
        product_code: device.product_code,
        revision: device.revision,
        name: device.name.clone(),
    }
}

/// Makes a drive file of a device, with the process data of so many of its axes, or of all that its slots must have; without a mode, of
/// the first in [`OperatingMode::ALL`] that it can be driven in.
///
/// # Errors
/// The drive cannot be driven, or not in this mode.
pub fn from_esi(
    esi: &Esi,
    device: &Device,
    mode: Option<OperatingMode>,
    axes: Option<u16>,
) -> Result<Made, NotMade> {
    let variants = device.variants.iter().chain(std::iter::once(device));
    let (mut most, mut why_not): (Option<Made>, Option<NotMade>) = (None, None);
    for variant in variants {
        match from_device(esi, variant, mode) {
            Ok(made) if made.axes >= axes.unwrap_or(variant.axes()) => return Ok(made),
            Ok(made) => {
                if most.as_ref().is_none_or(|most| made.axes > most.axes) {
                    most = Some(made);
                }
            }
            Err(why) => drop(why_not.get_or_insert(why)),
        }
    }
    match (most, axes, why_not) {
        (Some(made), None, _) => Ok(made),
        (Some(made), Some(axes), _) => {
            let (there, word) = (made.axes, made.drive.mode.operate.word());
            let what = format!("{there} of its axes can be driven in {word}, not {axes}");
            Err(NotMade::of(esi, device, what))
        }
        (None, _, Some(why)) => Err(why),
        (None, _, None) => Err(NotMade::of(esi, device, "is no CiA 402 drive".into())),
    }
}

fn from_device(esi: &Esi, device: &Device, mode: Option<OperatingMode>) -> Result<Made, NotMade> {
    let not_made = |what: String| NotMade::of(esi, device, what);
    if !device.is_drive() {
        return Err(not_made("is no CiA 402 drive".into()));
    }
    let Some(mailbox) = device.mailbox.filter(|mailbox| mailbox.coe) else {
        return Err(not_made(
            "has no mailbox with CoE, through which a drive is set up".into(),
        ));
    };
    let first = device.of_axis(0);
    let others: Vec<Device> = (1..device.axes())
        .map(|axis| device.of_axis(axis))
        .collect();
    let (mode, receive, transmit) = choose(&first, mode).map_err(not_made)?;
    let (axes, receive, transmit) = with_more_axes(&first, &others, mode, (receive, transmit));
    let cyclic = process_data::find(&receive.pdos, cia402::MODE, 0).is_some();
    if !cyclic && !device.dictionary.is_empty() && !device.dictionary.writes(cia402::MODE, 0) {
        let what = "cannot be told its mode of operation (6060), which neither its PDOs nor its dictionary has: is it the boot loader of a \
                    drive? Take another revision";
        return Err(not_made(what.into()));
    }
    let supported = supported_modes(device);
    let mut drive = DriveFile {
        identity: identity_of(esi, device),
        mode: Mode {
            operate: mode,
            supported,
        },
        scaling: not_filled_in(),
        process_data: ProcessData {
            receive_mapping: receive.mapping,
            transmit_mapping: transmit.mapping,
            limits: mapping::limits(device, &receive, &transmit),
            receive: receive.pdos,
            transmit: transmit.pdos,
        },
        start_up: StartUp {
            interpolation_time: [1, 2]
                .into_iter()
                .all(|sub| device.dictionary.writes(cia402::INTERPOLATION_TIME, sub)),
            following_error_window: mode == OperatingMode::Csp
                && device.dictionary.writes(cia402::FOLLOWING_ERROR_WINDOW, 0),
            sdos: Vec::new(),
        },
        option_codes: option_codes(device),
        mailbox: mailbox_of(&mailbox),
        sync_managers: device.sync_managers.iter().map(sync_manager).collect(),
        sync_modes: device.sync_modes.iter().map(sync_mode).collect(),
    };
    drive.start_up.sdos = start_up(&first, &drive);
    for (axis, seen) in (1..axes).zip(others) {
        let more = start_up_of(seen, axis, &drive);
        let sdos = &mut drive.start_up.sdos;
        sdos.retain(|sdo| {
            let ours = |own: &Sdo| (own.index, own.sub) == (sdo.index, sdo.sub);
            !more.iter().any(ours)
        });
        sdos.extend(more);
    }
    let mut warnings = rules::warnings(&drive);
    warnings.extend(words_of_axes(device.axes(), axes));
    Ok(Made {
        drive,
        axes,
        warnings,
    })
}

/// How many of a device's axes a drive file has.
fn words_of_axes(device_axes: u16, axes: u16) -> Option<String> {
    let what = match axes {
        _ if device_axes > axes => {
            format!("the drive file has the process data of the first {axes} alone")
        }
        1 => return None,
        _ => "in the machine file [axis.drive] axis = 2 is the second one".into(),
    };
    Some(format!("{device_axes} axes on one device: {what}"))
}

/// What to write before operation for a further axis.
fn start_up_of(mut seen: Device, axis: u16, drive: &DriveFile) -> Vec<Sdo> {
    // What the vendor wants is there with the first axis, whichever it is of.
    seen.init_commands.clear();
    let of_axis = start_up(&seen, &drive.of_axis(axis));
    let own = of_axis
        .into_iter()
        .filter(|sdo| cia402::of_axis(sdo.index).is_some());
    let own = own.map(|sdo| Sdo {
        index: cia402::on_axis(sdo.index, axis),
        ..sdo
    });
    own.collect()
}

/// Number of axes that can be driven in this mode, and the process data of these axes.
fn with_more_axes(
    first: &Device,
    others: &[Device],
    mode: OperatingMode,
    sides: (Side, Side),
) -> (u16, Side, Side) {
    let best = add_axes(others, mode, mapping::choose, sides);
    if usize::from(best.0) > others.len() {
        return best;
    }
    // Entries of our own may have room in PDOs of the first axis alone.
    let fixed = mapping::choose_fixed(first, mode);
    let fixed = fixed.map(|sides| add_axes(others, mode, mapping::choose_fixed, sides));
    match fixed {
        Some(fixed) if fixed.0 > best.0 => fixed,
        _ => best,
    }
}

/// Adds the process data of further axes until one cannot be driven.
fn add_axes(
    others: &[Device],
    mode: OperatingMode,
    choose: impl Fn(&Device, OperatingMode) -> Option<(Side, Side)>,
    (mut receive, mut transmit): (Side, Side),
) -> (u16, Side, Side) {
    let mut axes = 1;
    for seen in others {
        match choose(seen, mode) {
            Some((more_receive, more_transmit))
                if receive.takes(&more_receive) && transmit.takes(&more_transmit) =>
            {
                receive.add(more_receive, axes);
                transmit.add(more_transmit, axes);
                axes += 1;
            }
            _ => break,
        }
    }
    (axes, receive, transmit)
}

pub(crate) fn mailbox_of(mailbox: &crate::Mailbox) -> Mailbox {
    let request_ms = mailbox.request_timeout_ms.unwrap_or(REQUEST_TIMEOUT_MS);
    let response_ms = mailbox.response_timeout_ms.unwrap_or(RESPONSE_TIMEOUT_MS);
    Mailbox {
        complete_access: mailbox.complete_access,
        pdo_assign: mailbox.pdo_assign,
        pdo_config: mailbox.pdo_config,
        sdo_info: mailbox.sdo_info,
        request_timeout_ms: request_ms.clamp(1, TIMEOUT_MAX_MS),
        response_timeout_ms: response_ms.clamp(1, TIMEOUT_MAX_MS),
    }
}

/// The mode, and the process data for it.
fn choose(
    device: &Device,
    mode: Option<OperatingMode>,
) -> Result<(OperatingMode, Side, Side), String> {
    let supported = supported_modes(device);
    let can =
        |mode: OperatingMode| supported.is_empty() || supported.contains(&mode.as_drive_mode());
    if let Some(mode) = mode {
        let word = mode.word();
        if !can(mode) {
            let words: Vec<&str> = supported.iter().map(|mode| mode.word()).collect();
            return Err(format!(
                "does not support {word} (6502): it has {}",
                words.join(", ")
            ));
        }
        let sides = mapping::choose(device, mode);
        let (receive, transmit) = sides.ok_or_else(|| {
            let needed = mode.receive_needed().iter().chain(mode.transmit_needed());
            let needed: Vec<String> = needed.map(|index| format!("{index:04X}")).collect();
            format!(
                "no process data for mode {word}: it needs {} in PDOs",
                needed.join(", ")
            )
        })?;
        return Ok((mode, receive, transmit));
    }
    let mut modes = OperatingMode::ALL.into_iter().filter(|mode| can(*mode));
    let found = modes.find_map(|mode| {
        let (receive, transmit) = mapping::choose(device, mode)?;
        Some((mode, receive, transmit))
    });
    found.ok_or_else(|| {
        let why = if device.modular {
            "its process data is in modules, which the file does not have"
        } else {
            "its PDOs hold no controlword (6040) and target with statusword (6041) and position (6064) or velocity"
        };
        format!("can be driven in none of csv, cst, csp, profile-velocity and velocity: {why}")
    })
}

fn supported_modes(device: &Device) -> Vec<DriveMode> {
    let supported = device.dictionary.default_of(cia402::SUPPORTED_MODES, 0);
    DriveMode::of(supported.unwrap_or(0))
}

/// What no ESI file tells.
fn not_filled_in() -> Scaling {
    Scaling {
        position_increments: 0,
        position_turns: 1,
        velocity_units: 0,
        velocity_rpm: 60,
        rated_torque_nm: 0.0,
        direction: 0,
        dead_time_scans: 0,
    }
}

fn option_codes(device: &Device) -> OptionCodes {
    let of = |code: OptionCode| {
        let found = device.dictionary.default_of(code.index(), 0)?;
        i16::try_from(found).ok().map(i32::from)
    };
    OptionCodes {
        quick_stop: of(OptionCode::QuickStop),
        disable_operation: of(OptionCode::DisableOperation),
        halt: of(OptionCode::Halt),
        fault_reaction: of(OptionCode::FaultReaction),
        abort_connection: of(OptionCode::AbortConnection),
    }
}

/// What to write before operation: the mode where it is not in the process data, reactions that brake, what the vendor wants.
fn start_up(device: &Device, drive: &DriveFile) -> Vec<Sdo> {
    let mut sdos = Vec::new();
    let mode = drive.mode.operate;
    let receive = &drive.process_data.receive;
    if process_data::find(receive, cia402::MODE, 0).is_none() {
        sdos.push(Sdo {
            index: cia402::MODE,
            sub: 0,
            bits: 8,
            value: mode.value(),
        });
    }
    for code in OptionCode::ALL {
        let found = drive.option_codes.of(code).map(i64::from);
        // Reactions that matter are set in any case: a file tells what comes from the factory, not what somebody has set since. Of others
        // it may not even tell that. The controller orders no halt.
        let matters = matches!(code, OptionCode::QuickStop | OptionCode::AbortConnection);
        let coasts = found.map_or(code != OptionCode::Halt, |value| {
            code.effect(value).may_coast()
        });
        if (matters || coasts) && takes(device, code.index(), code.braking()) {
            sdos.push(Sdo {
                index: code.index(),
                sub: 0,
                bits: 16,
                value: code.braking(),
            });
        }
    }
    for sdo in vendors_sdos(device) {
        let ours = [cia402::MODE, cia402::INTERPOLATION_TIME].contains(&sdo.index)
            || sdos
                .iter()
                .any(|own| (own.index, own.sub) == (sdo.index, sdo.sub));
        if !ours {
            sdos.push(sdo);
        }
    }
    sdos
}

/// What the vendor wants written before operation, but for what is exchanged.
pub(crate) fn vendors_sdos(device: &Device) -> impl Iterator<Item = Sdo> {
    device.init_commands.iter().filter_map(|command| {
        let exchanges = (0x1600..0x1C00).contains(&command.index)
            || [cia402::RECEIVE_ASSIGN, cia402::TRANSMIT_ASSIGN].contains(&command.index);
        let value = i64::try_from(command.value).ok()?;
        (!exchanges && matches!(command.bits, 8 | 16 | 32)).then_some(Sdo {
            index: command.index,
            sub: command.sub,
            bits: command.bits,
            value,
        })
    })
}

/// Whether an object can be written with this value, as far as the file tells.
fn takes(device: &Device, index: u16, value: i64) -> bool {
    let Some(object) = device.dictionary.get(index, 0) else {
        return false;
    };
    let within =
        object.min.is_none_or(|min| value >= min) && object.max.is_none_or(|max| value <= max);
    object.writable == Some(true) && within
}

fn sync_manager(manager: &crate::SyncManager) -> SyncManager {
    let purpose = match manager.purpose {
        Some(Purpose::MailboxOut) => ManagerPurpose::MailboxOut,
        Some(Purpose::MailboxIn) => ManagerPurpose::MailboxIn,
        Some(Purpose::Outputs) => ManagerPurpose::Outputs,
        Some(Purpose::Inputs) => ManagerPurpose::Inputs,
        None => ManagerPurpose::None,
    };
    let is_mailbox = matches!(
        purpose,
        ManagerPurpose::MailboxOut | ManagerPurpose::MailboxIn
    );
    SyncManager {
        purpose,
        start: manager.start,
        control: manager.control,
        size_bytes: if is_mailbox { manager.size } else { 0 },
    }
}

fn sync_mode(mode: &crate::SyncMode) -> SyncMode {
    SyncMode {
        name: mode.name.clone(),
        assign_activate: mode.assign_activate,
        sync0_cycle_ns: mode.sync0_cycle_ns.clamp(0, i64::from(u32::MAX)),
        sync0_cycle_factor: mode.sync0_cycle_factor.clamp(-1000, 1000),
        sync0_shift_ns: mode
            .sync0_shift_ns
            .clamp(i64::from(i32::MIN), i64::from(i32::MAX)),
        sync1_shift_ns: mode.sync1_shift_ns.clamp(0, i64::from(u32::MAX)),
    }
}

impl Made {
    /// What of its process data is written, in words.
    pub fn mapping_words(&self) -> &'static str {
        let data = &self.drive.process_data;
        match (data.receive_mapping, data.transmit_mapping) {
            (Mapping::Fixed, Mapping::Fixed) => "fixed mapping",
            (Mapping::Written, Mapping::Written) => "mapping written at start-up",
            _ => "mapping of one direction written at start-up",
        }
    }
}
