//! Named inputs and outputs: each scan the value of each from its source, and what the controller does with them (docs/howto/signals.md).

use bus::sample::{
    Cause, FLOOD, HoldReason, Levels, MAX_AXES, MIST, Mode, OperatorRequest, Order, Refused,
    Signals, SpindleCommand, has_bit, with_bit,
};
use bytemuck::Zeroable;
use machine::{Machine, MachineState, SetBy, Signal, SignalKind};

use super::alarms::Alarms;
use super::axis_unit::AxisUnit;
use super::handwheel::{PlannedWheel, Told};
use super::logic::LogicOfMachine;
use super::machine_codes::Call;
use super::orders::Refusal;
use super::travel::Pulse;
use super::{Master, STANDSTILL_MM_S};
use crate::drives::{AuxiliaryFeedback, Drives, InputFeedback};
use crate::saved::{HELD_SIGNALS_MAX, HeldSignal, SignalLatches};

/// Where a signal's value comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Device,
    Output(usize),
    AnalogOutput(usize),
    State(MachineState),
    Operator,
    Logic,
    Travel,
}

/// One signal, as it is worked out in each scan.
#[derive(Debug, Clone, Copy)]
struct Planned {
    kind: SignalKind,
    default: f64,
    /// Value while its source is lost.
    lost: f64,
    inverted: bool,
    /// It keeps what it showed last while its source is lost.
    keeps: bool,
    source: Source,
    /// Inputs of programs that it is.
    input: Option<u32>,
    analog_input: Option<u32>,
}

impl Planned {
    fn of(signal: &Signal) -> Planned {
        let from = &signal.from;
        let source = match (from.output, from.analog_output, from.state, from.by) {
            _ if from.travel.is_some() => Source::Travel,
            (Some(output), ..) => Source::Output(output as usize),
            (_, Some(output), ..) => Source::AnalogOutput(output as usize),
            (_, _, Some(state), _) => Source::State(state),
            (_, _, _, Some(SetBy::Operator)) => Source::Operator,
            (_, _, _, Some(SetBy::Logic)) => Source::Logic,
            _ => Source::Device,
        };
        let to = signal.to.as_ref();
        Planned {
            kind: signal.kind,
            default: signal.default,
            lost: signal.lost_value(),
            inverted: signal.inverted,
            keeps: signal.keeps,
            source,
            input: to.and_then(|to| to.input),
            analog_input: to.and_then(|to| to.analog_input),
        }
    }

    /// What it shows of what its source says; none where its source is lost.
    fn shown(&self, said: Option<f64>) -> Option<f64> {
        let value = self.kind.nearest(said?)?;
        Some(if self.inverted { 1.0 - value } else { value })
    }
}

/// The functions of the controller, by the index of their signal.
#[derive(Debug, Clone, Default)]
struct Functions {
    emergency_stop: Option<usize>,
    drives_may: Option<usize>,
    door: Option<usize>,
    ready: Vec<usize>,
    cycle_start: Option<usize>,
    feed_hold: Option<usize>,
    feed_override: Option<usize>,
    rapid_override: Option<usize>,
    probe: Option<usize>,
    spindle_at_speed: Option<usize>,
    spindle_speed: Option<usize>,
    spindle_oriented: Option<usize>,
    tool_in_spindle: Option<usize>,
    code_done: Option<usize>,
    handwheel: Option<PlannedWheel>,
    /// Of each axis, the switch at its low end and at its high end.
    limits: Vec<[Option<usize>; 2]>,
}

impl Functions {
    fn of(machine: &Machine) -> Functions {
        let named = &machine.functions;
        let index = |name: &Option<String>| machine.signal(name.as_deref()?);
        let limits = machine.axes.iter().map(|axis| {
            let switches = axis.limit_switches.as_ref();
            [
                switches.and_then(|switches| index(&switches.negative)),
                switches.and_then(|switches| index(&switches.positive)),
            ]
        });
        Functions {
            emergency_stop: index(&named.emergency_stop),
            drives_may: index(&named.drives_may),
            door: index(&named.door),
            ready: named
                .ready
                .iter()
                .filter_map(|name| machine.signal(name))
                .collect(),
            cycle_start: index(&named.cycle_start),
            feed_hold: index(&named.feed_hold),
            feed_override: index(&named.feed_override),
            rapid_override: index(&named.rapid_override),
            probe: index(&named.probe),
            spindle_at_speed: index(&named.spindle_at_speed),
            spindle_speed: index(&named.spindle_speed),
            spindle_oriented: index(&named.spindle_oriented),
            tool_in_spindle: index(&named.tool_in_spindle),
            code_done: named
                .m_codes
                .as_ref()
                .and_then(|codes| machine.signal(&codes.done)),
            handwheel: named
                .handwheel
                .as_ref()
                .and_then(|wheel| PlannedWheel::of(machine, wheel)),
            limits: limits.collect(),
        }
    }
}

/// All of them.
#[derive(Debug, Clone)]
pub(super) struct NamedSignals {
    planned: Vec<Planned>,
    functions: Functions,
    latches: SignalLatches,
    shown: Box<Signals>,
    pub alarms: Alarms,
    /// The machine's own logic, where it has one.
    pub logic: Option<LogicOfMachine>,
    /// Buttons in the scan before: cycle start, feed hold.
    pressed: [bool; 2],
    /// Overrides in the scan before, of feed and rapids.
    turned: [Option<f64>; 2],
    /// Limit switches that axes were on in the scan before, a bit each: the low ends, the high ends.
    on_limit: [u64; 2],
    /// Where axes were commanded to be in the scan before.
    commanded: [i64; MAX_AXES],
    /// Pulses by travel.
    pulses: Vec<Pulse>,
    wheel_told: Told,
}

impl NamedSignals {
    pub fn new(machine: &Machine) -> NamedSignals {
        let mut shown = Box::new(Signals::zeroed());
        let pulses = machine.signals.iter().enumerate();
        let pulses: Vec<Pulse> = pulses
            .filter_map(|(index, signal)| Pulse::of(machine, index, signal))
            .collect();
        let mut planned: Vec<Planned> = machine.signals.iter().map(Planned::of).collect();
        // The tool that is in the spindle when the cell begins is that of the cell before.
        let tool = machine.functions.tool_in_spindle.as_deref();
        let tool = tool.and_then(|name| planned.get_mut(machine.signal(name)?));
        if let Some(tool) = tool.filter(|tool| tool.keeps) {
            tool.default = f64::from(machine.beginning.tool);
            tool.lost = tool.default;
        }
        let alarms = Alarms::new(machine);
        shown.count = planned.len() as u32;
        shown.alarm_count = alarms.count() as u32;
        for (value, planned) in shown.values.iter_mut().zip(&planned) {
            *value = planned.default;
        }
        NamedSignals {
            functions: Functions::of(machine),
            planned,
            latches: SignalLatches::default(),
            shown,
            alarms,
            logic: LogicOfMachine::new(machine),
            // What is pressed from the beginning is no press.
            pressed: [true; 2],
            turned: [None; 2],
            on_limit: [0; 2],
            commanded: [0; MAX_AXES],
            pulses,
            wheel_told: Told::default(),
        }
    }

    /// Goes on where a master before this one left.
    pub fn resume(&mut self, latches: &SignalLatches) {
        let sound = |held: &HeldSignal| held.of == 0 || held.value.is_finite();
        if latches.held.iter().all(sound) {
            self.latches = *latches;
        }
        for index in 0..self.planned.len() {
            let forced = self.latches.held(index, FORCED);
            self.shown.forced.set(index, forced.is_some());
        }
        for pulse in &mut self.pulses {
            if let Some(kept_mm) = self.latches.held(pulse.signal, TRAVEL) {
                pulse.resume(kept_mm);
            }
        }
    }

    /// Counts the travel of each axis; `place_mm` is the place of a driven axis, and none of another.
    fn travel(&mut self, place_mm: impl Fn(usize) -> Option<f64>) {
        for pulse in &mut self.pulses {
            pulse.step(&place_mm);
            // Where there is no room it is not kept, and the next master begins with a pulse.
            let _ = self.latches.hold(pulse.signal, pulse.kept_mm(), TRAVEL);
        }
    }

    /// Order for the clicks of the handwheel since the scan before. Clicks while the drives are off move nothing, then or later.
    fn take_clicks(&mut self, driven: bool) -> Option<OperatorRequest> {
        let wheel = self.functions.handwheel.as_ref()?;
        let shown = &self.shown;
        let turned = wheel.turned(|index| {
            let value = shown.values.get(index).copied();
            value.filter(|_| !shown.lost.has(index))
        });
        match turned.filter(|_| driven) {
            Some(turned) => wheel.order(turned, &mut self.wheel_told),
            None => {
                self.wheel_told.last = None;
                None
            }
        }
    }

    /// What must outlive this master.
    pub fn latches(&self) -> SignalLatches {
        self.latches
    }

    fn show(&mut self, index: usize, said: Option<f64>) {
        let Some(planned) = self.planned.get(index).copied() else {
            return;
        };
        let value = planned.shown(said);
        self.shown.lost.set(index, value.is_none());
        let value = match planned.keeps {
            true => self.latches.keep(index, value),
            false => value,
        };
        let forced = match self.shown.forced.has(index) {
            true => self.latches.held(index, FORCED),
            false => None,
        };
        if let Some(slot) = self.shown.values.get_mut(index) {
            *slot = forced.or(value).unwrap_or(planned.lost);
        }
    }

    /// What the controller commands and is, in the scan that begins.
    pub fn command(&mut self, levels: &Levels, now: &Now) {
        for index in 0..self.planned.len() {
            let Some(planned) = self.planned.get(index) else {
                continue;
            };
            let said = match planned.source {
                Source::Device => continue,
                Source::Output(output) => {
                    Some(f64::from(u8::from(has_bit(levels.digital, output))))
                }
                Source::AnalogOutput(output) => levels.analog.get(output).copied(),
                Source::State(state) => Some(value_of(state, levels, now)),
                Source::Travel => {
                    let pulse = self.pulses.iter().find(|pulse| pulse.signal == index);
                    pulse.map(|pulse| f64::from(u8::from(pulse.is_on())))
                }
                Source::Logic => {
                    // One that is started again has not said yet what a signal that keeps its value shows.
                    let kept = self.latches.held(index, SET).filter(|_| planned.keeps);
                    let logic = self.logic.as_ref();
                    logic.and_then(|logic| logic.value(index, kept.unwrap_or(planned.default)))
                }
                Source::Operator => {
                    let set = self.latches.held(index, SET);
                    Some(set.unwrap_or(planned.default))
                }
            };
            self.show(index, said);
        }
    }

    /// What devices show at the end of the scan.
    pub fn take(&mut self, drives: &impl Drives, scan: u64) {
        if self.shown().is_none() {
            return;
        }
        for index in 0..self.planned.len() {
            if self.planned.get(index).map(|planned| planned.source) == Some(Source::Device) {
                self.show(index, drives.signal(index));
            }
        }
        let raised = self.logic.as_ref().map_or(0, LogicOfMachine::alarms);
        let came = self.alarms.step(self.shown.values(), raised);
        self.latches.unacknowledged |= came;
        let count = self.alarms.count();
        let since = self.shown.alarm_scans.iter_mut().take(count);
        for (index, since) in since.enumerate() {
            if has_bit(came, index) {
                *since = scan;
            }
        }
        self.shown.alarms = self.alarms.there();
        self.shown.unacknowledged = self.latches.unacknowledged;
        self.shown.scan = scan;
        self.shown.visible_from = scan + 1;
    }

    /// What observers see; none without signals.
    pub fn shown(&self) -> Option<&Signals> {
        let any = !self.planned.is_empty() || self.alarms.count() != 0;
        any.then_some(&*self.shown)
    }

    /// These are acknowledged, a bit each.
    pub fn acknowledge(&mut self, alarms: u64) {
        self.latches.unacknowledged &= !alarms;
    }

    /// The value of each.
    pub fn values(&self) -> &[f64] {
        self.shown.values()
    }

    fn value(&self, index: Option<usize>) -> Option<f64> {
        self.shown.values.get(index?).copied()
    }

    /// Whether a switch that is to be on is not.
    fn is_off(&self, index: Option<usize>) -> bool {
        self.value(index) == Some(0.0)
    }

    /// Inputs of programs, and the probe, that are signals.
    pub fn give_inputs(&self, shown: &mut InputFeedback) {
        for (planned, value) in self.planned.iter().zip(self.values()) {
            if let Some(input) = planned.input {
                shown.digital = with_bit(shown.digital, input as usize, *value != 0.0);
            }
            let analog = planned.analog_input;
            if let Some(slot) = analog.and_then(|input| shown.analog.get_mut(input as usize)) {
                *slot = *value;
            }
        }
        if let Some(contact) = self.value(self.functions.probe) {
            shown.contact = contact != 0.0;
            let lost = |index| self.shown.lost.has(index);
            shown.contact_lost = self.functions.probe.is_some_and(lost);
        }
    }

    /// What signals say of spindle and tool changer.
    pub fn give_auxiliary(&self, levels: &Levels, shown: &mut AuxiliaryFeedback) {
        let commanded_rpm = match SpindleCommand::from_wire(levels.spindle) {
            SpindleCommand::Turn => levels.spindle_rpm,
            _ => 0.0,
        };
        if let Some(speed_rpm) = self.value(self.functions.spindle_speed) {
            shown.spindle_rpm = libm::copysign(speed_rpm, commanded_rpm);
        } else if let Some(at_speed) = self.value(self.functions.spindle_at_speed) {
            shown.spindle_rpm = if at_speed != 0.0 { commanded_rpm } else { 0.0 };
        }
        if let Some(oriented) = self.value(self.functions.spindle_oriented) {
            shown.oriented = oriented != 0.0;
        }
        if let Some(tool) = self.value(self.functions.tool_in_spindle)
            && (0.0..=f64::from(u32::MAX)).contains(&tool)
        {
            shown.tool = tool as u32;
        }
    }

    /// Whether the machine says that the M-code it was to do is done.
    pub fn code_is_done(&self) -> bool {
        self.value(self.functions.code_done) == Some(1.0)
    }

    /// Which of two buttons, cycle start and feed hold, has been pressed since the scan before.
    fn take_pressed(&mut self) -> [bool; 2] {
        let buttons = [self.functions.cycle_start, self.functions.feed_hold];
        let now = buttons.map(|button| self.value(button) == Some(1.0));
        let [was_start, was_hold] = std::mem::replace(&mut self.pressed, now);
        let [start, hold] = now;
        [start && !was_start, hold && !was_hold]
    }

    /// Overrides of feed and rapids that have been turned since the scan before.
    fn take_turned(&mut self) -> [Option<f64>; 2] {
        let knobs = [self.functions.feed_override, self.functions.rapid_override];
        let now = knobs.map(|knob| self.value(knob).map(libm::round));
        let before = std::mem::replace(&mut self.turned, now);
        let [feed, rapid] = now;
        let [feed_before, rapid_before] = before;
        [
            feed.filter(|value| feed_before != Some(*value)),
            rapid.filter(|value| rapid_before != Some(*value)),
        ]
    }

    /// Notes whether the axis is on the switch at its end in this direction; whether it came onto it since the scan before.
    fn note_limit(&mut self, axis: usize, direction: i64, is_on: bool) -> bool {
        let [negative, positive] = &mut self.on_limit;
        let ends = if direction > 0 { positive } else { negative };
        let came = is_on && !has_bit(*ends, axis);
        *ends = with_bit(*ends, axis, is_on);
        came
    }

    /// Notes where the axis is commanded to be; which way that is from where it was in the scan before.
    fn note_command(&mut self, axis: usize, position: i64) -> i64 {
        let before = self.commanded.get_mut(axis);
        before.map_or(0, |before| {
            let from = std::mem::replace(before, position);
            position.saturating_sub(from).signum()
        })
    }

    /// Whether the axis is on the switch at its end in this direction.
    fn is_on_limit(&self, axis: usize, direction: i64) -> bool {
        let switches = self.functions.limits.get(axis).copied().unwrap_or_default();
        let [negative, positive] = switches;
        match direction.signum() {
            1 => self.is_off(positive),
            -1 => self.is_off(negative),
            _ => false,
        }
    }

    /// Why drives must be off.
    fn keeps_drives_off(&self) -> Option<(Cause, Refused)> {
        if self.is_off(self.functions.emergency_stop) {
            return Some((Cause::EmergencyStopChain, Refused::EmergencyStopOpen));
        }
        let off = self.is_off(self.functions.drives_may);
        off.then_some((Cause::DrivesNotAllowed, Refused::DrivesNotAllowed))
    }

    fn door_is_open(&self) -> bool {
        self.is_off(self.functions.door)
    }

    /// Index of the first signal of [`machine::Functions::ready`] that is off.
    fn not_ready(&self) -> Option<usize> {
        let mut ready = self.functions.ready.iter().copied();
        ready.find(|index| self.is_off(Some(*index)))
    }

    /// Holds a signal at a value: one that the operator sets, or any.
    pub fn hold(&mut self, request: &OperatorRequest, forced: bool) -> Result<(), Refusal> {
        let planned = self.planned.get(request.axis as usize);
        let planned = planned.ok_or(Refused::UnknownSignal)?;
        if !forced && planned.source != Source::Operator {
            return Err(Refused::NotOperators.into());
        }
        if !planned.kind.can_show(request.value) {
            return Err(Refused::BadValue.into());
        }
        let index = request.axis as usize;
        let how = if forced { FORCED } else { SET };
        let room = self.latches.hold(index, request.value, how);
        room.ok_or(Refused::SignalsHeld)?;
        if forced {
            self.shown.forced.set(index, true);
        }
        Ok(())
    }

    /// A forced signal follows its source again.
    pub fn let_go(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let index = request.axis as usize;
        if index >= self.planned.len() {
            return Err(Refused::UnknownSignal.into());
        }
        if let Some(forced) = self.latches.find(index, FORCED) {
            *forced = HeldSignal::default();
        }
        self.shown.forced.set(index, false);
        Ok(())
    }
}

/// How a signal is held: set, by the operator or as what it is to keep, or forced over its source; or what its axis has travelled. One may be
/// several.
const SET: u32 = 0;
const FORCED: u32 = 1;
const TRAVEL: u32 = 2;

impl SignalLatches {
    fn find(&mut self, index: usize, how: u32) -> Option<&mut HeldSignal> {
        let is_it = |held: &&mut HeldSignal| held.is_of(index, how);
        self.held.iter_mut().find(is_it)
    }

    /// What a signal is held at.
    fn held(&self, index: usize, how: u32) -> Option<f64> {
        let held = self.held.iter().find(|held| held.is_of(index, how));
        held.map(|held| held.value)
    }

    /// Holds a signal at a value; none where as many are held as may be.
    fn hold(&mut self, index: usize, value: f64, how: u32) -> Option<()> {
        let place = self.held.iter().position(|held| held.is_of(index, how));
        let place = place.or_else(|| self.held.iter().position(|held| held.of == 0))?;
        *self.held.get_mut(place)? = HeldSignal {
            value,
            of: index as u32 + 1,
            how,
        };
        Some(())
    }

    /// What a signal shows that keeps its value: what its source says, or has said last.
    fn keep(&mut self, index: usize, said: Option<f64>) -> Option<f64> {
        let kept = self.held(index, SET);
        if let Some(value) = said.filter(|value| kept != Some(*value)) {
            // Where so many are held that there is no room, it is not kept: nothing else depends on it.
            let _ = self.hold(index, value, SET);
        }
        said.or(kept)
    }
}

impl HeldSignal {
    fn is_of(&self, index: usize, how: u32) -> bool {
        self.of == index as u32 + 1 && self.how == how
    }
}

/// What the controller is, beside its levels.
pub(super) struct Now {
    pub mode: Mode,
    pub held: bool,
    /// A changer is to bring a tool.
    pub changes_tool: bool,
    pub run: u32,
    /// The M-code that the machine is to do.
    pub code: Option<Call>,
}

/// What the controller commands or is, as a number.
fn value_of(state: MachineState, levels: &Levels, now: &Now) -> f64 {
    let Now {
        mode,
        held,
        changes_tool,
        run,
        code,
    } = *now;
    let runs = mode == Mode::Enabled && !held;
    let spindle = SpindleCommand::from_wire(levels.spindle);
    let turns = matches!(spindle, SpindleCommand::Turn | SpindleCommand::Follow);
    let is = match state {
        MachineState::SpindleClockwise => turns && levels.spindle_rpm > 0.0,
        MachineState::SpindleCounterClockwise => turns && levels.spindle_rpm < 0.0,
        MachineState::SpindleSpeed => {
            return if turns { levels.spindle_rpm.abs() } else { 0.0 };
        }
        MachineState::SpindleOrient => spindle == SpindleCommand::Orient,
        MachineState::SpindleAngle => return levels.orientation_deg,
        MachineState::Mist => levels.coolant & MIST != 0,
        MachineState::Flood => levels.coolant & FLOOD != 0,
        MachineState::ToolWanted => return f64::from(levels.tool),
        MachineState::ToolChange => runs && changes_tool,
        MachineState::ToolPrepared => return f64::from(levels.tool_prepared),
        MachineState::DrivesOn => mode != Mode::Disabled,
        MachineState::ProgramRuns => runs,
        MachineState::Tripped => mode == Mode::Tripped,
        MachineState::MCode => return code.map_or(0.0, |call| f64::from(call.code)),
        MachineState::MCodeP => return code.map_or(0.0, |call| call.p),
        MachineState::MCodeCall => return code.map_or(0.0, |call| call.number(run)),
    };
    f64::from(u8::from(is))
}

impl<D: Drives> Master<D> {
    /// Named inputs and outputs at the end of the last exchange; none where the machine has none.
    pub fn signals(&self) -> Option<&Signals> {
        self.signals.shown()
    }

    /// What goes to devices in this scan.
    pub(super) fn command_signals(&mut self, levels: &Levels) {
        if self.signals.shown().is_none() {
            return;
        }
        let now = Now {
            mode: self.mode(),
            held: self.modes.is_held(),
            changes_tool: self.auxiliary.is_changing_tool(),
            run: self.program.run(),
            code: self.auxiliary.machine_codes.shown(),
        };
        let driven = self.mode().is_driven();
        let axes = &self.axes;
        let place_mm = |axis: usize| {
            axes.get(axis)
                .filter(|_| driven)
                .map(AxisUnit::commanded_mm)
        };
        self.signals.travel(place_mm);
        self.signals.command(levels, &now);
        self.drives.command_signals(self.signals.values());
    }

    /// What inputs say stops the machine, before anything else is decided in this scan.
    pub(super) fn heed_signals(&mut self) {
        if self.signals.shown().is_some() {
            self.heed_named();
        }
    }

    /// What a machine with named signals heeds; a machine without them does not carry its code in the scan.
    #[inline(never)]
    fn heed_named(&mut self) {
        let driven = self.mode().is_driven();
        if let Some((cause, _)) = self.signals.keeps_drives_off() {
            self.switching_on.cancel();
            if driven {
                self.trip(cause, u32::MAX);
            }
        }
        self.heed_alarms();
        self.heed_limit_switches();
        let door = self.signals.door_is_open();
        if door {
            self.auxiliary.rest_for_door();
            if self.mode() == Mode::Jogging {
                self.rest_all_by_hand();
            }
        }
        let not_ready = self.signals.not_ready().is_some();
        if (door || not_ready) && self.program.is_running() {
            self.modes.hold(match door {
                true => HoldReason::Door,
                false => HoldReason::Signal,
            });
        }
        let [feed, rapid] = self.signals.take_turned();
        if let Some(percent) = feed {
            self.modes.turn_override(percent);
        }
        if let Some(percent) = rapid {
            // Within the range nothing refuses it.
            let _ = self.auxiliary.override_rapids(percent.clamp(0.0, 100.0));
        }
        if let Some(request) = self.signals.take_clicks(driven) {
            // What may not be jogged now is not.
            self.order(&request);
        }
        let [start, hold] = self.signals.take_pressed();
        let order = match (hold, start, self.program.is_running()) {
            (true, ..) => Order::Hold,
            (false, true, true) => Order::Resume,
            (false, true, false) => Order::Start,
            (false, false, _) => return,
        };
        self.order(&OperatorRequest::of(order));
    }

    /// An axis that comes onto the switch at its end, or goes further onto it, stops the machine.
    fn heed_limit_switches(&mut self) {
        let driven = self.mode().is_driven();
        let mut hit = None;
        for (index, axis) in self.axes.iter().enumerate() {
            let velocity_mm_s = axis.velocity_mm_s();
            let commanded = self.signals.note_command(index, axis.command_position());
            for direction in [-1, 1] {
                let is_on = self.signals.is_on_limit(index, direction);
                let along_mm_s = velocity_mm_s * direction as f64;
                let came = self.signals.note_limit(index, direction, is_on);
                // What a loop swings while it takes the axis over is no motion that anybody wants.
                let goes_on = along_mm_s > STANDSTILL_MM_S && commanded == direction;
                // A switch that bounces while the axis comes off it is no reason to stop.
                let comes_on = came && along_mm_s > -STANDSTILL_MM_S;
                if is_on && (goes_on || comes_on) {
                    hit.get_or_insert(index);
                }
            }
        }
        if let Some(axis) = hit.filter(|_| driven) {
            self.trip(Cause::LimitSwitch, axis as u32);
        }
    }

    /// Why no program may move the machine, or the hand, as signals say.
    pub(super) fn signals_allow(&self, program: bool) -> Result<(), Refusal> {
        if self.signals.door_is_open() {
            return Err(Refused::DoorOpen.into());
        }
        if let Some(logic) = &self.signals.logic {
            logic.allows(program)?;
        }
        if !program {
            return Ok(());
        }
        self.signals.alarms.allow_program()?;
        if let Some(index) = self.signals.not_ready() {
            return Err(Refusal {
                axis: index as u32,
                ..Refused::SignalOff.into()
            });
        }
        let on_limit = |index: usize| {
            self.signals.is_on_limit(index, 1) || self.signals.is_on_limit(index, -1)
        };
        if (0..self.axes.len()).any(on_limit) {
            return Err(Refused::OnLimitSwitch.into());
        }
        Ok(())
    }

    /// Whether an axis may be moved by hand in this direction.
    pub(super) fn limits_allow(&self, axis: usize, way: i64) -> Result<(), Refusal> {
        if self.signals.is_on_limit(axis, way) {
            return Err(Refused::OnLimitSwitch.into());
        }
        Ok(())
    }

    /// Why drives may not be switched on.
    pub(super) fn drives_may(&self) -> Result<(), Refusal> {
        if let Some((_, refused)) = self.signals.keeps_drives_off() {
            return Err(refused.into());
        }
        self.signals.alarms.allow_drives()?;
        match &self.signals.logic {
            Some(logic) => Ok(logic.lets_drives_on()?),
            None => Ok(()),
        }
    }
}

const _: () = assert!(HELD_SIGNALS_MAX <= bus::sample::SIGNALS_MAX);

#[cfg(test)]
mod tests {
    use super::*;

    const SIGNALS: &str = r#"
[[signal]]
name = "pocket"
kind = "int"
keeps = true
from = { analog_output = 0 }
[[signal]]
name = "switch"
from = { by = "operator" }
"#;

    fn signals() -> NamedSignals {
        let name = "name = \"xy\"\n";
        let text = include_str!("../../../machines/xy/machine.toml");
        let text = text.replacen(name, &format!("{name}{SIGNALS}"), 1);
        NamedSignals::new(&Machine::parse("machine.toml", &text).expect("a machine"))
    }

    fn request(index: u32, value: f64) -> OperatorRequest {
        OperatorRequest {
            axis: index,
            value,
            ..OperatorRequest::default()
        }
    }

    /// Commands once, with this analogue output.
    fn commanded(signals: &mut NamedSignals, output: f64) -> Vec<f64> {
        let mut levels = Levels::default();
        levels.analog[0] = output;
        let now = Now {
            mode: Mode::Ready,
            held: false,
            changes_tool: false,
            run: 0,
            code: None,
        };
        signals.command(&levels, &now);
        signals.values().to_vec()
    }

    #[test]
    fn what_is_forced_stays_so_and_what_was_set_or_kept_is_there_again_behind_it() {
        let mut signals = signals();
        assert!(signals.hold(&request(1, 1.0), false).is_ok());
        assert_eq!(commanded(&mut signals, 3.0), [3.0, 1.0]);
        assert!(signals.hold(&request(0, 7.0), true).is_ok());
        assert!(signals.hold(&request(1, 0.0), true).is_ok());
        for output in [4.0, 5.0, f64::NAN] {
            assert_eq!(commanded(&mut signals, output), [7.0, 0.0], "{output}");
        }
        // Another master goes on so.
        let latches = signals.latches();
        signals = self::signals();
        signals.resume(&latches);
        assert_eq!(commanded(&mut signals, f64::NAN), [7.0, 0.0]);
        assert!(signals.let_go(&request(0, 0.0)).is_ok());
        assert!(signals.let_go(&request(1, 0.0)).is_ok());
        // Its source is lost: it shows what that has said last.
        assert_eq!(commanded(&mut signals, f64::NAN), [5.0, 1.0]);
        assert!(
            signals
                .shown()
                .is_some_and(|shown| shown.lost.has(0) && shown.forced.is_empty())
        );
    }
}
