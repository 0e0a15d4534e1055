//! The keys of a drive file, each declared once with meaning, unit and range (`machine::settings_file` says how).

use schemars::JsonSchema;
use serde::Deserialize;

use crate::cia402::{DriveMode, OperatingMode, OptionCode};
use crate::process_data::{self, Pdo};

/// The whole drive file.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct DriveFile {
    /// Which drive this is. At start-up the drive on the bus must show the same numbers.
    pub identity: Identity,
    /// How the drive is operated.
    pub mode: Mode,
    /// What no ESI file tells, and the controller cannot do without. 0 means: not filled in.
    pub scaling: Scaling,
    /// What goes to the drive and comes back in each cycle.
    pub process_data: ProcessData,
    /// What is written to the drive, and read back, before it operates.
    pub start_up: StartUp,
    /// What the drive does when it is to stop, as it comes from the factory; left out where that is not known. What `[[start_up.sdo]]`
    /// writes counts instead.
    pub option_codes: OptionCodes,
    /// The mailbox, through which objects are read and written.
    pub mailbox: Mailbox,
    /// The sync managers of the drive, in their order from 0: the areas of its memory for mailbox and process data.
    #[serde(rename = "sync_manager")]
    #[schemars(length(min = 4, max = 16))]
    pub sync_managers: Vec<SyncManager>,
    /// The ways in which the drive can be synchronised. Where the machine file has `sync = "dc"` the first one that has SYNC0 is in force; no way at all stands for SYNC0 in every scan, others alone for none.
    #[serde(rename = "sync_mode")]
    #[schemars(length(max = 16), extend("default" = []))]
    pub sync_modes: Vec<SyncMode>,
}

impl DriveFile {
    /// The file as an axis of the drive sees it, from 0.
    pub fn of_axis(&self, axis: u16) -> DriveFile {
        let data = &self.process_data;
        let process_data = ProcessData {
            receive: process_data::of_axis(&data.receive, axis),
            transmit: process_data::of_axis(&data.transmit, axis),
            ..data.clone()
        };
        DriveFile {
            process_data,
            ..self.clone()
        }
    }
}

/// Which device this is.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Identity {
    /// Number of the vendor; 0 of devices that are software.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFFFF_FFFF_u32))]
    pub vendor: u32,
    /// Name of the vendor, for messages.
    #[schemars(extend("default" = ""))]
    pub vendor_name: String,
    /// Product code.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFFFF_FFFF_u32))]
    pub product_code: u32,
    /// Revision.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFFFF_FFFF_u32))]
    pub revision: u32,
    /// Name of the device, for messages.
    #[schemars(extend("default" = ""))]
    pub name: String,
}

/// How the drive is operated.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Mode {
    /// The mode in which the controller drives the axis.
    pub operate: OperatingMode,
    /// The modes that the drive supports, from object 6502; none where that is not known.
    #[schemars(length(max = 10), extend("default" = []))]
    pub supported: Vec<DriveMode>,
}

/// How numbers of the drive become turns and torques.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Scaling {
    /// Increments of the position (6064, 607A) in `position_turns` turns of the motor: 608F and 6091 of the drive, or its data sheet.
    #[schemars(extend("unit" = "increments", "minimum" = 1, "maximum" = 0xFFFF_FFFF_u32))]
    pub position_increments: u32,
    /// Turns of the motor that `position_increments` belong to, so that the ratio is exact.
    #[schemars(extend("unit" = "turns", "minimum" = 1, "maximum" = 0xFFFF_FFFF_u32, "default" = 1))]
    pub position_turns: u32,
    /// Value of the velocity (606C, 60FF, 60B1) at `velocity_rpm`: the increments of one turn where the drive counts increments/s and
    /// `velocity_rpm` is 60; 1 where it counts rev/min and `velocity_rpm` is 1.
    #[schemars(extend("unit" = "", "minimum" = 1, "maximum" = 0xFFFF_FFFF_u32))]
    pub velocity_units: u32,
    /// Speed of the motor that `velocity_units` belong to.
    #[schemars(extend("unit" = "rev/min", "minimum" = 1, "maximum" = 1_000_000, "default" = 60))]
    pub velocity_rpm: u32,
    /// Rated torque of the motor (6076), of which the drive counts thousandths: its data sheet.
    #[schemars(extend("unit" = "N·m", "exclusiveMinimum" = 0, "maximum" = 100_000))]
    pub rated_torque_nm: f64,
    /// Whether the axis moves in its positive direction where the drive counts up: 1, or -1 where it counts down. Found by a jog.
    #[schemars(extend("minimum" = -1, "maximum" = 1))]
    pub direction: i32,
    /// Scans from the feedback that a command answers to the scan in which it acts: at least 2 with SYNC0, 1 without, and what the drive
    /// itself adds ([dead time](../methods/dead-time.md)).
    #[schemars(extend("unit" = "scans", "minimum" = 1, "maximum" = machine::DEAD_TIME_SCANS_MAX))]
    pub dead_time_scans: u32,
}

/// What becomes of the entries of PDOs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mapping {
    /// The PDO is taken as the drive has it.
    Fixed,
    /// They are written at start-up.
    Written,
}

impl Mapping {
    /// Its word in a drive file.
    pub fn word(self) -> &'static str {
        match self {
            Mapping::Fixed => "fixed",
            Mapping::Written => "written",
        }
    }
}

/// What goes to the drive and comes back in each cycle.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct ProcessData {
    /// What becomes of the entries of the PDOs that the drive receives.
    pub receive_mapping: Mapping,
    /// What becomes of the entries of the PDOs that the drive transmits.
    pub transmit_mapping: Mapping,
    /// What the drive can take.
    pub limits: Limits,
    /// A PDO that the drive receives.
    #[schemars(length(min = 1, max = 64))]
    pub receive: Vec<Pdo>,
    /// A PDO that the drive transmits.
    #[schemars(length(min = 1, max = 64))]
    pub transmit: Vec<Pdo>,
}

/// What the drive can take; a limit that is left out is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
pub struct Limits {
    /// Most entries of a PDO that it receives and that is written.
    #[schemars(extend("unit" = "entries", "minimum" = 1, "maximum" = 255))]
    pub receive_entries: Option<u32>,
    /// Most entries of a PDO that it transmits and that is written.
    #[schemars(extend("unit" = "entries", "minimum" = 1, "maximum" = 255))]
    pub transmit_entries: Option<u32>,
    /// Most PDOs that it receives.
    #[schemars(extend("unit" = "PDOs", "minimum" = 1, "maximum" = 255))]
    pub receive_pdos: Option<u32>,
    /// Most PDOs that it transmits.
    #[schemars(extend("unit" = "PDOs", "minimum" = 1, "maximum" = 255))]
    pub transmit_pdos: Option<u32>,
    /// Most process data that it receives.
    #[schemars(extend("unit" = "bytes", "minimum" = 1, "maximum" = 0xFFFF))]
    pub receive_bytes: Option<u32>,
    /// Most process data that it transmits.
    #[schemars(extend("unit" = "bytes", "minimum" = 1, "maximum" = 0xFFFF))]
    pub transmit_bytes: Option<u32>,
}

/// What is written before the drive operates.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct StartUp {
    /// Whether the interpolation time (60C2:1 and 60C2:2) is set to the scan of the machine; `false` where the drive has no such object.
    pub interpolation_time: bool,
    /// Whether the following error at which a drive in `csp` trips by itself (6065) is set to `following_error_limit_mm` of its axis. The
    /// drive counts its own error, from target to position.
    #[schemars(extend("default" = false))]
    pub following_error_window: bool,
    /// An object to write, in this order.
    #[serde(rename = "sdo")]
    #[schemars(length(max = 256), extend("default" = []))]
    pub sdos: Vec<Sdo>,
}

/// An object to write.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Sdo {
    /// Its index.
    #[schemars(extend("minimum" = 0x1000, "maximum" = 0xFFFF))]
    pub index: u16,
    /// Its sub-index.
    #[schemars(extend("minimum" = 0, "maximum" = 255, "default" = 0))]
    pub sub: u8,
    /// Its size: 8, 16 or 32.
    #[schemars(extend("unit" = "bits", "minimum" = 8, "maximum" = 32))]
    pub bits: u32,
    /// The value.
    #[schemars(extend("minimum" = -2_147_483_648_i64, "maximum" = 4_294_967_295_i64))]
    pub value: i64,
}

/// What the drive does when it is to stop, by the codes of CiA 402.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
pub struct OptionCodes {
    /// 605A, quick stop: 0 switches off (coasts), 1 to 4 brake, then switch off, 5 to 8 brake and hold. Below 0 is the vendor's own
    /// meaning: where the manual says that it brakes, write the number above that means the same.
    #[schemars(extend("minimum" = -32768, "maximum" = 32767))]
    pub quick_stop: Option<i32>,
    /// 605C, disable operation: 0 switches off (coasts), 1 brakes, then switches off.
    #[schemars(extend("minimum" = -32768, "maximum" = 32767))]
    pub disable_operation: Option<i32>,
    /// 605D, halt: 1 to 4 brake and hold.
    #[schemars(extend("minimum" = -32768, "maximum" = 32767))]
    pub halt: Option<i32>,
    /// 605E, fault: 0 switches off (coasts), 1 to 4 brake, then switch off.
    #[schemars(extend("minimum" = -32768, "maximum" = 32767))]
    pub fault_reaction: Option<i32>,
    /// 6007, the bus falls silent: 0 nothing (goes on), 1 fault, 2 switches off (coasts), 3 quick stop.
    #[schemars(extend("minimum" = -32768, "maximum" = 32767))]
    pub abort_connection: Option<i32>,
}

impl OptionCodes {
    /// The code of an object.
    pub fn of(&self, code: OptionCode) -> Option<i32> {
        match code {
            OptionCode::QuickStop => self.quick_stop,
            OptionCode::DisableOperation => self.disable_operation,
            OptionCode::Halt => self.halt,
            OptionCode::FaultReaction => self.fault_reaction,
            OptionCode::AbortConnection => self.abort_connection,
        }
    }
}

/// The mailbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Mailbox {
    /// Whether objects can be read and written as a whole.
    pub complete_access: bool,
    /// Whether the PDOs to exchange can be chosen (1C12, 1C13).
    pub pdo_assign: bool,
    /// Whether the entries of PDOs can be written.
    pub pdo_config: bool,
    /// Whether the drive tells its object dictionary.
    pub sdo_info: bool,
    /// Longest time to take a request.
    #[schemars(extend("unit" = "ms", "minimum" = 1, "maximum" = 600_000, "default" = 100))]
    pub request_timeout_ms: u32,
    /// Longest time to answer.
    #[schemars(extend("unit" = "ms", "minimum" = 1, "maximum" = 600_000, "default" = 2000))]
    pub response_timeout_ms: u32,
}

/// What a sync manager is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ManagerPurpose {
    /// Mailbox to the drive.
    MailboxOut,
    /// Mailbox from the drive.
    MailboxIn,
    /// Process data to the drive.
    Outputs,
    /// Process data from the drive.
    Inputs,
    /// Not used.
    None,
}

impl ManagerPurpose {
    /// Its word in a drive file.
    pub fn word(self) -> &'static str {
        match self {
            ManagerPurpose::MailboxOut => "mailbox-out",
            ManagerPurpose::MailboxIn => "mailbox-in",
            ManagerPurpose::Outputs => "outputs",
            ManagerPurpose::Inputs => "inputs",
            ManagerPurpose::None => "none",
        }
    }
}

/// A sync manager.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct SyncManager {
    /// What it is for.
    pub purpose: ManagerPurpose,
    /// Start address in the memory of the drive.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFFFF))]
    pub start: u16,
    /// Control byte.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFF))]
    pub control: u8,
    /// Size of a mailbox; that of process data follows from its entries.
    #[schemars(extend("unit" = "bytes", "minimum" = 0, "maximum" = 0xFFFF, "default" = 0))]
    pub size_bytes: u16,
}

/// A way to synchronise the drive with the others (distributed clocks).
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct SyncMode {
    /// Its name.
    pub name: String,
    /// What is written to the registers 0x0980 and 0x0981: 0 without SYNC signals, 0x0300 for SYNC0, 0x0700 for SYNC0 and SYNC1.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFFFF))]
    pub assign_activate: u16,
    /// Cycle of SYNC0; 0 where it is the scan of the machine times `sync0_cycle_factor`.
    #[schemars(extend("unit" = "ns", "minimum" = 0, "maximum" = 4_294_967_295_i64, "default" = 0))]
    pub sync0_cycle_ns: i64,
    /// Cycle of SYNC0 in scans, as the vendor has it: negative for a part of a scan, 0 for none of its own.
    #[schemars(extend("minimum" = -1000, "maximum" = 1000, "default" = 1))]
    pub sync0_cycle_factor: i32,
    /// Shift of SYNC0 from the start of the cycle.
    #[schemars(extend("unit" = "ns", "minimum" = -2_147_483_648_i64, "maximum" = 2_147_483_647, "default" = 0))]
    pub sync0_shift_ns: i64,
    /// Time from SYNC0 to SYNC1, where that is in use: 0 for both at once.
    #[schemars(extend("unit" = "ns", "minimum" = 0, "maximum" = 4_294_967_295_i64, "default" = 0))]
    pub sync1_shift_ns: i64,
}
