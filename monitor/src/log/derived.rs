//! One row per axis and scan in plain units, `/axis/X`, so that a plotting tool shows something readable at once.
//!
//! A row needs feedback, instruments and command of one scan, which come through different queues: rows wait in a ring
//! until they are whole. A row that is pushed out earlier is written with NaN for what is missing.

use bus::sample::{AxisCommand, Feedback, Instruments};
use bus::table;
use bytemuck::{Pod, Zeroable};
use machine::{Machine, PositionFeedback};

use super::sample::SampleRef;

/// Scans a row waits for its missing parts.
pub const RING_SCANS: usize = 1024;

const FEEDBACK: u8 = 1;
const INSTRUMENTS: u8 = 2;
const COMMAND: u8 = 4;
const WHOLE: u8 = FEEDBACK | INSTRUMENTS | COMMAND;

/// One axis in one scan.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AxisRow {
    /// Scan × scan period, in s.
    pub time_s: f64,
    /// Position command of the scan, in mm.
    pub command_mm: f64,
    /// What the servo read, in mm.
    pub feedback_mm: f64,
    /// The table at the end of the scan, in mm.
    pub table_mm: f64,
    /// Command minus feedback, compensation not counted, in µm.
    pub following_error_um: f64,
    /// Velocity measured by the drive, in mm/s.
    pub velocity_mm_s: f64,
    /// Motor torque, in N·m.
    pub torque_nm: f64,
    /// Winding temperature above ambient, in K.
    pub winding_k: f64,
    /// Backlash acceleration now being output, in mm/s.
    pub pulse_mm_s: f64,
}
table!(
    AxisRow: time_s, command_mm, feedback_mm, table_mm, following_error_um, velocity_mm_s, torque_nm, winding_k,
    pulse_mm_s,
);

#[derive(Clone, Copy)]
struct Slot {
    scan: u64,
    seen: u8,
    row: AxisRow,
}

/// Rows that wait, per axis.
pub struct Rows {
    increment_mm: Vec<f64>,
    scale: Vec<bool>,
    period_s: f64,
    slots: Vec<Slot>,
}

impl Rows {
    /// Of a machine's axes.
    pub fn new(machine: &Machine) -> Self {
        let empty = Slot {
            scan: u64::MAX,
            seen: 0,
            row: missing_row(f64::NAN),
        };
        Rows {
            increment_mm: machine.axes.iter().map(|a| a.increment_mm()).collect(),
            scale: machine
                .axes
                .iter()
                .map(|a| a.feedback == PositionFeedback::Scale)
                .collect(),
            period_s: machine.scan_period_s(),
            slots: vec![empty; machine.axes.len() * RING_SCANS],
        }
    }

    /// Takes one sample; rows that it makes whole, or that have to make place for it, go to `out`: index of the axis, scan, row.
    pub fn take(&mut self, sample: SampleRef<'_>, out: &mut Vec<(usize, u64, AxisRow)>) {
        match sample {
            SampleRef::Feedback(feedback) => self.feedback(feedback, out),
            SampleRef::Instruments(instruments) => self.instruments(instruments, out),
            SampleRef::Command(axis, command) => self.command(axis, command, out),
            _ => {}
        }
    }

    /// Fills in a part of one row; hands rows that became whole, or had to make place, to `out`.
    fn fill(
        &mut self,
        axis: usize,
        scan: u64,
        part: u8,
        set: impl FnOnce(&mut AxisRow),
        out: &mut Vec<(usize, u64, AxisRow)>,
    ) {
        let Some(slot) = self
            .slots
            .get_mut(axis * RING_SCANS + scan as usize % RING_SCANS)
        else {
            return;
        };
        if slot.scan != scan {
            if slot.scan != u64::MAX && slot.scan > scan {
                return; // Came too late: its row has been written.
            }
            if slot.seen & FEEDBACK != 0 && slot.seen != WHOLE {
                out.push((axis, slot.scan, slot.row));
            }
            *slot = Slot {
                scan,
                seen: 0,
                row: missing_row(scan as f64 * self.period_s),
            };
        }
        if slot.seen & part != 0 {
            return; // The other role's command says the same.
        }
        set(&mut slot.row);
        slot.seen |= part;
        if slot.seen == WHOLE {
            out.push((axis, scan, slot.row));
        }
    }

    fn feedback(&mut self, sample: &Feedback, out: &mut Vec<(usize, u64, AxisRow)>) {
        for (axis, feedback) in sample.axes.iter().enumerate() {
            let (Some(&increment_mm), Some(&scale)) =
                (self.increment_mm.get(axis), self.scale.get(axis))
            else {
                return;
            };
            let position = if scale {
                feedback.scale_position
            } else {
                feedback.motor_position
            };
            let set = |row: &mut AxisRow| {
                row.feedback_mm = position as f64 * increment_mm;
                row.velocity_mm_s = feedback.velocity_mm_s;
                row.torque_nm = feedback.torque_nm;
                row.winding_k = feedback.winding_k;
            };
            self.fill(axis, sample.scan, FEEDBACK, set, out);
        }
    }

    fn instruments(&mut self, sample: &Instruments, out: &mut Vec<(usize, u64, AxisRow)>) {
        let last = (sample.subsamples as usize).saturating_sub(1);
        for axis in 0..self.increment_mm.len() {
            let seen = sample.axes.get(axis);
            let table_mm = seen.and_then(|axis| axis.table_mm.get(last));
            let set = |row: &mut AxisRow| row.table_mm = table_mm.copied().unwrap_or(f64::NAN);
            self.fill(axis, sample.scan, INSTRUMENTS, set, out);
        }
    }

    fn command(&mut self, axis: usize, sample: &AxisCommand, out: &mut Vec<(usize, u64, AxisRow)>) {
        let Some(&increment_mm) = self.increment_mm.get(axis) else {
            return;
        };
        let set = |row: &mut AxisRow| {
            row.command_mm = sample.position as f64 * increment_mm;
            row.following_error_um = sample.following_error_mm * 1e3;
            row.pulse_mm_s = sample.friction_pulse_mm_s;
        };
        self.fill(axis, sample.scan, COMMAND, set, out);
    }

    /// The rows of the scans before `scan` that have not become whole and now never will, by axis and in order of scan.
    pub fn rest(&mut self, scan: u64, out: &mut Vec<(usize, u64, AxisRow)>) {
        let before = |slot: &&mut Slot| slot.scan < scan;
        for (index, slot) in self.slots.iter_mut().enumerate().filter(|s| before(&s.1)) {
            if slot.seen & FEEDBACK != 0 && slot.seen != WHOLE {
                out.push((index / RING_SCANS, slot.scan, slot.row));
            }
            slot.seen = 0;
        }
        out.sort_by_key(|(axis, scan, _)| (*axis, *scan));
    }
}

fn missing_row(time_s: f64) -> AxisRow {
    AxisRow {
        time_s,
        command_mm: f64::NAN,
        feedback_mm: f64::NAN,
        table_mm: f64::NAN,
        following_error_um: f64::NAN,
        velocity_mm_s: f64::NAN,
        torque_nm: f64::NAN,
        winding_k: f64::NAN,
        pulse_mm_s: f64::NAN,
    }
}
