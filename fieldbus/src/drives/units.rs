//! Factors between the numbers of a drive and those of the machine.

use crate::drive_file::DriveFile;

/// Factors between the drive's numbers and the machine's; of a spindle mm are turns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Units {
    /// mm of travel of one increment; negative where the drive counts the other way.
    pub mm_per_increment: f64,
    /// Value of the drive's velocity at 1 mm/s.
    pub velocity_per_mm_s: f64,
    /// Thousandths of the rated torque at 1 N·m.
    pub torque_per_nm: f64,
}

impl Units {
    /// Of a drive whose motor moves the table by `lead_mm` in one turn.
    pub fn of(drive: &DriveFile, lead_mm: f64) -> Units {
        let scaling = &drive.scaling;
        let sign = if scaling.direction < 0 { -1.0 } else { 1.0 };
        let turns = f64::from(scaling.position_turns);
        let turns_per_increment = match scaling.position_increments {
            // It shows no position.
            0 => 0.0,
            increments => turns / f64::from(increments),
        };
        // In 1 mm/s there are 60/lead rev/min.
        let rpm_per_mm_s = 60.0 / lead_mm;
        Units {
            mm_per_increment: sign * lead_mm * turns_per_increment,
            velocity_per_mm_s: sign * rpm_per_mm_s * f64::from(scaling.velocity_units)
                / f64::from(scaling.velocity_rpm),
            torque_per_nm: sign * 1000.0 / scaling.rated_torque_nm,
        }
    }
}
