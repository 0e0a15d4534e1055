//! Spindle, coolant, outputs, tool changes and stops: events of the program, done one after the other where the path rests for
//! them. An event sets levels, so that one whose end is not known is done again without harm; how many are done is latched
//! (docs/developers/architecture.md, "Events").

use bus::sample::{
    Auxiliaries, Cause, EventCode, FLOOD, Feedback, HoldReason, Levels, MIST, MODES_RESET, Mode,
    OUTPUTS_AHEAD, OVERRIDE_MAX_PERCENT, PathTag, PlannerStatus, ProgramEvent, SpindleCommand,
    Waiting, with_bit,
};
use machine::{Machine, ToolChanger};

use super::Master;
use super::coupling::{Coupling, Followed, Gear};
use super::machine_codes::MachineCodes;
use super::program::Loaded;
use super::questions::Questions;
use crate::drives::{AuxiliaryFeedback, Drives};
use crate::saved::AuxiliaryLatches;

mod following;
mod panel;

/// Below this the spindle stands, in rev/min.
const STANDSTILL_RPM: f64 = 1.0;

impl AuxiliaryLatches {
    /// The speed that the cutting speed asks for at this place of the axis, in rev/min; without bound on the spindle's axis itself.
    fn surface_rpm(&self, place_mm: f64) -> f64 {
        let radius_mm = (place_mm - self.surface_centre_mm).abs();
        let rpm = self.surface_m_min * 1e3 / (std::f64::consts::TAU * radius_mm);
        match self.surface_limit_rpm {
            limit if limit > 0.0 => rpm.min(limit),
            _ => rpm,
        }
    }

    /// The gear between an axis and the spindle, while it is one.
    fn gear(&self) -> Option<Gear> {
        Some(Gear {
            axis: self.coupled.checked_sub(1)? as usize,
            mm_per_turn: self.mm_per_turn,
            turns: self.coupled_turns,
            place_mm: self.coupled_place_mm,
        })
    }

    fn couple(&mut self, gear: &Gear) {
        self.coupled = gear.axis as u32 + 1;
        self.mm_per_turn = gear.mm_per_turn;
        self.coupled_turns = gear.turns;
        self.coupled_place_mm = gear.place_mm;
    }

    /// The levels of a spindle at its speed and direction.
    fn set_spindle(&mut self) {
        let sign = match self.direction {
            1 => 1.0,
            2 => -1.0,
            _ => 0.0,
        };
        self.levels.spindle_rpm = sign * self.speed_rpm;
        self.levels.spindle = if sign == 0.0 {
            SpindleCommand::Stop as u32
        } else {
            SpindleCommand::Turn as u32
        };
    }

    fn stop_spindle(&mut self) {
        self.direction = 0;
        self.set_spindle();
    }

    fn switch_coolant(&mut self, bit: u32, on: bool) {
        if on {
            self.levels.coolant |= bit;
        } else {
            self.levels.coolant &= !bit;
        }
    }

    fn switch_output(&mut self, index: u32, on: bool) {
        self.levels.digital = with_bit(self.levels.digital, index as usize, on);
    }

    /// The program is done or given up: spindle at rest, coolant off. Outputs and tool stay.
    pub fn end_program(&mut self) {
        self.stop_spindle();
        self.levels.coolant = 0;
        self.leave_path();
    }

    /// Nothing of a path is in force any more. What turns and flows goes on.
    fn leave_path(&mut self) {
        self.coupled = 0;
        self.surface = 0;
        self.override_disabled = 0;
        self.stopped_for = Waiting::None as u32;
        self.line = 0;
        self.start_line = 0;
    }
}

/// Spindle, coolant, outputs, tool and stops of a machine.
#[derive(Debug, Clone)]
pub(super) struct Auxiliary {
    latches: AuxiliaryLatches,
    /// What the program asks, and inputs.
    pub questions: Questions,
    at_speed_share: f64,
    /// Lowest and highest speed.
    speeds_rpm: (f64, f64),
    changer: bool,
    spindle_patience_scans: u64,
    change_patience_scans: u64,
    shown: AuxiliaryFeedback,
    /// What the planner asks for where the machine rests; number 0 for nothing.
    asked: ProgramEvent,
    /// Number of the event that was begun and is not done.
    begun: u32,
    ahead: [ProgramEvent; OUTPUTS_AHEAD],
    waiting: Waiting,
    waited_scans: u64,
    /// M-codes that the machine does.
    pub machine_codes: MachineCodes,
    coupling: Coupling,
    /// What the follower asks of the spindle; none while it follows nothing.
    followed: Option<Followed>,
    /// It is to come into step before anything moves, after it has followed nothing, or a trip.
    catches_up: bool,
    /// Spindle and coolant act: the program runs, or is held.
    released: bool,
    /// The spindle is on its way back to its speed, after it was stopped in the middle of the program.
    comes_back: bool,
    /// What planners said up to this scan is of another program, or of another run of it.
    messages_after: u64,
    /// Something latched has changed since it was last asked.
    changed: bool,
}

impl Auxiliary {
    pub fn new(machine: &Machine) -> Auxiliary {
        let spindle = machine.spindle.as_ref();
        let scans = |seconds: f64| libm::ceil(seconds / machine.scan_period_s()) as u64;
        Auxiliary {
            latches: AuxiliaryLatches {
                optional_stop: u32::from(machine.program.optional_stop),
                rapid_override_percent: 100,
                jog_override_percent: 100,
                tool: machine.beginning.tool,
                levels: Levels {
                    tool: machine.beginning.tool,
                    ..Levels::default()
                },
                tool_offset: machine.beginning_offset(),
                tool_offset_of: machine.beginning.offset_of,
                ..AuxiliaryLatches::default()
            },
            questions: Questions::new(machine.scan_period_s()),
            at_speed_share: spindle.map_or(0.0, |spindle| spindle.at_speed_percent / 100.0),
            speeds_rpm: spindle.map_or((0.0, 0.0), |spindle| {
                (spindle.speed_min_rpm, spindle.speed_max_rpm)
            }),
            changer: machine.tool_change.by == ToolChanger::Changer,
            spindle_patience_scans: scans(spindle.map_or(0.0, |spindle| spindle.patience_s)),
            change_patience_scans: scans(machine.tool_change.patience_s),
            shown: AuxiliaryFeedback::default(),
            asked: ProgramEvent::default(),
            begun: 0,
            ahead: [ProgramEvent::default(); OUTPUTS_AHEAD],
            waiting: Waiting::None,
            waited_scans: 0,
            machine_codes: MachineCodes::new(machine),
            coupling: Coupling::new(spindle),
            followed: None,
            catches_up: true,
            released: false,
            comes_back: false,
            messages_after: 0,
            changed: false,
        }
    }

    /// What is commanded in this scan.
    pub fn levels(&self) -> Levels {
        let mut levels = self.latches.levels;
        if !self.released {
            levels.coolant = 0;
        }
        if !self.released || self.latches.coupled != 0 {
            levels.spindle = SpindleCommand::Stop as u32;
            levels.spindle_rpm = 0.0;
        }
        if let (Some(followed), Some(gear)) = (&self.followed, self.latches.gear()) {
            levels.spindle = SpindleCommand::Follow as u32;
            levels.spindle_rpm = followed.rpm;
            levels.followed_axis = gear.axis as u32;
        }
        levels.spindle_rpm = levels
            .spindle_rpm
            .clamp(-self.speeds_rpm.1, self.speeds_rpm.1);
        levels
    }

    /// The axis whose place is the radius that the speed follows.
    fn surface_axis(&self) -> Option<usize> {
        Some(self.latches.surface.checked_sub(1)? as usize)
    }

    /// Turns as fast as the cutting speed asks for with the axis at this place.
    fn turn_at_surface_speed(&mut self, place_mm: f64) {
        let (least_rpm, most_rpm) = self.speeds_rpm;
        let rpm = self.latches.surface_rpm(place_mm);
        self.latches.speed_rpm = if self.latches.surface_m_min > 0.0 {
            rpm.max(least_rpm).min(most_rpm)
        } else {
            0.0
        };
        if self.latches.levels.spindle == SpindleCommand::Turn as u32 {
            self.latches.set_spindle();
        }
    }

    fn turns(&self) -> bool {
        self.latches.levels.spindle == SpindleCommand::Turn as u32 && self.latches.coupled == 0
    }

    fn is_at_speed(&self) -> bool {
        let wanted_rpm = self.levels().spindle_rpm;
        let most_rpm = (self.at_speed_share * wanted_rpm.abs()).max(STANDSTILL_RPM);
        self.released && self.turns() && (self.shown.spindle_rpm - wanted_rpm).abs() <= most_rpm
    }

    fn stands(&self) -> bool {
        self.shown.spindle_rpm.abs() < STANDSTILL_RPM
    }

    fn tool(&self) -> u32 {
        if self.changer {
            self.shown.tool
        } else {
            self.latches.tool
        }
    }

    /// The spindle is on its way back to its speed.
    fn is_coming_back(&self) -> bool {
        self.comes_back && self.turns()
    }

    /// A changer is to bring the tool that is wanted, and the spindle stands.
    pub fn is_changing_tool(&self) -> bool {
        self.waiting == Waiting::ToolChange
    }

    /// Whether no motion may be planned: also in the scan in which somebody has resumed and the spindle knows nothing of it yet.
    fn is_blocked(&self) -> bool {
        let spindle = self.turns() && (self.comes_back || !self.released);
        let out_of_step = self.catches_up && self.followed.is_some();
        spindle || out_of_step || self.questions.brakes() || self.questions.waits_for_planner()
    }

    /// What the feedback shows: machine and changer, what the program asks and has said, inputs and the operator's switches.
    pub fn tell(&self, feedback: &mut Feedback) {
        feedback.auxiliary = self.told();
        feedback.messages = self.latches.messages;
        self.questions.tell(feedback);
        feedback.inputs.panel = self.panel();
    }

    /// A door is open: what turns and flows rests, until a program goes on.
    pub fn rest_for_door(&mut self) {
        self.released = false;
        self.comes_back = false;
    }

    /// What must outlive this master.
    pub fn latches(&self) -> AuxiliaryLatches {
        self.latches
    }

    fn told(&self) -> Auxiliaries {
        let stopped_for = Waiting::from_wire(self.latches.stopped_for).unwrap_or_default();
        let (waiting, line) = match stopped_for {
            Waiting::None => (self.waiting, self.asked.line),
            stop => (stop, self.latches.line),
        };
        Auxiliaries {
            levels: self.levels(),
            spindle_rpm: self.shown.spindle_rpm,
            spindle_turns: self.shown.spindle_turns,
            spindle_lag_turns: self.followed.map_or(0.0, |followed| followed.lag_turns),
            events_done: self.latches.events_done,
            line: if waiting == Waiting::None { 0 } else { line },
            waiting: waiting as u32,
            blocked: u32::from(self.is_blocked()),
            at_speed: u32::from(self.is_at_speed()),
            optional_stop: self.latches.optional_stop,
            override_disabled: self.latches.override_disabled,
            tool: self.tool(),
            coupled: match self.latches.gear() {
                Some(gear) if gear.mm_per_turn != 0.0 => self.latches.coupled,
                _ => 0,
            },
            start_line: self.latches.start_line,
            tool_offset_of: self.latches.tool_offset_of,
            tool_offset: self.latches.tool_offset,
            modes_of_run: self.latches.modes_of_run,
        }
    }

    /// The axis that brakes with the spindle, and the deceleration at which it may, in mm/s².
    pub fn brakes_together(&self) -> Option<(usize, f64)> {
        let gear = self.latches.gear().filter(|gear| gear.mm_per_turn != 0.0)?;
        Some((gear.axis, self.coupling.deceleration_mm_s2(&gear)))
    }

    /// What machine and changer show at the end of the scan.
    pub fn take(&mut self, shown: AuxiliaryFeedback) {
        self.shown = shown;
    }

    /// Goes on where a master before this one left; nothing acts before somebody resumes.
    pub fn resume(&mut self, latches: &AuxiliaryLatches) {
        let sound = |value: &f64| value.is_finite();
        let levels = &latches.levels;
        let values = [
            latches.speed_rpm,
            levels.spindle_rpm,
            levels.orientation_deg,
            latches.mm_per_turn,
            latches.coupled_turns,
            latches.coupled_place_mm,
            latches.surface_m_min,
            latches.surface_limit_rpm,
            latches.surface_centre_mm,
        ];
        let offset = &latches.tool_offset;
        if values.iter().chain(&levels.analog).chain(offset).all(sound) {
            self.latches = *latches;
            self.latches.rapid_override_percent = latches.rapid_override_percent.min(100);
            let most = OVERRIDE_MAX_PERCENT;
            self.latches.jog_override_percent = latches.jog_override_percent.min(most);
        }
    }

    /// Another program, or the same from its start, is to begin after this scan. A spindle that was switched on by hand goes on.
    pub fn forget_program(&mut self, scan: u64) {
        self.latches.leave_path();
        self.comes_back = false;
        self.latches.events_done = 0;
        self.latches.messages = 0;
        self.latches.levels.blocks_done = 0;
        self.messages_after = scan;
        self.questions.forget_program();
        self.forget_asked();
        self.ahead = [ProgramEvent::default(); OUTPUTS_AHEAD];
    }

    /// The program is stopped for good: spindle at rest, coolant off. Outputs and tool stay.
    pub fn end_program(&mut self) {
        self.latches.end_program();
    }

    /// The program that was running is given up, and its modes with it.
    pub fn discard_program(&mut self) {
        self.latches.modes_of_run = MODES_RESET;
        self.latches.end_program();
    }

    /// This run of a program is done; what turns and flows goes on behind it where the spindle is left to.
    pub fn end_run(&mut self, run: u32, leaves_spindle: bool) {
        if leaves_spindle {
            self.latches.leave_path();
        } else {
            self.latches.end_program();
        }
        self.latches.modes_of_run = run;
    }

    /// The program is to begin at this line; at its beginning for 0.
    pub fn seek_line(&mut self, line: u32) {
        self.latches.start_line = line;
    }

    /// Whether it is to begin at a line that the tool is not on the path of yet.
    pub fn seeks_line(&self) -> bool {
        self.latches.start_line != 0
    }

    /// The tool is on the path: the line was reached.
    pub fn reach_line(&mut self) {
        if self.seeks_line() {
            self.latches.start_line = 0;
            self.changed = true;
        }
    }

    /// Whether an axis is in step with the spindle.
    pub fn is_coupled(&self) -> bool {
        self.latches.coupled != 0
    }

    /// Whether this is the end of a block that single block is to stop behind, and has not stopped behind yet.
    pub fn stops_behind(&self, status: &PlannerStatus) -> bool {
        let event = &status.event;
        self.latches.single_block == 1
            && event.code == EventCode::BlockDone as u32
            && event.element > self.latches.levels.blocks_done
            && self.is_of_run(status)
    }

    /// The block is done, and the operator is waited for behind it: in a stop that the program makes here that is the stop.
    pub fn end_block(&mut self, event: &ProgramEvent, waits: bool) {
        if waits && self.latches.stopped_for == Waiting::None as u32 {
            self.latches.stopped_for = Waiting::SingleBlock as u32;
            self.latches.line = event.line;
        }
        self.latches.levels.blocks_done = event.element;
        self.changed = true;
    }

    /// Whether the planner has said this since the run began.
    pub fn is_of_run(&self, status: &PlannerStatus) -> bool {
        status.scan > self.messages_after
    }

    /// The path has come to so many messages: never fewer than before.
    fn take_messages(&mut self, status: &PlannerStatus) {
        if self.is_of_run(status) && status.messages > self.latches.messages {
            self.latches.messages = status.messages;
            self.changed = true;
        }
    }

    /// The operator resumes: what he was waited for is done.
    pub fn end_stop(&mut self) {
        if self.latches.stopped_for == Waiting::ToolByOperator as u32 {
            self.latches.tool = self.latches.levels.tool;
        }
        self.latches.stopped_for = Waiting::None as u32;
        self.latches.line = 0;
    }

    fn forget_asked(&mut self) {
        self.asked = ProgramEvent::default();
        self.begun = 0;
        self.waiting = Waiting::None;
        self.waited_scans = 0;
        self.machine_codes.forget();
    }

    /// Whether something was latched since this was asked last.
    pub fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Whether it is the next event, and one that there is.
    pub fn is_next(&self, event: &ProgramEvent) -> bool {
        let known = EventCode::from_wire(event.code).is_some() && event.value.is_finite();
        known && event.number != 0 && event.number == self.latches.events_done.saturating_add(1)
    }

    /// The path begins behind so many events of the program; what planners said before this scan was of what stands before it.
    pub fn begin_behind(&mut self, events: u32, scan: u64) {
        self.latches.events_done = events;
        self.messages_after = scan;
        self.forget_asked();
        self.changed = true;
    }

    /// The event that was done.
    pub fn count(&mut self, event: &ProgramEvent) {
        self.latches.events_done = event.number;
        self.changed = true;
    }

    /// Something was latched that must outlive this master before anybody sees it.
    pub fn latched(&mut self) {
        self.changed = true;
    }

    /// Outputs whose element begins in this scan.
    fn set_outputs_ahead(&mut self, tag: &PathTag) {
        if tag.is_off_path() {
            return;
        }
        for index in 0..self.ahead.len() {
            let next = self.ahead.get(index).copied();
            let Some(event) = next.filter(|event| self.is_next(event)) else {
                continue;
            };
            let within = tag.distance_mm > 0.0 || tag.dwell_remaining_scans > 0;
            let begins = tag.element > event.element || tag.element == event.element && within;
            if !begins {
                return;
            }
            self.begin(&event);
            self.count(&event);
        }
    }

    /// Sets the levels of an event; the same as often as it is done.
    fn begin(&mut self, event: &ProgramEvent) {
        let (tool, changer) = (self.tool(), self.changer);
        let latches = &mut self.latches;
        let on = event.value != 0.0;
        match EventCode::from_wire(event.code) {
            Some(EventCode::SpindleSpeed) => {
                latches.speed_rpm = event.value.max(0.0);
                latches.surface = 0;
                if latches.levels.spindle == SpindleCommand::Turn as u32 {
                    latches.set_spindle();
                }
            }
            Some(EventCode::SurfaceCentre) => latches.surface_centre_mm = event.value,
            Some(EventCode::SurfaceLimit) => latches.surface_limit_rpm = event.value,
            Some(EventCode::SurfaceSpeed) => {
                latches.surface_m_min = event.value.max(0.0);
                latches.surface = event.index.saturating_add(1);
            }
            Some(EventCode::SpindleClockwise) => {
                latches.direction = 1;
                latches.set_spindle();
            }
            Some(EventCode::SpindleCounterClockwise) => {
                latches.direction = 2;
                latches.set_spindle();
            }
            Some(EventCode::SpindleStop) => latches.stop_spindle(),
            Some(EventCode::SpindleOrient) => {
                latches.stop_spindle();
                latches.levels.spindle = SpindleCommand::Orient as u32;
                latches.levels.orientation_deg = event.value;
            }
            // No gear yet: the spindle comes to rest.
            Some(EventCode::SpindleCouple) => {
                latches.coupled = event.index.saturating_add(1);
                latches.mm_per_turn = 0.0;
            }
            Some(EventCode::SpindleUncouple) => latches.coupled = 0,
            Some(EventCode::Mist) => latches.switch_coolant(MIST, on),
            Some(EventCode::Flood) => latches.switch_coolant(FLOOD, on),
            Some(EventCode::ToolPrepare) => latches.levels.tool_prepared = event.index,
            Some(EventCode::ToolChange) if tool != event.index => latches.stop_spindle(),
            Some(EventCode::DigitalOutput) => latches.switch_output(event.index, on),
            Some(EventCode::AnalogOutput) => {
                if let Some(output) = latches.levels.analog.get_mut(event.index as usize) {
                    *output = event.value;
                }
            }
            Some(EventCode::Overrides) => latches.override_disabled = u32::from(!on),
            // A changer knows itself which tool is in.
            Some(EventCode::ToolIs) if !changer => {
                latches.tool = event.index;
                latches.levels.tool = event.index;
            }
            Some(EventCode::ToolOffset) => {
                if let Some(along) = latches.tool_offset.get_mut(event.index as usize) {
                    *along = event.value;
                }
            }
            Some(EventCode::ToolOffsetOf) => latches.tool_offset_of = event.index,
            _ => {}
        }
    }

    /// What the event that was begun waits for.
    fn awaits(&mut self, event: &ProgramEvent) -> Waiting {
        match EventCode::from_wire(event.code) {
            Some(EventCode::AwaitSpindle) if self.turns() && !self.is_at_speed() => {
                Waiting::SpindleSpeed
            }
            Some(EventCode::SpindleOrient) if !self.shown.oriented => Waiting::SpindleOrientation,
            Some(EventCode::SpindleCouple) if !self.stands() => Waiting::SpindleStandstill,
            Some(EventCode::ToolChange) if self.tool() != event.index => {
                if !self.stands() {
                    return Waiting::SpindleStandstill;
                }
                self.latches.levels.tool = event.index;
                if self.changer {
                    Waiting::ToolChange
                } else {
                    Waiting::None
                }
            }
            Some(EventCode::UserCode) if self.machine_codes.awaits(event) => Waiting::MachineCode,
            _ => Waiting::None,
        }
    }

    /// The stop for the operator that an event is.
    fn stop_of(&self, event: &ProgramEvent) -> Waiting {
        match EventCode::from_wire(event.code) {
            Some(EventCode::ProgramStop) => Waiting::ProgramStop,
            Some(EventCode::PalletStop) => Waiting::PalletStop,
            Some(EventCode::OptionalStop) if self.latches.optional_stop == 1 => {
                Waiting::OptionalStop
            }
            Some(EventCode::ToolChange) if !self.changer && self.tool() != event.index => {
                Waiting::ToolByOperator
            }
            _ => Waiting::None,
        }
    }

    /// Waits one scan more; the cause of a trip once it has lasted too long. A changer rests while the machine is held, and is not late.
    fn wait(&mut self, for_what: Waiting, held: bool) -> Cause {
        self.waiting = for_what;
        if !(held && for_what == Waiting::ToolChange) {
            self.waited_scans = self.waited_scans.saturating_add(1);
        }
        let (patience, cause) = match for_what {
            Waiting::ToolChange => (self.change_patience_scans, Cause::ToolChange),
            Waiting::MachineCode => (self.machine_codes.patience_scans(), Cause::MachineCode),
            // The program itself says how long.
            Waiting::Input => (u64::MAX, Cause::None),
            _ => (self.spindle_patience_scans, Cause::Spindle),
        };
        if self.waited_scans > patience {
            cause
        } else {
            Cause::None
        }
    }

    /// Whether spindle and coolant act in this mode; a spindle that was stopped in the middle of a program comes back first. What was
    /// switched on by typed-in blocks goes on behind them, until the machine is stopped, trips or is switched off.
    fn release(&mut self, mode: Mode, hold: bool, program: &Loaded) {
        match mode {
            Mode::Enabled if !hold => {
                self.comes_back |= !self.released && self.turns();
                self.released = true;
            }
            Mode::Enabled | Mode::Stopping | Mode::Jogging | Mode::Ready => {}
            Mode::Finished if program.leaves_spindle() => {}
            Mode::Disabled | Mode::Stopped | Mode::Tripped | Mode::Finished => {
                self.released = false;
                self.comes_back = false;
                // Of a program that is running they come back with `resume`.
                if mode == Mode::Finished || !program.is_running() {
                    let start_line = self.latches.start_line;
                    self.latches.end_program();
                    // One that was not begun yet waits for its drives, with the line that it is to begin at.
                    if mode != Mode::Finished {
                        self.latches.start_line = start_line;
                    }
                }
            }
        }
        self.comes_back &= !self.is_at_speed();
    }
}

impl<D: Drives> Master<D> {
    /// What the planner asks for: judged against where the machine is now, done by [`step_auxiliary`](Master::step_auxiliary).
    pub(super) fn heed_events(&mut self, status: &PlannerStatus) {
        self.auxiliary.ahead = status.outputs_ahead;
        self.auxiliary.take_messages(status);
        self.heed_block(status);
        self.heed_start(status);
        let recent = status.scan.saturating_add(2 * self.timing.period_scans) >= self.scan;
        let is_of_run = self.auxiliary.is_of_run(status);
        if self.auxiliary.begun == 0 || status.event.number == 0 {
            let to_do = |event: &ProgramEvent| {
                recent && is_of_run && event.code != EventCode::StartAt as u32
            };
            let asked = Some(status.event).filter(to_do);
            self.auxiliary.asked = asked.unwrap_or_default();
        }
    }

    /// One scan of events: outputs in motion, then the event that the path rests for.
    pub(super) fn step_auxiliary(&mut self) {
        let tag = self.windows.tag_in(self.scan);
        let on_path = self.windows.is_on_path(self.scan);
        let spindle_fails = self.auxiliary.shown.spindle_code != 0
            && self.auxiliary.levels().spindle != SpindleCommand::Stop as u32;
        if spindle_fails {
            self.trip(Cause::Spindle, u32::MAX);
        }
        self.auxiliary
            .release(self.mode(), self.modes.is_held(), &self.program);
        let surface = self.auxiliary.surface_axis();
        if let Some(unit) = surface.and_then(|axis| self.axes.get(axis)) {
            let place_mm = unit.commanded_mm();
            self.auxiliary.turn_at_surface_speed(place_mm);
        }
        self.step_probe();
        if self.mode() != Mode::Enabled {
            self.auxiliary.forget_asked();
            return;
        }
        if let Some(tag) = tag {
            self.auxiliary.set_outputs_ahead(&tag);
        }
        if self.auxiliary.is_coming_back() {
            let cause = self.auxiliary.wait(Waiting::SpindleSpeed, false);
            self.end_wait(cause);
            return;
        }
        let may_set = on_path || self.seeks_line();
        let rests = may_set && self.windows.at_rest(self.scan) && self.axes.stand();
        let next = self.auxiliary.is_next(&self.auxiliary.asked);
        let held = self.modes.is_held() && self.auxiliary.begun == 0;
        if !rests || !next || held {
            self.auxiliary.forget_asked();
            return;
        }
        self.do_event();
    }

    /// The event that was asked for, one scan of it.
    fn do_event(&mut self) {
        let auxiliary = &mut self.auxiliary;
        let event = auxiliary.asked;
        if auxiliary.begun != event.number {
            auxiliary.begun = event.number;
            auxiliary.waited_scans = 0;
            auxiliary.begin(&event);
        }
        let waited_scans = auxiliary.waited_scans;
        let waiting = match self.ask(&event, waited_scans) {
            Some(true) => Waiting::None,
            Some(false) => Waiting::Input,
            None => self.auxiliary.awaits(&event),
        };
        if self.mode() != Mode::Enabled {
            // It has stopped the machine.
            self.auxiliary.forget_asked();
            return;
        }
        let auxiliary = &mut self.auxiliary;
        if waiting != Waiting::None {
            let cause = auxiliary.wait(waiting, self.modes.is_held());
            self.end_wait(cause);
            return;
        }
        if event.code == EventCode::Abort as u32 {
            self.stop_for(Cause::Abort);
            self.auxiliary.forget_asked();
            return;
        }
        let stop = auxiliary.stop_of(&event);
        self.couple(&event);
        let auxiliary = &mut self.auxiliary;
        auxiliary.count(&event);
        auxiliary.forget_asked();
        if stop != Waiting::None {
            auxiliary.latches.stopped_for = stop as u32;
            auxiliary.latches.line = event.line;
            self.modes.hold(HoldReason::Program);
        }
    }

    /// What has lasted too long stops the machine.
    fn end_wait(&mut self, cause: Cause) {
        if cause != Cause::None {
            self.trip(cause, u32::MAX);
            self.auxiliary.forget_asked();
        }
    }
}
