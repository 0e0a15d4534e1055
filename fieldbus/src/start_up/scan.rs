//! A segment that does not run: who is on it, and single objects of its slaves.

use std::rc::Rc;
use std::time::Duration;

use bus::drive_page::{IMAGE_BYTES_MAX, SLAVES_MAX};
use bus::realtime::now_ns;
use ethercrab::MainDevice;
use ethercrab::error::Error;

use super::driver::{Driver, Storage, master, read_everywhere};
use super::error::StartUpError;
use super::found::{FoundPdo, FoundSlave, FoundSync, ObjectData, ObjectValue, Written};
use super::objects::{Talk, is_write_only, words};
use crate::cia402;
use crate::link::{AL_STATUS, Socket};

/// Time for a mailbox.
const MAILBOX: Duration = Duration::from_secs(2);
/// Difference of a slave's clock from the reference (ETG.1000.4), and its sign.
const CLOCK_DIFFERENCE: u16 = 0x092C;
const SIGN: u32 = 1 << 31;
/// Frames in which clocks agree with the reference.
const CLOCK_FRAMES: u32 = 2_000;
/// AL status and AL status code of a slave.
type AlStatus = (u16, u16);

fn pdos(talk: &mut Talk<'_, '_, '_>, assign: u16) -> Vec<FoundPdo> {
    let count = talk.read(assign, 0).map_or(0, |count| count.value.min(64));
    let mut found = Vec::new();
    for place in 1..=count {
        let Ok(index) = talk.read(assign, place as u8) else {
            break;
        };
        let index = index.value as u16;
        let entries = talk.read(index, 0).map_or(0, |count| count.value.min(255));
        let entry = |talk: &mut Talk<'_, '_, '_>, place: u64| {
            let word = talk.read(index, place as u8).ok()?.value;
            Some(((word >> 16) as u16, (word >> 8) as u8, word as u8))
        };
        found.push(FoundPdo {
            index,
            entries: (1..=entries)
                .map_while(|place| entry(talk, place))
                .collect(),
        });
    }
    found
}

/// What a slave says of its clock, and of synchronisation.
fn sync(talk: &mut Talk<'_, '_, '_>) -> FoundSync {
    let mut number = |index, sub| Some(talk.read(index, sub).ok()?.value);
    let mut of_outputs = |sub| number(cia402::SYNC_OF_OUTPUTS, sub);
    let mut found = FoundSync {
        kinds: of_outputs(4),
        cycle_min_ns: of_outputs(5),
        taking_in_ns: of_outputs(6),
        missed: of_outputs(11),
        too_short: of_outputs(12),
        has_error: of_outputs(32).map(|error| error != 0),
        error_limit: number(cia402::SYNC_ERRORS, 2),
        clock_off_ns: None,
    };
    if talk.slave.dc_support().any() {
        let read = talk.slave.register_read::<u32>(CLOCK_DIFFERENCE);
        let read = talk.driver.run(read).ok();
        // Its highest bit is its sign.
        found.clock_off_ns = read.map(|word| {
            let size = (word & !SIGN) as i32;
            if word & SIGN == 0 { size } else { -size }
        });
    }
    found
}

/// Lists the slaves of a segment; `keeps_time` asks how they keep time as well. All of them go to PRE-OP: not on a segment that runs.
///
/// # Errors
/// [`StartUpError`].
pub fn scan(socket: &Rc<Socket>, keeps_time: bool) -> Result<Vec<FoundSlave>, StartUpError> {
    let mut found = Vec::new();
    let clock_frames = if keeps_time { CLOCK_FRAMES } else { 0 };
    with_slaves(socket, clock_frames, |_, before, talk| {
        let slave = &talk.slave;
        let identity = slave.identity();
        let mut shown = FoundSlave {
            name: slave.name().to_string(),
            identity: [
                identity.vendor_id,
                identity.product_id,
                identity.revision,
                identity.serial,
            ],
            address: slave.configured_address(),
            al_status_before: before.0,
            al_status_code_before: before.1,
            clocks: slave.dc_support().any(),
            delay_ns: slave.propagation_delay(),
            sync: None,
            profile: None,
            receive: Vec::new(),
            transmit: Vec::new(),
        };
        if let Ok(kind) = talk.read(0x1000, 0) {
            shown.profile = Some(kind.value as u16);
            shown.receive = pdos(talk, cia402::RECEIVE_ASSIGN);
            shown.transmit = pdos(talk, cia402::TRANSMIT_ASSIGN);
        }
        shown.sync = keeps_time.then(|| sync(talk));
        found.push(shown);
        Ok(())
    })?;
    Ok(found)
}

/// In which AL states the slaves are, in the order of the cable.
fn states(main: &MainDevice<'_>, driver: &mut Driver<'_>) -> Result<Vec<AlStatus>, Error> {
    let read = read_everywhere::<[u8; 6]>(main, driver, AL_STATUS)?.into_iter();
    let states = read.map(|[low, high, _, _, code_low, code_high]| {
        (
            u16::from_le_bytes([low, high]),
            u16::from_le_bytes([code_low, code_high]),
        )
    });
    Ok(states.collect())
}

/// Does something with every slave of a segment in PRE-OP: its place, the AL status that it had before, and a way to talk to it.
fn with_slaves(
    socket: &Rc<Socket>,
    clock_frames: u32,
    mut each: impl FnMut(usize, AlStatus, &mut Talk<'_, '_, '_>) -> Result<(), StartUpError>,
) -> Result<(), StartUpError> {
    let interface = &socket.interface;
    let failed = |step: &str, what: String| StartUpError::at(interface, step, &what);
    let storage = Box::new(Storage::new());
    let (main, mut driver) = master(&storage, socket, MAILBOX, clock_frames)
        .ok_or_else(|| failed("starting", "its frames are in use".into()))?;
    let nobody_or = |error| match error {
        Error::Timeout(_) => StartUpError::nobody(interface),
        error => failed("bringing all slaves to PRE-OP", words(error)),
    };
    let before = states(&main, &mut driver).map_err(nobody_or)?;
    let group = driver.run(main.init_single_group::<SLAVES_MAX, IMAGE_BYTES_MAX>(now_ns));
    let group = group.map_err(nobody_or)?;
    if group.is_empty() {
        return Err(StartUpError::nobody(interface));
    }
    for (place, slave) in group.iter(&main).enumerate() {
        let mut talk = Talk {
            driver: &mut driver,
            slave,
            name: format!("place {place} on the cable"),
        };
        let before = before.get(place).copied().unwrap_or_default();
        each(place, before, &mut talk)?;
    }
    Ok(())
}

/// Does something with one slave of a segment in PRE-OP.
fn with_slave<T>(
    socket: &Rc<Socket>,
    place: usize,
    what: impl FnOnce(&mut Talk<'_, '_, '_>) -> Result<T, StartUpError>,
) -> Result<T, StartUpError> {
    let (mut what, mut done, mut count) = (Some(what), None, 0);
    with_slaves(socket, 0, |at, _, talk| {
        count += 1;
        if at == place
            && let Some(what) = what.take()
        {
            done = Some(what(talk)?);
        }
        Ok(())
    })?;
    done.ok_or_else(|| {
        let step = format!("looking for place {place} on the cable");
        let what = format!("{count} answer, at places 0 to {}", count - 1);
        StartUpError::at(&socket.interface, &step, &what)
    })
}

/// Reads an object of a slave. All slaves of the segment go to PRE-OP: not on one that runs.
///
/// # Errors
/// [`StartUpError`].
pub fn read_object(
    socket: &Rc<Socket>,
    place: usize,
    index: u16,
    sub: u8,
) -> Result<ObjectData, StartUpError> {
    with_slave(socket, place, |talk| {
        talk.read_data(index, sub).map_err(|error| {
            let step = format!("reading {}", cia402::named(index, sub));
            talk.failed(step, words(error))
        })
    })
}

/// Writes an object of a slave in the size that it has, and reads it back. `bits` is for objects that cannot be read. All slaves of the
/// segment go to PRE-OP: not on one that runs.
///
/// # Errors
/// [`StartUpError`].
pub fn write_object(
    socket: &Rc<Socket>,
    place: usize,
    (index, sub): (u16, u8),
    value: i64,
    bits: Option<u32>,
) -> Result<Written, StartUpError> {
    with_slave(socket, place, |talk| {
        let step = format!("writing {} = {value}", cia402::named(index, sub));
        let read = |talk: &mut Talk<'_, '_, '_>, step: &str| match talk.read_data(index, sub) {
            Ok(data) => Ok(Some(data)),
            Err(error) if is_write_only(error) => Ok(None),
            Err(error) => Err(talk.failed(step, words(error))),
        };
        let before = read(talk, &step)?;
        let own_bits = before.as_ref().map(|data| 8 * data.bytes.len() as u32);
        let bits = own_bits.or(bits).ok_or_else(|| {
            let what = "it cannot be read, so its size is not known: say it with --bits";
            talk.failed(step.clone(), what)
        })?;
        if !matches!(bits, 8 | 16 | 32) {
            let what = format!("it has {bits} bits: objects of 8, 16 and 32 bits can be written");
            return Err(talk.failed(step, what));
        }
        if !ObjectValue::holds(bits, value) {
            let (low, high) = (-(1_i64 << (bits - 1)), (1_i64 << bits) - 1);
            let what = format!("it has {bits} bits, which hold {low} to {high}");
            return Err(talk.failed(step, what));
        }
        talk.write(index, sub, bits, value)
            .map_err(|error| talk.failed(step.clone(), words(error)))?;
        let after = read(talk, &format!("{step}, reading it back"))?;
        Ok(Written { before, after })
    })
}
