//! A segment that does not run: who is on it, and single objects of its slaves.

use std::rc::Rc;
use std::time::Duration;

use bus::drive_page::{IMAGE_BYTES_MAX, SLAVES_MAX};
use bus::realtime::now_ns;
use ethercrab::MainDevice;
use ethercrab::error::Error;

use super::driver::{Driver, Storage, master, read_everywhere};
use super::error::StartUpError;
use super::found::{FoundPdo, FoundSlave, ObjectData, ObjectValue, Written};
use super::objects::{Talk, is_write_only, words};
use crate::cia402;
use crate::link::{AL_STATUS, Socket};

/// Time for a mailbox.
const MAILBOX: Duration = Duration::from_secs(2);
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

/// Lists the slaves of a segment. All of them go to PRE-OP: not on a segment that runs.
///
/// # Errors
/// [`StartUpError`].
pub fn scan(socket: &Rc<Socket>) -> Result<Vec<FoundSlave>, StartUpError> {
    let mut found = Vec::new();
    with_slaves(socket, |_, before, talk| {
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
            profile: None,
            receive: Vec::new(),
            transmit: Vec::new(),
        };
        if let Ok(kind) = talk.read(0x1000, 0) {
            shown.profile = Some(kind.value as u16);
            shown.receive = pdos(talk, cia402::RECEIVE_ASSIGN);
            shown.transmit = pdos(talk, cia402::TRANSMIT_ASSIGN);
        }
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
    mut each: impl FnMut(usize, AlStatus, &mut Talk<'_, '_, '_>) -> Result<(), StartUpError>,
) -> Result<(), StartUpError> {
    let interface = &socket.interface;
    let failed = |step: &str, what: String| StartUpError::at(interface, step, &what);
    let storage = Box::new(Storage::new());
    let (main, mut driver) = master(&storage, socket, MAILBOX, 0)
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
    with_slaves(socket, |at, _, talk| {
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
