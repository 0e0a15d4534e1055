//! What is written to a slave in PRE-OP, and read back.

use super::error::StartUpError;
use super::objects::{Source, Talk, is_missing, words};
use super::{DRIVE_FILE, FileWords, SegmentPlan, TERMINAL_FILE};
use crate::cia402::{self, OptionCode};
use crate::drive_file::{DriveFile, Mapping, Sdo};
use crate::drives::DriveSetup;
use crate::process_data::Pdo;

/// Divider of the watchdogs: (2498 + 2) · 40 ns = 100 µs (ETG.1000.4).
const WATCHDOG_DIVIDER: (u16, u16) = (0x0400, 2498);
/// Time of the watchdog of process data, in units of the divider.
const PROCESS_DATA_WATCHDOG: u16 = 0x0420;
const UNITS_PER_MS: u32 = 10;

/// Writes what a slave needs before SAFE-OP; one that the machine file leaves alone is left as it is, but for its watchdog.
pub(super) fn configure(
    talk: &mut Talk<'_, '_, '_>,
    plan: &SegmentPlan,
    place: usize,
) -> Result<(), StartUpError> {
    set_watchdog(talk, plan)?;
    if let Some(setup) = plan.terminal_at(place) {
        let terminal = &setup.terminal;
        let data = &terminal.process_data;
        let assigns = terminal.mailbox.is_some_and(|mailbox| mailbox.pdo_assign);
        let received = (data.mapping, data.receive.as_slice());
        let sent = (data.mapping, data.transmit.as_slice());
        map(talk, assigns, [received, sent], TERMINAL_FILE)?;
        for sdo in &terminal.sdos {
            talk.set(
                (sdo.index, sdo.sub),
                sdo.bits,
                sdo.value,
                Source::TerminalSdo,
            )?;
        }
        return Ok(());
    }
    let Some(setup) = plan.drives_at(place).next() else {
        return Ok(());
    };
    let (drive, data) = (&setup.drive, &setup.device);
    let received = (data.receive_mapping, data.receive.as_slice());
    let sent = (data.transmit_mapping, data.transmit.as_slice());
    // Which objects there are follows from the modules.
    let sdos = drive.start_up.sdos.iter();
    let (of_modules, others): (Vec<&Sdo>, Vec<&Sdo>) =
        sdos.partition(|sdo| sdo.index == cia402::CONFIGURED_MODULES);
    write(talk, &of_modules)?;
    map(talk, drive.mailbox.pdo_assign, [received, sent], DRIVE_FILE)?;
    write(talk, &others)?;
    plan.drives_at(place)
        .try_for_each(|setup| configure_axis(talk, setup, plan.period_us))
}

fn write(talk: &mut Talk<'_, '_, '_>, sdos: &[&Sdo]) -> Result<(), StartUpError> {
    sdos.iter()
        .try_for_each(|sdo| talk.set((sdo.index, sdo.sub), sdo.bits, sdo.value, Source::Sdo))
}

/// Writes what an axis of a drive needs.
fn configure_axis(
    talk: &mut Talk<'_, '_, '_>,
    setup: &DriveSetup,
    period_us: u32,
) -> Result<(), StartUpError> {
    let (drive, axis) = (&setup.drive, setup.axis);
    judge_option_codes(talk, axis)?;
    set_interpolation_time(talk, drive, period_us, axis)?;
    if drive.start_up.following_error_window {
        let window = setup.following_error_increments.into();
        let object = (cia402::on_axis(cia402::FOLLOWING_ERROR_WINDOW, axis), 0);
        talk.set(object, 32, window, Source::FollowingErrorWindow)?;
    }
    if let Some(limit) = setup.torque_limit {
        limit_torque(talk, limit, axis)?;
    }
    set_mode(talk, drive, axis)
}

/// Both ways on their own where the drive has objects for that, else together.
fn limit_torque(talk: &mut Talk<'_, '_, '_>, limit: u16, axis: u16) -> Result<(), StartUpError> {
    let [positive, negative, both] = cia402::TORQUE_LIMITS.map(|of| cia402::on_axis(of, axis));
    let apart = talk.read(positive, 0).is_ok() && talk.read(negative, 0).is_ok();
    let objects = if apart {
        vec![positive, negative]
    } else {
        vec![both]
    };
    objects
        .into_iter()
        .try_for_each(|object| talk.set((object, 0), 16, limit.into(), Source::TorqueLimit))
}

/// Drives that hear nothing for so long stop by themselves.
fn set_watchdog(talk: &mut Talk<'_, '_, '_>, plan: &SegmentPlan) -> Result<(), StartUpError> {
    let units = if plan.is_without_watchdog() {
        0
    } else {
        (plan.bus.watchdog_ms * UNITS_PER_MS).min(u16::MAX.into()) as u16
    };
    let (divider, ticks) = WATCHDOG_DIVIDER;
    for (register, value) in [(divider, ticks), (PROCESS_DATA_WATCHDOG, units)] {
        let step = format!("setting its watchdog (register {register:#06x} = {value})");
        match talk.hold_register(register, value) {
            Ok(None) => {}
            Ok(Some(found)) => {
                let what = format!(
                    "it holds {found} afterwards: without a watchdog the drive would go on with the last command; it cannot be used"
                );
                return Err(talk.failed(step, what));
            }
            Err(error) => return Err(talk.failed(step, words(error))),
        }
    }
    Ok(())
}

/// Chooses the PDOs and writes their entries; what is fixed is compared.
fn map(
    talk: &mut Talk<'_, '_, '_>,
    assigns: bool,
    both: [(Mapping, &[Pdo]); 2],
    words: FileWords,
) -> Result<(), StartUpError> {
    let objects = [cia402::RECEIVE_ASSIGN, cia402::TRANSMIT_ASSIGN];
    for (assign, (mapping, pdos)) in objects.into_iter().zip(both) {
        // Where nothing goes this way, there may be no such object.
        if !pdos.is_empty() && (assigns || mapping == Mapping::Written) {
            assign_pdos(talk, assign, mapping, pdos)?;
        }
        compare(talk, assign, pdos, words)?;
    }
    Ok(())
}

/// In the order that drives want: no PDO, no entries, entries, PDOs (ETG.1000.6).
fn assign_pdos(
    talk: &mut Talk<'_, '_, '_>,
    assign: u16,
    mapping: Mapping,
    pdos: &[Pdo],
) -> Result<(), StartUpError> {
    let indices: Vec<i64> = pdos.iter().map(|pdo| pdo.index.into()).collect();
    if mapping == Mapping::Fixed && assigned(talk, assign).as_ref() == Some(&indices) {
        return Ok(());
    }
    // Without a PDO or an entry that counts, some drives show none: what was written is compared at the end.
    talk.put((assign, 0), 8, 0, Source::ProcessData)?;
    if mapping == Mapping::Written {
        for pdo in pdos {
            talk.put((pdo.index, 0), 8, 0, Source::ProcessData)?;
            for (place, entry) in (1..).zip(&pdo.entries) {
                let words = i64::from(entry.index) << 16 | i64::from(entry.sub) << 8;
                let words = words | i64::from(entry.bits);
                talk.put((pdo.index, place), 32, words, Source::ProcessData)?;
            }
            let count = pdo.entries.len() as i64;
            talk.put((pdo.index, 0), 8, count, Source::ProcessData)?;
        }
    }
    for (place, index) in (1..).zip(&indices) {
        talk.put((assign, place), 16, *index, Source::ProcessData)?;
    }
    let count = indices.len() as i64;
    talk.put((assign, 0), 8, count, Source::ProcessData)
}

/// The PDOs that are chosen; none where that cannot be read.
fn assigned(talk: &mut Talk<'_, '_, '_>, assign: u16) -> Option<Vec<i64>> {
    let count = talk.read(assign, 0).ok()?.value;
    (1..=count.min(64))
        .map(|place| Some(talk.read(assign, place as u8).ok()?.value as i64))
        .collect()
}

/// Whether the device exchanges what its file says, to the bit.
fn compare(
    talk: &mut Talk<'_, '_, '_>,
    assign: u16,
    pdos: &[Pdo],
    FileWords {
        device, command, ..
    }: FileWords,
) -> Result<(), StartUpError> {
    let Some(there) = assigned(talk, assign) else {
        // One without these objects, or without a mailbox, has one fixed set of PDOs: its sizes are compared later.
        return Ok(());
    };
    let list = |indices: &[i64]| {
        let shown: Vec<String> = indices.iter().map(|index| format!("{index:04X}")).collect();
        shown.join(" ")
    };
    let wanted: Vec<i64> = pdos.iter().map(|pdo| pdo.index.into()).collect();
    let step = format!("comparing its process data ({assign:04X})");
    let remedy = format!(
        "make the {device} file of the ESI file of this {device} (`{command}`), or have a look with `quadrant bus scan`"
    );
    if there != wanted {
        let what = format!(
            "it exchanges {}, its {device} file {}: {remedy}",
            list(&there),
            list(&wanted)
        );
        return Err(talk.failed(step, what));
    }
    for pdo in pdos {
        let count = match talk.read(pdo.index, 0) {
            Ok(count) => count.value as usize,
            Err(_) => continue,
        };
        if count != pdo.entries.len() {
            let what = format!(
                "{:04X} has {count} entries, in its {device} file {}: {remedy}",
                pdo.index,
                pdo.entries.len()
            );
            return Err(talk.failed(step, what));
        }
        for (place, entry) in (1..).zip(&pdo.entries) {
            let Ok(found) = talk.read(pdo.index, place) else {
                continue;
            };
            let wanted =
                u64::from(entry.index) << 16 | u64::from(entry.sub) << 8 | u64::from(entry.bits);
            // Of a gap the size alone counts.
            let mask = if entry.is_gap() { 0xFF } else { u64::MAX };
            if found.value & mask != wanted {
                let object = cia402::number((found.value >> 16) as u16, (found.value >> 8) as u8);
                let what = format!(
                    "entry {place} of {:04X} is {object} of {} bits, in its {device} file {}: {remedy}",
                    pdo.index,
                    found.value & 0xFF,
                    entry.words()
                );
                return Err(talk.failed(step, what));
            }
        }
    }
    Ok(())
}

/// No reaction may let the axis coast, whatever the files say: what the drive holds counts.
fn judge_option_codes(talk: &mut Talk<'_, '_, '_>, axis: u16) -> Result<(), StartUpError> {
    for code in OptionCode::ALL {
        let index = cia402::on_axis(code.index(), axis);
        let step = format!("reading {}", cia402::named(index, 0));
        let value = match talk.read(index, 0) {
            Ok(value) => value.signed(),
            Err(error) if is_missing(error) => continue,
            Err(error) => return Err(talk.failed(step, words(error))),
        };
        let effect = code.effect(value);
        if effect.may_coast() && code != OptionCode::Halt {
            let what = format!(
                "it is {value}: {}; have {} written to it, by an [[start_up.sdo]] of the drive file with index = 0x{:04X}, bits = 16, value = {}",
                effect.words(),
                code.braking(),
                index,
                code.braking()
            );
            return Err(talk.failed(step, what));
        }
    }
    Ok(())
}

/// Mantissa and exponent of ten of the scan, in s; none if one byte cannot say it.
fn interpolation_time(period_us: u32) -> Option<(i64, i64)> {
    let (mut mantissa, mut exponent) = (i64::from(period_us), -6);
    while mantissa % 10 == 0 && mantissa > 0 {
        mantissa /= 10;
        exponent += 1;
    }
    // ms are what drives know.
    while exponent > -3 {
        mantissa *= 10;
        exponent -= 1;
    }
    (mantissa <= 255).then_some((mantissa, exponent))
}

/// 60C2 is the scan.
fn set_interpolation_time(
    talk: &mut Talk<'_, '_, '_>,
    drive: &DriveFile,
    period_us: u32,
    axis: u16,
) -> Result<(), StartUpError> {
    let index = cia402::on_axis(cia402::INTERPOLATION_TIME, axis);
    let Some((mantissa, exponent)) = interpolation_time(period_us) else {
        return Ok(());
    };
    if drive.start_up.interpolation_time {
        talk.set((index, 1), 8, mantissa, Source::InterpolationTime)?;
        return talk.set((index, 2), 8, exponent, Source::InterpolationTime);
    }
    // It may be there, and something else.
    let (Ok(found), Ok(power)) = (talk.read(index, 1), talk.read(index, 2)) else {
        return Ok(());
    };
    let seconds = |mantissa: i64, exponent: i64| mantissa as f64 * 10_f64.powi(exponent as i32);
    let is = seconds(found.signed(), power.signed());
    let wanted = seconds(mantissa, exponent);
    if is != 0.0 && (is - wanted).abs() > 1e-9 {
        let what = format!(
            "it is {} ms, the scan {} ms: set start_up.interpolation_time = true in the drive file",
            is * 1e3,
            wanted * 1e3
        );
        return Err(talk.failed("reading 60C2 (interpolation time)", what));
    }
    Ok(())
}

/// The mode is one that the drive has; where no cycle says it, it is written here.
fn set_mode(talk: &mut Talk<'_, '_, '_>, drive: &DriveFile, axis: u16) -> Result<(), StartUpError> {
    let operate = drive.mode.operate;
    if let Ok(supported) = talk.read(cia402::on_axis(cia402::SUPPORTED_MODES, axis), 0) {
        let modes = cia402::DriveMode::of(supported.value as i64);
        // A drive that names none does not tell.
        if !modes.is_empty() && !modes.contains(&operate.as_drive_mode()) {
            let words: Vec<&str> = modes.iter().map(|mode| mode.word()).collect();
            let what = format!(
                "it has {} (6502), and is to operate in {}: make the drive file with `--mode` of one that it has",
                words.join(", "),
                operate.word()
            );
            return Err(talk.failed("comparing its modes of operation", what));
        }
    }
    let receive = &drive.process_data.receive;
    if crate::process_data::find(receive, cia402::MODE, 0).is_none() {
        talk.set(
            (cia402::on_axis(cia402::MODE, axis), 0),
            8,
            operate.value(),
            Source::Mode,
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::interpolation_time;

    #[test]
    fn a_scan_is_said_in_one_byte_and_a_power_of_ten() {
        assert_eq!(interpolation_time(1000), Some((1, -3)));
        assert_eq!(interpolation_time(10_000), Some((10, -3)));
        assert_eq!(interpolation_time(250), Some((25, -5)));
        assert_eq!(interpolation_time(500), Some((5, -4)));
        assert_eq!(interpolation_time(125), Some((125, -6)));
    }
}
