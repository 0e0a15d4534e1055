//! SYNC signals of drives with distributed clocks, each as its drive file has them (ETG.1000.4, registers 0x0980 to 0x09A7).
//!
//! ethercrab gives every slave of a group the same SYNC0, without a shift: the registers are written here.

use std::fmt::LowerHex;

use bus::drive_page::{IMAGE_BYTES_MAX, SLAVES_MAX};
use ethercrab::{MainDevice, SubDeviceGroup};
use ethercrab_wire::{EtherCrabWireReadSized, EtherCrabWireReadWrite};

use super::SegmentPlan;
use super::driver::Driver;
use super::error::StartUpError;
use super::objects::{Talk, words};
use crate::drive_file::{DriveFile, SyncMode};

/// Two registers of a byte: who controls the signals, and which are on. The first one that begins them.
const ASSIGN_ACTIVATE: u16 = 0x0980;
const SYSTEM_TIME: u16 = 0x0910;
const START_TIME: u16 = 0x0990;
const SYNC0_CYCLE: u16 = 0x09A0;
const SYNC1_CYCLE: u16 = 0x09A4;
/// The bit of SYNC0 in an AssignActivate word, and the word that has it alone, with the cyclic unit on.
const SYNC0: u16 = 0x0200;
const SYNC0_ALONE: u16 = 0x0300;
/// The first SYNC0 is so long after it is configured.
const DELAY_NS: u64 = 100_000_000;

/// SYNC signals of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Signals {
    assign_activate: u16,
    start_ns: u64,
    sync0_cycle_ns: u32,
    sync1_ns: u32,
}

impl Signals {
    /// Those that a drive file wants; none if it wants none. SYNC0 of drives without a shift is at whole scans of the reference clock,
    /// which shows `now_ns`; of a longer cycle at whole ones of that.
    fn of(drive: &DriveFile, scan_ns: u64, now_ns: u64) -> Result<Option<Signals>, String> {
        let modes = &drive.sync_modes;
        let has_sync0 = |mode: &&SyncMode| mode.assign_activate & SYNC0 != 0;
        let (assign_activate, cycle_ns, shift_ns, sync1_ns) = match modes.iter().find(has_sync0) {
            Some(mode) => (
                mode.assign_activate,
                cycle_ns(mode, scan_ns),
                mode.sync0_shift_ns,
                mode.sync1_shift_ns,
            ),
            None if modes.is_empty() => (SYNC0_ALONE, scan_ns, 0, 0),
            None => return Ok(None),
        };
        let register = |ns: u64| {
            let what = "do not fit into its register, which holds";
            u32::try_from(ns).map_err(|_| format!("{ns} ns {what} {} at most", u32::MAX))
        };
        let step_ns = cycle_ns.max(scan_ns).max(1);
        let whole_ns = (now_ns + DELAY_NS).div_ceil(step_ns) * step_ns;
        // A shift by whole cycles is none, and a start that is over never comes.
        let shift_ns = shift_ns.rem_euclid(step_ns as i64);
        Ok(Some(Signals {
            assign_activate,
            start_ns: whole_ns + shift_ns as u64,
            sync0_cycle_ns: register(cycle_ns)?,
            sync1_ns: register(sync1_ns.max(0) as u64)?,
        }))
    }

    /// Writes them and reads them back.
    fn write(&self, talk: &mut Talk<'_, '_, '_>) -> Result<(), String> {
        talk.set_register::<u16>(ASSIGN_ACTIVATE, 0)
            .map_err(words)?;
        talk.set_register(START_TIME, self.start_ns)
            .map_err(words)?;
        hold(talk, SYNC0_CYCLE, self.sync0_cycle_ns)?;
        hold(talk, SYNC1_CYCLE, self.sync1_ns)?;
        hold(talk, ASSIGN_ACTIVATE, self.assign_activate)
    }
}

/// Writes a register that must hold what it is told.
fn hold<T>(talk: &mut Talk<'_, '_, '_>, register: u16, value: T) -> Result<(), String>
where
    T: EtherCrabWireReadWrite + EtherCrabWireReadSized + PartialEq + Copy + LowerHex,
{
    match talk.hold_register(register, value).map_err(words)? {
        None => Ok(()),
        Some(holds) => Err(format!(
            "register {register:#06x} holds {holds:#x} after {value:#x} was written: another [[sync_mode]] of its drive file, or sync = \"sm\""
        )),
    }
}

/// Cycle of SYNC0; 0 for a single one.
fn cycle_ns(mode: &SyncMode, scan_ns: u64) -> u64 {
    let factor = u64::from(mode.sync0_cycle_factor.unsigned_abs());
    match (mode.sync0_cycle_ns, mode.sync0_cycle_factor) {
        (0, ..0) => scan_ns / factor,
        (0, _) => scan_ns * factor,
        (own_ns, _) => own_ns.max(0) as u64,
    }
}

/// Sets the SYNC signals of all drives, and of no other slave; the station address of the reference clock.
pub(super) fn set_clocks(
    driver: &mut Driver<'_>,
    plan: &SegmentPlan,
    main: &MainDevice<'_>,
    group: &SubDeviceGroup<SLAVES_MAX, IMAGE_BYTES_MAX>,
) -> Result<u16, StartUpError> {
    const STEP: &str = "setting its SYNC signals";
    let has_clock = |place: &usize| {
        let slave = group.subdevice(main, *place);
        slave.is_ok_and(|slave| slave.dc_support().any())
    };
    let of_segment =
        |what: String| StartUpError::at(&plan.bus.interface, "setting distributed clocks", &what);
    let reference = (0..group.len()).find(has_clock).ok_or_else(|| {
        of_segment("no slave has them: write sync = \"sm\" in [bus] of the machine file".into())
    })?;
    let reference = group.subdevice(main, reference);
    let reference = reference.map_err(|error| of_segment(words(error)))?;
    let now_ns = driver.run(reference.register_read::<u64>(SYSTEM_TIME));
    let now_ns = now_ns.map_err(|error| of_segment(words(error)))?;
    for setup in plan.drives_once() {
        let name = plan.name(setup.slave);
        let Ok(slave) = group.subdevice(main, setup.slave) else {
            continue;
        };
        let mut talk = Talk {
            driver: &mut *driver,
            slave,
            name,
        };
        let scan_ns = u64::from(plan.period_us) * 1000;
        let signals = Signals::of(&setup.drive, scan_ns, now_ns);
        let signals = signals.map_err(|what| talk.failed(STEP, what))?;
        let written = match signals {
            Some(signals) if has_clock(&setup.slave) => signals.write(&mut talk),
            Some(_) if !setup.drive.sync_modes.is_empty() => {
                Err("it has no distributed clocks: take [[sync_mode]] out of its drive file".into())
            }
            // A master before may have left them on.
            None if has_clock(&setup.slave) => {
                let written = talk.set_register::<u16>(ASSIGN_ACTIVATE, 0);
                written.map_err(words)
            }
            Some(_) | None => Ok(()),
        };
        written.map_err(|what| talk.failed(STEP, what))?;
    }
    Ok(reference.configured_address())
}
