//! Motions by hand of the whole machine: what an order did, increments that were taken, the axis that is homed, and how long the
//! hand stays on.

use machine::Machine;

use super::homing::Homing;
use super::jog::Numbered;

/// Time at rest after which the program's controllers drive again, in s.
const HAND_ON_S: f64 = 2.0;

/// What an order did by hand, for its answer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ByOrder {
    /// Way taken of an increment or of a wheel's counts, in mm.
    pub jogged_mm: f64,
    /// Counts of a wheel that were taken, signed.
    pub counts: i32,
    /// The first axis whose motion was cut short, and where it will stand, in increments.
    pub cut: Option<(u32, i64)>,
}

/// Motions by hand of the whole machine.
#[derive(Debug, Clone)]
pub(super) struct Manual {
    /// Speed of jogs whose order names none, in mm/s.
    jog_mm_s: f64,
    /// Increments that were taken.
    pub numbered: Numbered,
    /// Axes that are being homed.
    pub homing: Option<Homing>,
    by_order: ByOrder,
    /// Scans that axes at rest stay in the hand.
    hand_on_scans: u64,
}

impl Manual {
    pub fn new(machine: &Machine) -> Manual {
        Manual {
            jog_mm_s: machine.manual.jog_mm_s,
            numbered: Numbered::default(),
            homing: None,
            by_order: ByOrder::default(),
            hand_on_scans: 0,
        }
    }

    pub fn jog_mm_s(&self) -> f64 {
        self.jog_mm_s
    }

    pub fn homes(&self) -> bool {
        self.homing.is_some()
    }

    /// Whether the drive of this axis is to home it.
    pub fn is_homed_by_drive(&self, axis: usize) -> bool {
        self.homing.is_some_and(|homing| homing.by_drive(axis))
    }

    /// An order is judged: it has done nothing yet.
    pub fn begin_order(&mut self) {
        self.by_order = ByOrder::default();
    }

    pub fn by_order(&self) -> ByOrder {
        self.by_order
    }

    /// The order has taken so much of an increment, in mm.
    pub fn note_jogged(&mut self, way_mm: f64) {
        self.by_order.jogged_mm = way_mm;
    }

    /// The order has taken so many counts of a wheel.
    pub fn note_counts(&mut self, counts: i32) {
        self.by_order.counts = counts;
    }

    /// The order has cut a motion short; the first one is told.
    pub fn note_cut(&mut self, axis: u32, place: i64) {
        self.by_order.cut = self.by_order.cut.or(Some((axis, place)));
    }

    /// Something moves by hand: the hand stays on for a while afterwards.
    pub fn stay_on(&mut self, scan_s: f64) {
        self.hand_on_scans = (HAND_ON_S / scan_s) as u64;
    }

    /// One scan in which nothing moves by hand; whether the hand stays on.
    pub fn stays_on(&mut self) -> bool {
        self.hand_on_scans = self.hand_on_scans.saturating_sub(1);
        self.hand_on_scans > 0
    }

    /// State that a later scan depends on: scans that the hand stays on.
    pub fn inner(&self) -> u64 {
        self.hand_on_scans
    }
}
