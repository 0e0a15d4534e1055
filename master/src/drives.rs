//! The seam to the iron: what a master asks of drives, simulated or on a fieldbus. It cannot tell which they are.

use bus::sample::{ANALOG_INPUTS, BusCycle, Levels};
use bytemuck::{Pod, Zeroable};

/// What a drive is asked to do for one scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum DriveCommand {
    /// No torque: brake or friction holds the axis. A drive that closes the brake by itself holds it until then.
    #[default]
    Disabled,
    /// The drive closes the velocity loop (CiA 402 cyclic synchronous velocity with torque offset).
    Velocity {
        /// Velocity at the table, in mm/s, held over the scan.
        velocity_mm_s: f64,
        /// Torque added at the motor, in N·m.
        torque_offset_nm: f64,
    },
    /// The drive closes the position loop too (CiA 402 cyclic synchronous position with velocity and torque offset).
    Position {
        /// Position of the motor encoder to be at, in mm of travel, as [`DriveFeedback::motor_position_mm`] counts.
        position_mm: f64,
        /// Velocity added to what the position loop asks for, in mm/s.
        velocity_offset_mm_s: f64,
        /// Torque added at the motor, in N·m.
        torque_offset_nm: f64,
    },
    /// The servo closes the velocity loop (CiA 402 cyclic synchronous torque).
    Torque {
        /// Torque at the motor, in N·m.
        torque_nm: f64,
    },
    /// Controlled quick stop: the drive ramps its velocity command to zero and holds the axis there.
    Brake {
        /// Deceleration, in mm/s²; the drive's own quick-stop deceleration where it is not above 0.
        deceleration_mm_s2: f64,
    },
    /// Power on and hold the axis where it is, until the drive shows [`DriveState::Ready`].
    SwitchOn,
    /// Home by itself (CiA 402 mode 6), then hold the axis. [`DriveFeedback::referenced`] is false from the exchange that takes the
    /// first of them until the drive has its reference; its position is the machine's then.
    Home,
}

impl DriveCommand {
    /// Its kind and values, as digests and saved states have it; 0 for those that it lacks.
    pub fn parts(&self) -> (u64, [f64; 3]) {
        match *self {
            DriveCommand::Disabled => (0, [0.0; 3]),
            DriveCommand::Velocity {
                velocity_mm_s,
                torque_offset_nm,
            } => (1, [velocity_mm_s, torque_offset_nm, 0.0]),
            DriveCommand::Torque { torque_nm } => (2, [torque_nm, 0.0, 0.0]),
            DriveCommand::Brake { deceleration_mm_s2 } => (3, [deceleration_mm_s2, 0.0, 0.0]),
            DriveCommand::SwitchOn => (4, [0.0; 3]),
            DriveCommand::Home => (5, [0.0; 3]),
            DriveCommand::Position {
                position_mm,
                velocity_offset_mm_s,
                torque_offset_nm,
            } => (6, [position_mm, velocity_offset_mm_s, torque_offset_nm]),
        }
    }

    /// The command of these [`parts`](DriveCommand::parts).
    pub fn of_parts(kind: u64, [first, second, third]: [f64; 3]) -> Option<DriveCommand> {
        Some(match kind {
            0 => DriveCommand::Disabled,
            1 => DriveCommand::Velocity {
                velocity_mm_s: first,
                torque_offset_nm: second,
            },
            2 => DriveCommand::Torque { torque_nm: first },
            3 => DriveCommand::Brake {
                deceleration_mm_s2: first,
            },
            4 => DriveCommand::SwitchOn,
            5 => DriveCommand::Home,
            6 => DriveCommand::Position {
                position_mm: first,
                velocity_offset_mm_s: second,
                torque_offset_nm: third,
            },
            _ => return None,
        })
    }
}

/// Whether a drive follows commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DriveState {
    /// It follows a command from the next scan on, without a wait for power.
    #[default]
    Ready,
    /// It must be switched on first, or is being switched on.
    Off,
    /// It has faulted and does what its fault reaction says, until the fault is reset at the drive or by whoever speaks with it.
    /// The master refuses to go on before.
    Fault {
        /// The drive's own error code (CiA 402 object 603Fh).
        code: u32,
    },
    /// It does not answer any more, or takes no commands.
    Lost {
        /// What the bus says of it (AL status code of EtherCAT); 0 where it does not answer at all.
        code: u32,
    },
}

impl DriveState {
    /// Whether it is lost.
    pub fn is_lost(self) -> bool {
        matches!(self, DriveState::Lost { .. })
    }
}

/// What one drive shows at the start of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DriveFeedback {
    /// Position of the motor encoder, in mm of travel.
    pub motor_position_mm: f64,
    /// Position of the linear scale, in mm; none where the axis has no scale.
    pub scale_position_mm: Option<f64>,
    /// Velocity that the drive measured last, in mm/s.
    pub velocity_mm_s: f64,
    /// Torque at the motor, in N·m.
    pub torque_nm: f64,
    /// Winding temperature above the ambient, in K; 0 where the drive has no thermal model.
    pub winding_rise_k: f64,
    /// The torque limit cut the demand in the last scan.
    pub torque_limited: bool,
    /// The position is that of the machine: from an absolute encoder, or homed by the drive itself. Of axes that the controller homes
    /// by a switch or index nobody asks it: their positions begin anywhere, and stay true until the drive is [`Lost`](DriveState::Lost).
    pub referenced: bool,
    /// Position of the motor encoder, in mm of travel, that was latched at its index, if the index passed in the scan that ended: what
    /// the touch-probe unit of a drive latches at the zero impulse (CiA 402 objects 60B8h and 60BAh).
    pub index_mm: Option<f64>,
    /// The same of contact of the touch probe that is watched ([`Drives::watch_probe`]), in the scan in which the drive shows what it
    /// latched (60BAh, 60BBh).
    pub probe_mm: Option<f64>,
    /// It was without power, or reset, since this master or the one before it saw it last: where it is, it may believe only.
    pub restarted: bool,
    /// Whether it follows commands.
    pub state: DriveState,
}

/// What the machine beside its axes shows at the start of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AuxiliaryFeedback {
    /// Speed of the spindle, in rev/min, clockwise positive.
    pub spindle_rpm: f64,
    /// Angle that its encoder shows, in turns, clockwise positive, whole at the index; 0 without an encoder. As the positions of the
    /// axes, it must be known over a loss of the master (a multi-turn encoder).
    pub spindle_turns: f64,
    /// The spindle stands at the angle that was commanded.
    pub oriented: bool,
    /// The error code of the spindle's drive while it has a fault, else 0.
    pub spindle_code: u32,
    /// Number of the tool in the spindle, as a changer knows it.
    pub tool: u32,
}

/// What inputs and probe show at the end of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InputFeedback {
    /// Digital inputs, a bit each.
    pub digital: u64,
    /// Analogue inputs.
    pub analog: [f64; ANALOG_INPUTS],
    /// The probe is in contact.
    pub contact: bool,
    /// What shows the contact is lost: whether there is one, nobody knows.
    pub contact_lost: bool,
    /// When contact was made first in the scan that ends, as a share of it from 0 to 1; none if it was not. It is the time stamp
    /// that the touch-probe unit of a drive latches (CiA 402 objects 60B8h, 60D1h).
    pub made_at: Option<f64>,
    /// The same of contact that was lost (60D2h).
    pub lost_at: Option<f64>,
}

/// What bench instruments read at one instant. Real machines have none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct InstrumentSample {
    /// True motor position, in mm of travel, without the encoder's steps.
    pub motor_mm: f64,
    /// True table position, in mm.
    pub table_mm: f64,
}

/// A saved state that no drive can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the saved state of an axis holds a value that no machine can have")]
pub struct StateRefused;

/// The drives of a machine, in the order of its axes.
///
/// Each scan the master calls [`exchange`](Drives::exchange) once and then looks at [`feedback`](Drives::feedback). How many
/// scans pass between the feedback that a command answers and the scan that it acts in is a number of the machine
/// (`[scan] dead_time_scans`): it is 1 where a command acts in the scan of its exchange, as in simulated drives, and 2 to 4 on a
/// fieldbus.
pub trait Drives {
    /// How many there are.
    fn count(&self) -> usize;

    /// What drive `axis` shows now.
    fn feedback(&self, axis: usize) -> DriveFeedback;

    /// Gives each drive its command of this scan and takes what they show at its end.
    fn exchange(&mut self, commands: &[DriveCommand]);

    /// The master has exchanged nothing for longer than its watchdog. Drives on a bus know it by a watchdog of their own and
    /// need no word; simulated ones have no other clock: they brake to rest and switch off.
    fn stalled(&mut self) {}

    /// Whose brakes the controller wants open in this scan, a bit for each axis: of those that it opens and closes. Called once a scan,
    /// before [`exchange`](Drives::exchange). A brake that nobody wants open any more closes.
    fn open_brakes(&mut self, _axes: u64) {}

    /// Which change of the contact of the touch probe is waited for in this scan, made or lost: drives with a touch-probe unit latch where
    /// they are. Called once a scan, before [`exchange`](Drives::exchange).
    fn watch_probe(&mut self, _made: Option<bool>) {}

    /// What spindle, coolant, outputs and tool changer are to be in this scan; called once a scan, before
    /// [`exchange`](Drives::exchange). Levels stay until they change. A master that dies says nothing more: the spindle then stops by
    /// itself and coolant goes off, outputs stay. A spindle that is in step with an axis stops together with it: both drives brake
    /// evenly over the time that the spindle takes.
    fn command_levels(&mut self, _levels: &Levels) {}

    /// What spindle and tool changer show now; nothing where there are none.
    fn auxiliary(&self) -> AuxiliaryFeedback {
        AuxiliaryFeedback::default()
    }

    /// What inputs and probe show now; nothing where there are none.
    fn inputs(&self) -> InputFeedback {
        InputFeedback::default()
    }

    /// What the device shows that is the source of a signal, by the signal's index in the machine file, at the end of the last exchange;
    /// none while the device does not answer.
    fn signal(&self, _index: usize) -> Option<f64> {
        None
    }

    /// What all signals show, by their index; called once a scan, before [`exchange`](Drives::exchange). Those that go to a device are
    /// commanded so.
    fn command_signals(&mut self, _values: &[f64]) {}

    /// Somebody wants the drives on, and inputs do not allow it: their devices, if they are lost, are looked for again, as long as
    /// nothing is driven.
    fn want_back(&mut self) {}

    /// How much too late the last exchange was for the clock that the drives share, in ns; 0 where they have none. The clock of the
    /// scans follows it.
    fn exchanged_late_ns(&self) -> i64 {
        0
    }

    /// What the fieldbus did in the last exchange, for observers; none where drives are simulated. The master puts in the scan.
    fn bus_cycle(&self) -> Option<BusCycle> {
        None
    }

    /// What bench instruments read of `axis` in the last exchange; nothing on a real machine.
    fn instruments(&self, axis: usize) -> &[InstrumentSample];

    /// Bytes of a saved state.
    fn state_bytes(&self) -> usize;

    /// Writes what must outlive the process into `bytes`, [`state_bytes`](Drives::state_bytes) long. Nothing where positions
    /// and power outlive it in the drives themselves.
    fn save(&self, bytes: &mut [u8]);

    /// Goes on from a saved state: the drives have braked to rest by themselves meanwhile.
    ///
    /// # Errors
    /// No drive can be in this state.
    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused>;
}
