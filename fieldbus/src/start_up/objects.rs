//! Objects of a slave: read and written by size, refusals in words.

use ethercrab::error::{Error, MailboxError};
use ethercrab::{SubDevice, SubDeviceRef};

use super::driver::Driver;
use super::error::StartUpError;
use crate::cia402;

/// A slave, and the driver that carries what is asked of it.
pub(super) struct Talk<'a, 'b, 'c> {
    pub driver: &'a mut Driver<'b>,
    pub slave: SubDeviceRef<'c, &'c SubDevice>,
    /// As messages name it.
    pub name: String,
}

/// The value of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObjectValue {
    /// Its size, in bits.
    pub bits: u32,
    /// The value, without a sign.
    pub value: u64,
}

impl ObjectValue {
    /// With the sign that its size gives it.
    pub fn signed(self) -> i64 {
        let unused = 64 - self.bits.clamp(1, 64);
        ((self.value << unused) as i64) >> unused
    }
}

/// A refusal in words.
pub(super) fn words(error: Error) -> String {
    match error {
        Error::Mailbox(MailboxError::Aborted { code, .. }) => {
            let number = u32::from(code);
            format!("the drive refuses: {code} ({number:#010x})")
        }
        Error::Mailbox(MailboxError::NoReadMailbox | MailboxError::NoWriteMailbox) => {
            "it has no mailbox: no object can be read or written".into()
        }
        Error::Mailbox(other) => format!("the mailbox says: {other}"),
        Error::Timeout(_) => "it does not answer in time".into(),
        Error::WorkingCounter { .. } => "it does not answer (working counter)".into(),
        Error::SubDevice(code) => bus::drive_codes::al_status(code.into()),
        other => other.to_string(),
    }
}

/// Whether an object is not there at all.
pub(super) fn is_missing(error: Error) -> bool {
    let Error::Mailbox(MailboxError::Aborted { code, .. }) = error else {
        return false;
    };
    matches!(u32::from(code), 0x0602_0000 | 0x0609_0011)
}

impl Talk<'_, '_, '_> {
    /// An error of a step.
    pub fn failed(&self, step: impl Into<String>, what: impl Into<String>) -> StartUpError {
        StartUpError::Step {
            slave: self.name.clone(),
            step: step.into(),
            what: what.into(),
        }
    }

    /// Reads an object of a size that is not known.
    pub fn read(&mut self, index: u16, sub: u8) -> Result<ObjectValue, Error> {
        macro_rules! try_size {
            ($kind:ty) => {
                match self.driver.run(self.slave.sdo_read::<$kind>(index, sub)) {
                    Ok(value) => {
                        return Ok(ObjectValue {
                            bits: <$kind>::BITS,
                            value: value.into(),
                        });
                    }
                    // Another size.
                    Err(Error::Pdu(_) | Error::Wire(_)) => {}
                    Err(error) => return Err(error),
                }
            };
        }
        // A size below the object's own would be read cut off, and one above it is an error.
        try_size!(u64);
        try_size!(u32);
        try_size!(u16);
        try_size!(u8);
        Err(Error::Mailbox(MailboxError::SdoResponseInvalid {
            address: index,
            sub_index: sub,
        }))
    }

    /// Writes an object of so many bits.
    pub fn write(&mut self, index: u16, sub: u8, bits: u32, value: i64) -> Result<(), Error> {
        let slave = &self.slave;
        match bits {
            8 => self.driver.run(slave.sdo_write(index, sub, value as u8)),
            16 => self.driver.run(slave.sdo_write(index, sub, value as u16)),
            _ => self.driver.run(slave.sdo_write(index, sub, value as u32)),
        }
    }

    /// Writes an object and reads it back.
    pub fn set(&mut self, index: u16, sub: u8, bits: u32, value: i64) -> Result<(), StartUpError> {
        let step = format!("writing {} = {value}", cia402::named(index, sub));
        if let Err(error) = self.write(index, sub, bits, value) {
            let what = format!(
                "{}; change it in the drive file, or take it out",
                words(error)
            );
            return Err(self.failed(step, what));
        }
        let mask = if bits >= 64 {
            u64::MAX
        } else {
            (1 << bits) - 1
        };
        match self.read(index, sub) {
            // What can be written and not read is believed.
            Err(error) if is_write_only(error) => Ok(()),
            Err(error) => Err(self.failed(format!("{step}, reading it back"), words(error))),
            Ok(found) if found.value == (value as u64) & mask => Ok(()),
            Ok(found) => {
                let what = format!(
                    "it holds {} afterwards: the drive cut it to what it can do, or it is fixed; write the value it can do into the drive file",
                    found.signed()
                );
                Err(self.failed(step, what))
            }
        }
    }

    /// Reads a register of two bytes.
    pub fn register(&mut self, register: u16) -> Result<u16, Error> {
        self.driver.run(self.slave.register_read::<u16>(register))
    }

    /// Writes a register of two bytes.
    pub fn set_register(&mut self, register: u16, value: u16) -> Result<(), Error> {
        let written = self.slave.register_write::<u16>(register, value);
        self.driver.run(written).map(|_| ())
    }
}

fn is_write_only(error: Error) -> bool {
    let Error::Mailbox(MailboxError::Aborted { code, .. }) = error else {
        return false;
    };
    u32::from(code) == 0x0601_0001
}

/// Reads an object of a slave of a segment in PRE-OP.
///
/// # Errors
/// [`StartUpError`].
pub fn read_object(
    socket: &std::rc::Rc<crate::link::Socket>,
    place: usize,
    index: u16,
    sub: u8,
) -> Result<ObjectValue, StartUpError> {
    super::scan::with_slave(socket, place, |talk| {
        talk.read(index, sub).map_err(|error| {
            let step = format!("reading {}", cia402::named(index, sub));
            talk.failed(step, words(error))
        })
    })
}

/// Writes an object of a slave of a segment in PRE-OP, in the size that it has, and reads it back.
///
/// # Errors
/// [`StartUpError`].
pub fn write_object(
    socket: &std::rc::Rc<crate::link::Socket>,
    place: usize,
    index: u16,
    sub: u8,
    value: i64,
) -> Result<ObjectValue, StartUpError> {
    super::scan::with_slave(socket, place, |talk| {
        let step = format!("reading {}", cia402::named(index, sub));
        let before = talk
            .read(index, sub)
            .map_err(|error| talk.failed(step.clone(), words(error)))?;
        talk.set(index, sub, before.bits, value)?;
        talk.read(index, sub)
            .map_err(|error| talk.failed(step, words(error)))
    })
}
