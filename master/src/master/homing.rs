//! Homing: axes without absolute encoders find their place, one after another (docs/howto/home.md).
//!
//! Each search is a motion by hand. Where the axis is known is latched as what has to be added to the raw
//! position of its drive; it takes effect while the drive holds the axis by itself, so that no loop sees it jump.
//!
//! The two motors of a gantry move together, and a motion ends when both have found what they look for, each by its own switch and
//! index. Once both know their places the bridge is squared: the second motor is commanded to be where the first is.

use bus::sample::{Cause, Driver, MAX_AXES, Reference, Refused};
use machine::{Homing as Settings, HomingMethod, INDEX_TURNS};

use super::Master;
use super::axes::Axes;
use super::axis_unit::AxisUnit;
use super::hand::{HandSpeed, Motion};
use super::orders::{Refusal, whole_number};
use crate::drives::Drives;
use crate::saved::HomingLatches;

/// Scans that the drive holds the axis before and after its positions change: everybody has seen it by then.
pub(super) const HOLD_SCANS: u64 = 8;

/// What an axis is doing to be homed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// It stands on the switch: away from it, at search speed.
    Leave,
    /// Towards the switch.
    Search,
    /// Slowly off the switch.
    Back,
    /// Slowly back to its edge.
    Edge,
    /// On to the index, from the raw position of the edge; without a switch from where it began.
    Index { from: i64 },
    /// The drive does it.
    Drive,
    /// The drive holds the axis, and its positions change.
    Set,
    /// It is homed, and goes to where it is to stand.
    Rest,
}

/// One motor of the axis that is being homed.
#[derive(Debug, Clone, Copy)]
struct Motor {
    /// Its place among the axes.
    axis: usize,
    /// What it looks for.
    step: Step,
    /// What it has found leads to this step, once the other motor has found it too.
    next: Option<Step>,
    /// Raw position of the reference point, in increments, once it is known.
    reference: Option<i64>,
}

impl Motor {
    fn new(axis: usize, step: Step) -> Motor {
        Motor {
            axis,
            step,
            next: None,
            reference: None,
        }
    }
}

/// Axes that are being homed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Homing {
    /// Axes that wait, a bit each.
    waiting: u32,
    /// The axis's own motor, and its second one.
    motor: Motor,
    second: Option<Motor>,
    /// The step's motion has been begun, and scans since.
    begun: bool,
    scans: u64,
    /// What was looked for is found: it comes to rest, for the next step.
    stops: bool,
    /// It is to come to rest where it can, and to end.
    ends: bool,
}

impl Homing {
    /// Whether the drive of this axis is to home it.
    pub fn by_drive(&self, index: usize) -> bool {
        let motor = &self.motor;
        motor.axis == index && self.begun && motor.step == Step::Drive && !self.ends
    }

    fn motors(&self) -> impl Iterator<Item = &Motor> {
        std::iter::once(&self.motor).chain(&self.second)
    }

    fn motors_mut(&mut self) -> impl Iterator<Item = &mut Motor> {
        std::iter::once(&mut self.motor).chain(&mut self.second)
    }
}

/// What one scan of a step makes out.
enum Found {
    /// Nothing yet.
    Nothing,
    /// The step has found what it looked for: the axis stops, then this step.
    Stop(Step),
    /// It goes on with this step as it moves.
    GoOn(Step),
    /// It has not found it.
    Failed(Cause),
}

impl AxisUnit {
    /// Position that its drive shows, in increments.
    fn raw_position(&self) -> i64 {
        self.increments(self.drive().motor_position_mm)
    }

    fn switch_is_actuated(&self, homing: &Settings, inputs: u64) -> bool {
        let shows = homing
            .switch_input
            .is_some_and(|input| inputs >> input.min(63) & 1 == 1);
        shows != homing.switch_normally_closed
    }

    /// One scan of a step that moves; what it makes out.
    fn look(&self, homing: &Settings, step: Step, inputs: u64) -> Found {
        let actuated = self.switch_is_actuated(homing, inputs);
        match step {
            Step::Leave if !actuated => Found::Stop(Step::Search),
            Step::Search if actuated => Found::Stop(Step::Back),
            Step::Back if !actuated => Found::Stop(Step::Edge),
            Step::Edge if actuated && homing.method == HomingMethod::SwitchIndex => {
                Found::GoOn(Step::Index {
                    from: self.raw_position(),
                })
            }
            Step::Edge if actuated => Found::Stop(Step::Set),
            Step::Index { .. } if self.drive().index_mm.is_some() => Found::Stop(Step::Set),
            Step::Index { from } if homing.method == HomingMethod::SwitchIndex => {
                let most = self.increments(INDEX_TURNS * self.settings.lead_mm);
                if self.raw_position().abs_diff(from) > most.unsigned_abs() {
                    Found::Failed(Cause::HomeIndex)
                } else {
                    Found::Nothing
                }
            }
            _ => Found::Nothing,
        }
    }

    /// Speed of a step, in mm/s, and where it is to end without finding anything, in increments; none where the drive holds the axis.
    fn search(&self, homing: &Settings, step: Step) -> Option<(f64, i64)> {
        let sign = homing.direction.sign();
        let (search, latch) = (homing.search_mm_s, homing.latch_mm_s);
        let (speed_mm_s, sign) = match step {
            Step::Leave => (search, -sign),
            Step::Search => (search, sign),
            Step::Back => (latch, -sign),
            Step::Edge | Step::Index { .. } => (latch, sign),
            Step::Rest => return Some((search, self.increments(self.settings.rest_mm()?))),
            Step::Drive | Step::Set => return None,
        };
        let way = self.increments(self.settings.search_distance_mm());
        let end = self
            .command_position()
            .saturating_add(way.saturating_mul(sign));
        Some((speed_mm_s.min(self.settings.rapid_mm_s), end))
    }
}

impl Axes {
    /// What must outlive this master.
    pub(super) fn homing_latches(&self) -> HomingLatches {
        let mut latches = HomingLatches::default();
        let offsets = latches.offset.iter_mut().zip(self.iter()).enumerate();
        for (index, (offset, axis)) in offsets {
            *offset = axis.offset();
            let known = axis.reference() == Reference::Known;
            latches.homed |= u64::from(known) << index;
            latches.unsure |= u64::from(axis.place.is_unsure()) << index;
        }
        latches
    }

    /// Goes on where a master before this one left. An axis that it was homing is not homed.
    pub(super) fn resume_homing(&mut self, latches: &HomingLatches) {
        let offsets = latches.offset.iter().enumerate();
        for ((index, offset), axis) in offsets.zip(self.iter_mut()) {
            if latches.unsure >> index & 1 == 1 {
                axis.place.doubt();
            }
            let Some(homing) = axis.settings.homing else {
                continue;
            };
            let homed = latches.homed >> index & 1 == 1;
            if homed && homing.method != HomingMethod::Drive {
                axis.set_reference(Reference::Known);
            }
            axis.judge_reference();
            axis.count_from(*offset);
        }
    }
}

impl<D: Drives> Master<D> {
    /// Homes the axes whose bits are set, or all that can be homed.
    pub(super) fn order_home(&mut self, bits: f64) -> Result<(), Refusal> {
        self.must_rest()?;
        if self.auxiliary.is_coupled() {
            return Err(Refused::InThread.into());
        }
        if self.windows.has_started() {
            return Err(Refused::Running.into());
        }
        self.signals_allow(false)?;
        let all = (1u64 << self.axes.len().min(MAX_AXES)) - 1;
        let asked = whole_number(bits)?;
        let followers = self.gantries.followers();
        if u64::from(asked) & (!all | followers) != 0 {
            return Err(Refused::UnknownAxis.into());
        }
        let homes = self
            .axes
            .iter()
            .enumerate()
            .filter(|(index, _)| !self.gantries.is_follower(*index))
            .fold(0, |homes, (index, axis)| {
                homes | u32::from(axis.settings.homing.is_some()) << index
            });
        let waiting = if asked == 0 { homes } else { asked };
        if waiting == 0 || waiting & !homes != 0 {
            return Err(Refused::Absolute.into());
        }
        self.modes.forget(&[
            Cause::HomeSwitch,
            Cause::HomeIndex,
            Cause::HomeDrive,
            Cause::Abort,
        ]);
        self.take_in_hand();
        self.home_next(waiting);
        Ok(())
    }

    /// Begins with the next of the axes that wait; ends without one.
    fn home_next(&mut self, waiting: u32) {
        let inputs = self.digital_inputs();
        let axes = self.axes.iter().enumerate();
        let due = axes.filter(|(index, _)| waiting >> index & 1 == 1);
        let due = due.filter_map(|(index, axis)| Some((index, axis.settings.homing?)));
        let Some((index, homing)) = due.min_by_key(|(index, homing)| (homing.order, *index)) else {
            self.manual.homing = None;
            return;
        };
        let second = self.gantries.led_by(index).map(|pair| pair.follower);
        let mut leaves = false;
        for motor in [Some(index), second].into_iter().flatten() {
            let Some(axis) = self.axes.get_mut(motor) else {
                return;
            };
            axis.set_reference(Reference::Searching);
            let settings = axis.settings.homing;
            leaves |= settings.is_some_and(|of| axis.switch_is_actuated(&of, inputs));
        }
        let first_step = |axis: &AxisUnit| match homing.method {
            HomingMethod::Drive => Step::Drive,
            HomingMethod::Index => Step::Index {
                from: axis.raw_position(),
            },
            _ if leaves => Step::Leave,
            _ => Step::Search,
        };
        let motor = |axis: usize| {
            let step = self.axes.get(axis).map_or(Step::Search, first_step);
            Motor::new(axis, step)
        };
        self.manual.homing = Some(Homing {
            waiting: waiting & !(1 << index),
            motor: motor(index),
            second: second.map(motor),
            begun: false,
            scans: 0,
            stops: false,
            ends: false,
        });
        self.auxiliary.latched();
    }

    /// One scan of homing.
    pub(super) fn step_homing(&mut self) {
        let inputs = self.digital_inputs();
        let Some(homing) = &mut self.manual.homing else {
            return;
        };
        homing.scans = homing.scans.saturating_add(1);
        let homing = *homing;
        let index = homing.motor.axis;
        let Some(axis) = self.axes.get(index) else {
            return;
        };
        let Some(settings) = axis.settings.homing else {
            return;
        };
        let driver = axis.hand.driver();
        let rests = driver == Driver::Manual && self.is_done_by_hand(index);
        if homing.ends {
            let stands = axis.stands();
            let held = driver == Driver::Drive && homing.scans > HOLD_SCANS && stands;
            if rests || held || driver == Driver::Program {
                self.give_up_homing();
            }
        } else if !homing.begun {
            self.begin_step(&settings);
        } else if driver == Driver::Drive {
            self.hold_step(&settings);
        } else {
            self.move_step(rests, inputs);
        }
    }

    /// Begins the motion of a step, from rest.
    fn begin_step(&mut self, settings: &Settings) {
        let Some(homing) = &mut self.manual.homing else {
            return;
        };
        (homing.begun, homing.stops, homing.scans) = (true, false, 0);
        let Motor {
            axis: index, step, ..
        } = homing.motor;
        let search = self.axes.get(index).map(|axis| axis.search(settings, step));
        for motor in self.gantries.motors_of(index) {
            let Some(axis) = self.axes.get_mut(motor) else {
                continue;
            };
            match search.flatten() {
                Some((speed_mm_s, end)) => {
                    let speed = HandSpeed {
                        full_mm_s: speed_mm_s,
                        most_mm_s: speed_mm_s,
                    };
                    // The override is of jogs alone.
                    let way = (axis.command_position(), end);
                    axis.hand.move_to(Motion::Homing, way, (speed, 1.0), None);
                }
                None => axis.hand.give_to_drive(),
            }
        }
    }

    /// One scan of a step that the servo drives.
    fn move_step(&mut self, rests: bool, inputs: u64) {
        let Some(mut homing) = self.manual.homing else {
            return;
        };
        if homing.stops {
            homing.begun = !rests;
            self.manual.homing = Some(homing);
            return;
        }
        if homing.motor.step == Step::Rest {
            if rests {
                self.end_hands(&homing);
                self.home_next(homing.waiting);
            }
            return;
        }
        let mut failed = None;
        for motor in homing.motors_mut().filter(|motor| motor.next.is_none()) {
            let Some(axis) = self.axes.get(motor.axis) else {
                return;
            };
            let Some(settings) = &axis.settings.homing else {
                return;
            };
            let found = match axis.look(settings, motor.step, inputs) {
                Found::Nothing if rests => Found::Failed(match motor.step {
                    Step::Index { .. } => Cause::HomeIndex,
                    _ => Cause::HomeSwitch,
                }),
                found => found,
            };
            match found {
                Found::Nothing => {}
                Found::GoOn(step) => motor.step = step,
                Found::Stop(step) => {
                    let index = axis.drive().index_mm.map(|mm| axis.increments(mm));
                    motor.reference = match motor.step {
                        Step::Index { .. } => index,
                        Step::Edge => Some(axis.raw_position()),
                        _ => None,
                    };
                    motor.next = Some(step);
                }
                Found::Failed(cause) => failed = failed.or(Some((cause, motor.axis as u32))),
            }
        }
        if let Some((cause, axis)) = failed {
            self.manual.homing = Some(homing);
            return self.fail_homing(cause, axis);
        }
        if homing.motors().all(|motor| motor.next.is_some()) {
            for motor in homing.motors_mut() {
                motor.step = motor.next.take().unwrap_or(motor.step);
            }
            homing.stops = true;
            for motor in homing.motors() {
                if let Some(axis) = self.axes.get_mut(motor.axis) {
                    axis.hand.stop_search();
                }
            }
        }
        self.manual.homing = Some(homing);
    }

    /// The motors of the axis that was homed stand in the hand.
    fn end_hands(&mut self, homing: &Homing) {
        for motor in homing.motors() {
            if let Some(axis) = self.axes.get_mut(motor.axis) {
                axis.hand.end_motion();
            }
        }
    }

    /// One scan of a step in which the drive holds the axis or homes it.
    fn hold_step(&mut self, settings: &Settings) {
        let patience = libm::ceil(settings.patience_s / self.timing.scan_period_s) as u64;
        let Some(homing) = &mut self.manual.homing else {
            return;
        };
        let index = homing.motor.axis;
        if homing.motor.step == Step::Drive {
            let axis = self.axes.get(index);
            if axis.is_some_and(|axis| axis.drive().referenced) {
                homing.motor.step = Step::Set;
                homing.scans = 0;
            } else if homing.scans > patience {
                self.trip(Cause::HomeDrive, index as u32);
            }
            return;
        }
        let scans = homing.scans;
        let stands = homing.motors().all(|motor| {
            let axis = self.axes.get(motor.axis);
            axis.is_none_or(AxisUnit::stands)
        });
        if scans <= HOLD_SCANS || !stands {
            return;
        }
        if self.set_references() {
            self.auxiliary.latched();
            return;
        }
        let Some(homing) = &mut self.manual.homing else {
            return;
        };
        let mut rests = false;
        for motor in homing.motors_mut() {
            if let Some(axis) = self.axes.get_mut(motor.axis) {
                axis.set_reference(Reference::Known);
                axis.hand.take_from_drive();
                motor.step = Step::Rest;
                rests |= axis.settings.rest_mm().is_some();
            }
        }
        homing.begun = false;
        let waiting = homing.waiting;
        self.auxiliary.latched();
        if !rests {
            self.home_next(waiting);
        }
    }

    /// Gives the motors the places that they have found; false once that is done.
    fn set_references(&mut self) -> bool {
        let Some(homing) = &mut self.manual.homing else {
            return false;
        };
        let mut sets = false;
        for motor in homing.motors_mut() {
            let axis = self.axes.get_mut(motor.axis);
            let Some((reference, axis)) = motor.reference.take().zip(axis) else {
                continue;
            };
            let position_mm = axis
                .settings
                .homing
                .map_or(0.0, |homing| homing.position_mm);
            axis.count_from(axis.increments(position_mm).saturating_sub(reference));
            sets = true;
        }
        if sets {
            homing.scans = 0;
        }
        sets
    }

    /// What was looked for is not there: the axis comes to rest, and whoever ordered it sees why.
    fn fail_homing(&mut self, cause: Cause, axis: u32) {
        self.modes.blame(cause, axis, self.scan);
        self.rest_all_by_hand();
    }

    /// The axis that is being homed is to come to rest, and is not homed then.
    pub(super) fn end_homing(&mut self) {
        // Asked for in each scan while a door is open, it comes to its end all the same.
        if let Some(homing) = self.manual.homing.as_mut().filter(|of| !of.ends) {
            homing.ends = true;
            homing.scans = 0;
        }
    }

    /// It is not homed, whatever it was before; on its way to where it is to stand it is.
    pub(super) fn give_up_homing(&mut self) {
        let Some(homing) = self.manual.homing.take() else {
            return;
        };
        self.end_hands(&homing);
        for motor in homing.motors().filter(|motor| motor.step != Step::Rest) {
            if let Some(axis) = self.axes.get_mut(motor.axis) {
                axis.hand.take_from_drive();
                axis.set_reference(Reference::Missing);
                axis.judge_reference();
            }
        }
        self.auxiliary.latched();
    }

    fn digital_inputs(&self) -> u64 {
        self.auxiliary.questions.digital()
    }
}
