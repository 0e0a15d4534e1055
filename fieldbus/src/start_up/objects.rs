//! Objects of a slave: read and written by size, refusals in words.

use ethercrab::error::{Error, MailboxError};
use ethercrab::{SubDevice, SubDeviceRef};
use ethercrab_wire::{
    EtherCrabWireRead, EtherCrabWireReadSized, EtherCrabWireReadWrite, EtherCrabWireSized,
    WireError,
};

use super::driver::Driver;
use super::error::StartUpError;
use super::found::{ObjectData, ObjectValue};
use crate::cia402;

/// A slave, and the driver that carries what is asked of it.
pub(super) struct Talk<'a, 'b, 'c> {
    pub driver: &'a mut Driver<'b>,
    pub slave: SubDeviceRef<'c, &'c SubDevice>,
    /// As messages name it.
    pub name: String,
}

/// Most bytes of an object that are read.
const OBJECT_BYTES_MAX: usize = 1024;

/// The bytes of an object, as many as it has.
struct Bytes(Vec<u8>);

impl EtherCrabWireRead for Bytes {
    fn unpack_from_slice(bytes: &[u8]) -> Result<Self, WireError> {
        Ok(Bytes(bytes.to_vec()))
    }
}

impl EtherCrabWireSized for Bytes {
    const PACKED_LEN: usize = OBJECT_BYTES_MAX;
    type Buffer = [u8; OBJECT_BYTES_MAX];

    fn buffer() -> Self::Buffer {
        [0; OBJECT_BYTES_MAX]
    }
}

/// A refusal in words.
pub(super) fn words(error: Error) -> String {
    match error {
        Error::Mailbox(MailboxError::Aborted { code, .. }) => abort_words(code.into()),
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

/// An SDO abort code in words (ETG.1000.6, CiA 301).
fn abort_words(code: u32) -> String {
    let known = match code {
        0x0503_0000 | 0x0504_0000 | 0x0504_0001 => "the mailbox got into disorder: try again",
        WRITE_ONLY => "it can only be written",
        READ_ONLY => "it can only be read",
        0x0601_0000 => "not in this way",
        NO_OBJECT => "the drive has no such object",
        0x0604_0041 => "it cannot be mapped",
        0x0604_0042 => "more than the drive can map",
        0x0604_0043 | 0x0604_0047 => "it contradicts other settings of the drive",
        0x0606_0000 => "a fault of its hardware",
        0x0607_0010 | 0x0607_0012 | 0x0607_0013 => "it has another size",
        NO_SUBINDEX => "the object has no such sub-index",
        0x0609_0030 => "the value is out of its range",
        0x0609_0031 => "the value is too high",
        0x0609_0032 => "the value is too low",
        0x0800_0020 => "it cannot be stored",
        0x0800_0021 => "something else has control of the drive: its own panel or software",
        0x0800_0022 => "not in the state in which the drive is",
        _ => return format!("the drive refuses, SDO abort {code:#010x}: see its manual"),
    };
    format!("{known} (SDO abort {code:#010x})")
}

const WRITE_ONLY: u32 = 0x0601_0001;
const READ_ONLY: u32 = 0x0601_0002;
const NO_OBJECT: u32 = 0x0602_0000;
const NO_SUBINDEX: u32 = 0x0609_0011;

/// The code with which a slave refused, if it did.
fn abort_code(error: Error) -> Option<u32> {
    match error {
        Error::Mailbox(MailboxError::Aborted { code, .. }) => Some(code.into()),
        _ => None,
    }
}

/// Whether an object is not there at all.
pub(super) fn is_missing(error: Error) -> bool {
    matches!(abort_code(error), Some(NO_OBJECT | NO_SUBINDEX))
}

pub(super) fn is_write_only(error: Error) -> bool {
    abort_code(error) == Some(WRITE_ONLY)
}

/// Where a value comes from that is written at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// `[[start_up.sdo]]` of the drive file.
    Sdo,
    /// `[[sdo]]` of the terminal file.
    TerminalSdo,
    /// `[process_data]` of the drive file.
    ProcessData,
    /// The scan, into 60C2.
    InterpolationTime,
    /// The limit of the axis, into 6065.
    FollowingErrorWindow,
    /// `torque_limit_percent` of the axis's drive.
    TorqueLimit,
    /// `[mode]` of the drive file.
    Mode,
}

impl Source {
    /// What to do when the drive refuses it.
    fn remedy(self, code: Option<u32>, own_bits: Option<u32>, bits: u32) -> String {
        match (self, code, own_bits) {
            (Source::Sdo, Some(NO_OBJECT | NO_SUBINDEX | READ_ONLY), _) => {
                "take it out of [[start_up.sdo]] of the drive file".into()
            }
            (Source::Sdo, _, Some(own)) if own != bits => format!(
                "it has {own} bits: write bits = {own} in [[start_up.sdo]] of the drive file"
            ),
            (Source::Sdo, ..) => "change it in [[start_up.sdo]] of the drive file".into(),
            (Source::TerminalSdo, ..) => "change it in [[sdo]] of the terminal file".into(),
            (Source::ProcessData, ..) => {
                "this mapping cannot be written: take the PDOs as the drive has them (`quadrant bus scan` shows them), with receive_mapping and transmit_mapping = \"fixed\" in the drive file".into()
            }
            (Source::InterpolationTime, Some(NO_OBJECT | NO_SUBINDEX | READ_ONLY), _) => {
                "write start_up.interpolation_time = false in the drive file".into()
            }
            (Source::InterpolationTime, ..) => {
                "set scan.period_us of the machine file to a cycle that the drive can do".into()
            }
            (Source::FollowingErrorWindow, Some(NO_OBJECT | READ_ONLY), _) => {
                "write start_up.following_error_window = false in the drive file".into()
            }
            (Source::FollowingErrorWindow, ..) => {
                "set following_error_limit_mm of the axis to what the drive takes".into()
            }
            (Source::TorqueLimit, ..) => {
                "set torque_limit_percent in [axis.drive] of the machine file to what the drive takes, or take it out".into()
            }
            (Source::Mode, ..) => {
                "make the drive file with `--mode` of one that the drive has".into()
            }
        }
    }
}

impl Talk<'_, '_, '_> {
    /// An error of a step.
    pub fn failed(&self, step: impl AsRef<str>, what: impl AsRef<str>) -> StartUpError {
        StartUpError::at(&self.name, step.as_ref(), what.as_ref())
    }

    /// Reads an object, whatever its size.
    pub fn read_data(&mut self, index: u16, sub: u8) -> Result<ObjectData, Error> {
        let read = self.slave.sdo_read::<Bytes>(index, sub);
        let Bytes(bytes) = self.driver.run(read)?;
        Ok(ObjectData { bytes })
    }

    /// Reads an object that is a number.
    pub fn read(&mut self, index: u16, sub: u8) -> Result<ObjectValue, Error> {
        let no_number = Error::Mailbox(MailboxError::SdoResponseInvalid {
            address: index,
            sub_index: sub,
        });
        self.read_data(index, sub)?.number().ok_or(no_number)
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

    /// Writes an object.
    pub fn put(
        &mut self,
        (index, sub): (u16, u8),
        bits: u32,
        value: i64,
        source: Source,
    ) -> Result<(), StartUpError> {
        self.write(index, sub, bits, value).map_err(|error| {
            let step = format!("writing {} = {value}", cia402::named(index, sub));
            let own = self.read(index, sub).ok().map(|found| found.bits);
            let remedy = source.remedy(abort_code(error), own, bits);
            self.failed(step, format!("{}; {remedy}", words(error)))
        })
    }

    /// Writes an object and reads it back.
    pub fn set(
        &mut self,
        (index, sub): (u16, u8),
        bits: u32,
        value: i64,
        source: Source,
    ) -> Result<(), StartUpError> {
        self.put((index, sub), bits, value, source)?;
        let step = format!("writing {} = {value}", cia402::named(index, sub));
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
                    "it holds {} afterwards: the drive cut it to what it can do, or it is fixed; {}",
                    found.signed(),
                    source.remedy(None, Some(found.bits), bits)
                );
                Err(self.failed(step, what))
            }
        }
    }

    /// Writes a register and reads it back: what it holds instead, if that is something else.
    pub fn hold_register<T: EtherCrabWireReadWrite + EtherCrabWireReadSized + PartialEq + Copy>(
        &mut self,
        register: u16,
        value: T,
    ) -> Result<Option<T>, Error> {
        self.set_register(register, value)?;
        let found = self.driver.run(self.slave.register_read::<T>(register))?;
        Ok((found != value).then_some(found))
    }

    /// Writes a register.
    pub fn set_register<T: EtherCrabWireReadWrite>(
        &mut self,
        register: u16,
        value: T,
    ) -> Result<(), Error> {
        let written = self.slave.register_write::<T>(register, value);
        self.driver.run(written).map(|_| ())
    }
}
