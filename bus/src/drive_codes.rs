//! Codes by which drives say what is wrong, in words: the AL status code of a slave (ETG.1000.6), the error code of a drive (CiA 402,
//! object 603Fh).

use crate::sample::{Cause, Feedback};

wire_enum! {
    /// Why a drive is lost where no AL status code says it: above what 16 bits of such a code can be. Those that say more come first.
    #[derive(PartialOrd, Ord)]
    pub enum Silence {
        /// The interface has no link.
        NoLink = 0x1_0000 => "the interface has no link: look at the cable to the first device, and its power",
        /// Answers came, all of them after their time.
        Late = 0x2_0000 => "answers come, all too late: this PC is too slow or stalls (`quadrant doctor`), or the scan is too short",
        /// There is a link, and no answer.
        Nobody = 0x3_0000 => "nobody on the bus does, and the interface has a link: is the power of the drives on, is a cable cut behind the first device?",
        /// Others answer.
        Alone = 0x4_0000 => "others on the bus do: look at its power, and at the cable in front of it",
        /// The bus is not in operation.
        BusDown = 0x5_0000 => "the bus is not in operation: `quadrant status` says why, and `enable` starts it up again",
        /// The process that owns the bus does not answer.
        Owner = 0x6_0000 => "the process that owns the bus does not either",
    }
    /// What is known of it, and where to look.
    pub fn words
}

/// Set in the code of a drive that answers and is not in operation, beside its AL status.
const LEFT_OPERATION: u32 = 0x10_0000;

/// The code of a drive that answers and is not in operation, from its AL status and AL status code.
pub fn out_of_operation(al_status: u16, al_status_code: u16) -> u32 {
    match al_status_code {
        0 => LEFT_OPERATION | u32::from(al_status),
        code => code.into(),
    }
}

/// Why a drive is out of operation.
fn out(code: u32) -> String {
    match code & LEFT_OPERATION {
        0 => al_status(code as u16),
        _ => format!(
            "somebody took it out of operation, it is in {}",
            al_state(code as u16)
        ),
    }
}

/// Why a machine stopped, with what the drive of the axis says of it.
pub fn cause_words(feedback: &Feedback) -> String {
    let Some(cause) = Cause::from_wire(feedback.cause) else {
        return "an unknown cause".into();
    };
    let axis = feedback.axes.get(feedback.cause_axis as usize);
    with_code(cause, axis.map_or(0, |axis| axis.drive_code))
}

/// A cause, with the code that the drive has for it; 0 for none.
pub fn with_code(cause: Cause, code: u32) -> String {
    let words = cause.words();
    match cause {
        Cause::DriveFault if code != 0 => format!("{words} {code:04X}h ({})", drive_error(code)),
        Cause::DriveLost if code != 0 => match Silence::from_wire(code) {
            Some(silence) => format!("{words} ({})", silence.words()),
            None => format!("{words} as it should: {}", out(code)),
        },
        Cause::Displaced if code == 0 => {
            "nobody knows whether the axis moved while its drive was lost: see where it is, then `quadrant alarms acknowledge`".into()
        }
        Cause::Displaced => {
            let off_mm = f64::from(code as i32) * 1e-3;
            format!("{words} ({off_mm:+.3})")
        }
        Cause::Skew => {
            let skew_mm = f64::from(code as i32) * 1e-3;
            format!("{words}: {:.3}", skew_mm.abs())
        }
        Cause::GantryTorque => format!("{words}: {} %", (code as i32).unsigned_abs()),
        _ => words.into(),
    }
}

/// An error code of a drive: the groups of CiA 402 (IEC 61800-7-201, error codes).
pub fn drive_error(code: u32) -> &'static str {
    match code & 0xFFFF {
        0x1000..=0x10FF => "a fault that it does not name further",
        0x2110..=0x212F => "short circuit or earth fault at its input",
        0x2211..=0x2219 | 0x2310..=0x231F => "continuous overcurrent",
        0x2220..=0x222F | 0x2320 | 0x2330..=0x233F => "short circuit or earth fault at the motor",
        0x2340..=0x234F => "short circuit in the motor",
        0x2350..=0x235F => "load level (I²t): the motor did too much for too long",
        0x2200..=0x23FF => "overcurrent",
        0x3100..=0x31FF => "mains voltage",
        0x3210..=0x321F => "voltage of its d.c. link too high: braking energy has no place to go",
        0x3220..=0x322F => "voltage of its d.c. link too low: is the power on?",
        0x3200..=0x33FF => "voltage",
        0x4110..=0x411F => "surroundings too hot",
        0x4210..=0x421F => "drive too hot",
        0x4310..=0x431F => "motor too hot",
        0x4000..=0x4FFF => "temperature",
        0x5100..=0x51FF => "its supply of low voltage",
        0x5400..=0x54FF => "power section; safe torque off (STO) with many vendors",
        0x5500..=0x5FFF | 0x5000..=0x53FF => "hardware of the drive",
        0x6000..=0x6FFF => "software or settings of the drive",
        0x7100..=0x71FF => "brake, or a motor that is blocked",
        0x7300..=0x73FF => "encoder",
        0x7500..=0x75FF => "its communication inside",
        0x8100..=0x81FF => "communication",
        0x8300..=0x83FF => "torque control",
        0x8400..=0x84FF => "velocity control: speed too high",
        0x8611 => "following error in the drive",
        0x8600..=0x86FF => "positioning",
        0x8000..=0x8FFF => "monitoring",
        0x9000..=0x9FFF => "an external error",
        _ => "the manual of the drive knows this code",
    }
}

/// An AL status code in words, with what to do where that is known.
pub fn al_status(code: u16) -> String {
    let known = match code {
        0x0000 => "no error",
        0x0011 => "it cannot go from its state to the one that was asked for",
        0x0012 => "it does not know the state that was asked for",
        0x0016 => {
            "it refuses the mailbox: its sizes and addresses in the drive file must be those of the ESI file"
        }
        0x0017 => {
            "it refuses a sync manager: compare the drive file with the ESI file (`quadrant bus check DRIVE --esi FILE`)"
        }
        0x0018 => "it has no valid inputs",
        0x0019 => "it has no valid outputs",
        0x001A => {
            "it lost its synchronisation: frames come too irregularly; look at the PC (`quadrant doctor`), or let more be late (10F1:2)"
        }
        0x001B => "its watchdog has expired: no frame came for `bus.watchdog_ms`",
        0x001D => {
            "it refuses the sync manager of outputs: process_data.receive in the drive file is not what the drive has"
        }
        0x001E => {
            "it refuses the sync manager of inputs: process_data.transmit in the drive file is not what the drive has"
        }
        0x001F => "it refuses its watchdog",
        0x0024 => "it refuses its input mapping",
        0x0025 => "it refuses its output mapping",
        0x0026 => "its settings are at odds with each other",
        0x002B => "it has no valid inputs and outputs",
        0x002C => "it lost SYNC0: is another clock the reference, or does the PC not follow it?",
        0x002D => "no SYNC signal comes: it wants distributed clocks (`bus.sync = \"dc\"`)",
        0x0030 => {
            "it refuses its settings of distributed clocks: does it offer SYNC0 at all (`sync_mode` in the drive file)?"
        }
        0x0032 => "its clock could not be locked (PLL): the PC's frames are too irregular",
        0x0033 | 0x0034 => "it counted too many lost synchronisations: frames come too irregularly",
        0x0035 => "it cannot do this scan period: its manual says which",
        0x0036 => "it cannot do this period of SYNC0: its manual says which",
        0x0042 => "its mailbox failed",
        0x0050 => "its memory failed",
        _ => "the manual of the drive knows this code",
    };
    format!("AL status code {code:#06x}: {known}")
}

/// A state by its name.
pub fn al_state(al_status: u16) -> &'static str {
    match al_status & 0x0F {
        1 => "INIT",
        2 => "PRE-OP",
        3 => "BOOT",
        4 => "SAFE-OP",
        8 => "OP",
        _ => "no known state",
    }
}
