//! `[bus]` and `[axis.drive]`: drives on a fieldbus.

use schemars::JsonSchema;
use serde::Deserialize;

/// The fieldbus.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Fieldbus {
    /// The network interface that the drives are connected to, such as `enp3s0`; they are its only users.
    pub interface: String,
    /// When drives act.
    #[schemars(extend("default" = "sm"))]
    pub sync: Sync,
    /// How long a drive goes on without a frame before it stops by itself (register 0420h): a few scans, so that a frame or two may be
    /// late. After as long without an answer the controller counts on it no more, and an owner of the bus that hangs is replaced by its
    /// standby after half of it. In lockstep the drives' own is off.
    #[schemars(extend("unit" = "ms", "minimum" = 1, "maximum" = 1000, "default" = 10))]
    pub watchdog_ms: u32,
    /// A second process stands by to take the bus over within a scan when the first one dies.
    #[schemars(extend("default" = false))]
    pub standby: bool,
    /// Places on the cable, from 0, of devices that are neither a drive of an axis nor a terminal; they are started and left alone.
    #[schemars(length(max = 15), extend("default" = []), inner(range(min = 0, max = 15)))]
    pub other_slaves: Vec<u32>,
    /// A terminal: a device with inputs and outputs that [signals](../howto/terminals.md) are.
    #[serde(rename = "terminal")]
    #[schemars(length(max = 15), extend("default" = []))]
    pub terminals: Vec<Terminal>,
    /// The drive of the [spindle](../howto/spindle.md#a-spindle-drive-on-the-bus), where it has one on the bus.
    pub spindle: Option<SpindleDrive>,
}

impl Fieldbus {
    /// Scans without a frame after which a drive has stopped by itself.
    pub fn watchdog_scans(&self, period_us: u32) -> u32 {
        (self.watchdog_ms * 1000).div_ceil(period_us.max(1))
    }
}

/// The drive of the spindle: it keeps the speed that it is told in each scan.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct SpindleDrive {
    /// Its [drive file](drive-file.md), a path below the folder of this file; its `mode.operate` is `csv`, `profile-velocity` or
    /// `velocity`.
    pub file: String,
    /// Its place on the cable, from 0.
    #[schemars(extend("minimum" = 0, "maximum" = 15))]
    pub slave: u32,
    /// Turns of the motor in one turn of the spindle. Where it is not 1, the angle of M19 may be another one each time the drives get
    /// their power back.
    #[schemars(extend("unit" = "turns", "exclusiveMinimum" = 0, "maximum" = 1000, "default" = 1.0))]
    pub motor_turns: f64,
    /// Speed at which it looks for the angle of M19, by its encoder.
    #[schemars(extend("unit" = "rev/min", "exclusiveMinimum" = 0, "maximum" = 1000, "default" = 60.0))]
    pub orientation_rpm: f64,
}

/// A terminal.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Terminal {
    /// Its place on the cable, from 0.
    #[schemars(extend("minimum" = 0, "maximum" = 15))]
    pub slave: u32,
    /// Its [terminal file](terminal-file.md), a path below the folder of this file.
    pub file: String,
}

/// When drives act.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Sync {
    /// When the frame comes (SM-synchronous): the PC's jitter is on the motor.
    Sm,
    /// At SYNC0 of the distributed clocks, all at the same time; the PC's clock follows the first drive's.
    Dc,
}

/// The drive of an axis.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct AxisDrive {
    /// Its [drive file](drive-file.md), a path below the folder of this file.
    pub file: String,
    /// Its place on the cable, from 0. Left out: drives are in the order of the axes.
    #[schemars(extend("minimum" = 0, "maximum" = 15))]
    pub slave: Option<u32>,
    /// Which axis of it this is, where one drive has several: from 1. Objects of the second are 0x800 above those of the first, and so
    /// on; the drive file, the same for all of them, has the entries of each in its process data.
    #[schemars(extend("minimum" = 1, "maximum" = AXES_OF_DRIVE_MAX, "default" = 1))]
    pub axis: u32,
    /// Of an axis with an absolute encoder: position of the machine where the drive shows 0
    /// ([how to find it](../howto/drives.md#absolute-encoders)).
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000, "default" = 0.0))]
    pub zero_mm: f64,
    /// Turns of the motor that its absolute encoder tells apart: 1 of a single-turn encoder, 4096 of one of 12 bits of turns. The axis is
    /// within its travel then, also where the count repeats in the middle of it. Without it as many as 32 bits of position hold.
    #[schemars(extend("unit" = "turns", "minimum" = 1, "maximum" = 16_777_216))]
    pub encoder_turns: Option<u32>,
    /// Highest torque that the drive may give, either way, of its rated torque: written to it before it operates (60E0 and 60E1, or 6072
    /// where it lacks them) and read back. Without it as the drive is set up.
    #[schemars(extend("unit" = "%", "exclusiveMinimum" = 0, "maximum" = 1000))]
    pub torque_limit_percent: Option<f64>,
    /// Which edge of touch-probe input 1 of the drive is contact, where the touch probe is wired to it: the drive latches its position
    /// there ([probing](../howto/probe.md#drives-on-a-bus)). Without it the drive latches nothing.
    pub probe_edge: Option<ProbeEdge>,
    /// Bits of its digital inputs (object 60FD) that are digital inputs of the machine, from `first_input` on in this order. The drive
    /// file must have 60FD in its process data.
    #[schemars(length(max = 32), extend("default" = []), inner(range(min = 0, max = 31)))]
    pub input_bits: Vec<u32>,
    /// Number of the machine's digital input that the first of `input_bits` is.
    #[schemars(extend("minimum" = 0, "maximum" = bus::sample::DIGITAL_INPUTS - 1, "default" = 0))]
    pub first_input: u32,
}

/// The edge of an input that is contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ProbeEdge {
    /// The input goes on.
    Rising,
    /// It goes off, as of a probe that opens its contact.
    Falling,
}

/// Most axes of a drive: so many have objects from 6000h to 9FFFh (ETG.6010).
pub const AXES_OF_DRIVE_MAX: u32 = 8;

impl AxisDrive {
    /// Its inputs that are inputs of the machine: bit of the drive, number at the machine.
    pub fn inputs(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let numbers = self.first_input..;
        self.input_bits.iter().copied().zip(numbers)
    }
}
