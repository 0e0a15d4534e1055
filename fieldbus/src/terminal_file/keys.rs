//! The keys of a terminal file, each declared once with meaning, unit and range (`machine::settings_file` says how).

use schemars::JsonSchema;
use serde::Deserialize;

use super::channel::ChannelCode;
use crate::drive_file::{Identity, Mailbox, Mapping, Sdo};
use crate::field::Field;
use crate::process_data::{self, Pdo};

/// The whole terminal file.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct TerminalFile {
    /// Which device this is. At start-up the one at its place on the cable must show the same numbers.
    pub identity: Identity,
    /// What goes to the terminal and comes back in each cycle.
    pub process_data: TerminalData,
    /// The mailbox, through which objects are read and written. Without this table the terminal has none, as simple ones.
    pub mailbox: Option<Mailbox>,
    /// An object to write before the terminal operates, in this order: the range of an input, say.
    #[serde(rename = "sdo")]
    #[schemars(length(max = 256), extend("default" = []))]
    pub sdos: Vec<Sdo>,
    /// A channel: an input or an output that a signal can be.
    #[serde(rename = "channel")]
    #[schemars(length(min = 1, max = 256))]
    pub channels: Vec<Channel>,
}

/// What goes to the terminal and comes back in each cycle.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct TerminalData {
    /// What becomes of the entries of its PDOs. Of a terminal without a mailbox they are fixed.
    #[schemars(extend("default" = "fixed"))]
    pub mapping: Mapping,
    /// A PDO that the terminal receives: its outputs.
    #[schemars(length(max = 64), extend("default" = []))]
    pub receive: Vec<Pdo>,
    /// A PDO that the terminal transmits: its inputs.
    #[schemars(length(max = 64), extend("default" = []))]
    pub transmit: Vec<Pdo>,
}

/// An input or an output.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Channel {
    /// Its number, by which signals of the machine file name it.
    #[schemars(extend("minimum" = 1, "maximum" = 256))]
    pub number: u32,
    /// Its name, for people.
    #[schemars(extend("default" = ""))]
    pub name: String,
    /// Whether it is one that is read or one that is written.
    pub direction: ChannelDirection,
    /// What it shows.
    #[schemars(extend("default" = "bool"))]
    pub kind: ChannelKind,
    /// Index of the object in the process data that holds it.
    #[schemars(extend("minimum" = 1, "maximum" = 0xFFFF))]
    pub index: u16,
    /// Sub-index of the object.
    #[schemars(extend("minimum" = 0, "maximum" = 255, "default" = 0))]
    pub sub: u8,
    /// Where it begins in the object: eight switches in a byte are eight channels.
    #[schemars(extend("unit" = "bits", "minimum" = 0, "maximum" = 65_535, "default" = 0))]
    pub first_bit: u32,
    /// Its size; left out it is 1 of a switch, and the rest of the object of others.
    #[schemars(extend("unit" = "bits", "minimum" = 1, "maximum" = 32))]
    pub bits: Option<u32>,
    /// Whether its number can be negative (two's complement).
    #[schemars(extend("default" = false))]
    pub signed: bool,
    /// Value of one step of its number, of the kind `float`: 0.00030517578125 where 0 to 32768 is 0 to 10 V.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000, "default" = 1.0))]
    pub scale: f64,
    /// Value where its number is 0, of the kind `float`: 4 where 0 to 30000 is 4 to 20 mA.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000, "default" = 0.0))]
    pub offset: f64,
    /// Unit of its value, for people, such as `V`.
    #[schemars(extend("default" = ""))]
    pub unit: String,
}

/// Which way a channel goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelDirection {
    /// It is read: in what the terminal transmits.
    Input,
    /// It is written: in what the terminal receives.
    Output,
}

impl ChannelDirection {
    /// Its word in a terminal file.
    pub fn word(self) -> &'static str {
        match self {
            ChannelDirection::Input => "input",
            ChannelDirection::Output => "output",
        }
    }
}

/// What a channel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelKind {
    /// A switch: one bit.
    Bool,
    /// A whole number.
    Int,
    /// A whole number that `scale` and `offset` make a value of.
    Float,
    /// A floating-point number of 32 bits (IEEE 754).
    Real,
    /// A count that goes on where its bits are full: the signal counts on, from where the count was when the terminal came. Inputs alone.
    Counter,
}

impl ChannelKind {
    /// Its word in a terminal file.
    pub fn word(self) -> &'static str {
        match self {
            ChannelKind::Bool => "bool",
            ChannelKind::Int => "int",
            ChannelKind::Float => "float",
            ChannelKind::Real => "real",
            ChannelKind::Counter => "counter",
        }
    }
}

impl TerminalData {
    /// The PDOs of a direction.
    pub fn of(&self, direction: ChannelDirection) -> &[Pdo] {
        match direction {
            ChannelDirection::Input => &self.transmit,
            ChannelDirection::Output => &self.receive,
        }
    }
}

impl TerminalFile {
    /// The channel of this number.
    pub fn channel(&self, number: u32) -> Option<&Channel> {
        self.channels.iter().find(|of| of.number == number)
    }

    /// Where a channel is in the process data of its direction, and how its bits are read; none of one that is not there.
    pub fn code(&self, channel: &Channel) -> Option<ChannelCode> {
        let pdos = self.process_data.of(channel.direction);
        let (at_bits, entry) = process_data::find(pdos, channel.index, channel.sub)?;
        let rest = entry.bits.checked_sub(channel.first_bit)?;
        let bits = channel.bits.unwrap_or(match channel.kind {
            ChannelKind::Bool => 1,
            _ => rest,
        });
        if bits == 0 || bits > rest.min(32) {
            return None;
        }
        Some(ChannelCode {
            field: Field {
                at_bits: at_bits.saturating_add(channel.first_bit) as usize,
                bits,
            },
            kind: channel.kind,
            signed: channel.signed,
            scale: channel.scale,
            offset: channel.offset,
        })
    }
}
