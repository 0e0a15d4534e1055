//! How far an axis drops while nothing commands it to move: its drive is off or has tripped, and torque or brake are to hold it.

use bus::sample::{AxisFeedback, Cause, Mode};
use machine::Axis;

/// A slower axis stands, in mm/s.
const STANDSTILL_MM_S: f64 = 0.5;
/// One that has stood so long has been brought to rest, in s: what the loop of its drive swings before is no drop.
const STOOD_S: f64 = 0.05;

/// The largest way of the table in the direction of the weight while its drive is off or the machine has tripped: from where it had been
/// brought to rest; where its drive has no power, at once from where it stands or turns round. The way that it takes to brake is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropMeter {
    /// 1 where the weight pulls towards lower positions, else -1.
    down: f64,
    /// Scans that it has stood, and those after which it has been brought to rest.
    stood_scans: u32,
    stood_scans_min: u32,
    /// Where it is to be held, in mm, counted upwards.
    held_mm: Option<f64>,
    /// The largest drop, in mm.
    pub most_mm: f64,
    /// What the closing time of the brake allows, in mm: `½·a·t²` with `a` = weight over moved mass; none without a brake or a model.
    pub allowed_mm: Option<f64>,
}

impl DropMeter {
    /// Of this axis; none where nothing pulls it.
    pub fn of(axis: &Axis, scan_s: f64) -> Option<DropMeter> {
        let weight_n = axis.weight_n();
        let brake = axis.brake.zip(axis.model);
        let allowed_mm = brake.map(|(brake, model)| {
            let (closing_s, a_m_s2) = (brake.closing_ms * 1e-3, weight_n.abs() / model.mass_kg);
            0.5 * a_m_s2 * closing_s * closing_s * 1e3
        });
        (weight_n != 0.0).then_some(DropMeter {
            down: weight_n.signum(),
            stood_scans: 0,
            stood_scans_min: (STOOD_S / scan_s) as u32,
            held_mm: None,
            most_mm: 0.0,
            allowed_mm,
        })
    }

    /// One scan: the mode and the cause of the stop, what its drive shows, and where instruments saw the table, in mm.
    pub fn take(
        &mut self,
        (mode, cause): (Option<Mode>, Option<Cause>),
        feedback: &AxisFeedback,
        table_mm: impl IntoIterator<Item = f64>,
    ) {
        let upwards_mm_s = self.down * feedback.velocity_mm_s;
        self.stood_scans = if upwards_mm_s.abs() <= STANDSTILL_MM_S {
            self.stood_scans.saturating_add(1)
        } else {
            0
        };
        if !matches!(mode, Some(Mode::Disabled | Mode::Tripped)) {
            self.held_mm = None;
            return;
        }
        let powerless = matches!(
            cause,
            Some(Cause::DriveOff | Cause::DriveLost | Cause::DriveFault)
        );
        let rests = self.stood_scans >= self.stood_scans_min;
        for table_mm in table_mm {
            let height_mm = self.down * table_mm;
            match &mut self.held_mm {
                Some(held_mm) if powerless && upwards_mm_s > STANDSTILL_MM_S => {
                    *held_mm = held_mm.max(height_mm);
                }
                Some(held_mm) => self.most_mm = self.most_mm.max(*held_mm - height_mm),
                None if rests || powerless && upwards_mm_s >= -STANDSTILL_MM_S => {
                    self.held_mm = Some(height_mm);
                }
                None => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn a_drop_counts_from_where_the_axis_was_brought_to_rest_or_had_no_power_any_more() {
        let mut meter = DropMeter {
            down: 1.0,
            stood_scans: 0,
            stood_scans_min: 2,
            held_mm: None,
            most_mm: 0.0,
            allowed_mm: None,
        };
        let mut take = |mode, cause, velocity_mm_s, table_mm: f64| {
            let feedback = AxisFeedback {
                velocity_mm_s,
                ..AxisFeedback::zeroed()
            };
            meter.take((Some(mode), Some(cause)), &feedback, [table_mm]);
            meter.most_mm
        };
        // A program moves it, it brakes and swings, it stands and sags.
        let stop = Cause::EmergencyStop;
        assert_eq!(take(Mode::Enabled, Cause::None, 0.0, 9.0), 0.0);
        assert_eq!(take(Mode::Tripped, stop, -20.0, 8.0), 0.0);
        assert_eq!(take(Mode::Tripped, stop, 3.0, 7.5), 0.0);
        assert_eq!(take(Mode::Tripped, stop, 0.0, 7.0), 0.0);
        assert_eq!(take(Mode::Tripped, stop, 0.0, 7.0), 0.0);
        assert_eq!(take(Mode::Tripped, stop, -0.1, 6.75), 0.25);
        // Power is lost on the way up, and it falls from where it turned round.
        let lost = Cause::DriveOff;
        assert_eq!(take(Mode::Enabled, Cause::None, 20.0, 8.0), 0.25);
        assert_eq!(take(Mode::Tripped, lost, 5.0, 9.0), 0.25);
        assert_eq!(take(Mode::Tripped, lost, 2.0, 9.5), 0.25);
        assert_eq!(take(Mode::Tripped, lost, -8.0, 9.0), 0.5);
    }
}
