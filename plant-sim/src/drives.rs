//! The simulated drives of a machine, behind the seam that real ones have.

use bus::sample::{Levels, MAX_AXES, MAX_SUBSAMPLES};
use bytemuck::{Pod, Zeroable};
use master::{
    AuxiliaryFeedback, DriveCommand, DriveFeedback, DriveState, Drives, InputFeedback,
    InstrumentSample, StateRefused,
};

use crate::auxiliary::{AuxiliaryState, SimulatedAuxiliaries};
use crate::axis::{AxisSimulation, AxisState, Joined};
use crate::bridge::Bridge;
use crate::contacts::SimulatedContacts;
use crate::cross_talk::{CrossTalk, FRICTION_SHARE_MIN};
use crate::homing::{HomingState, SimulatedHoming};
use crate::inputs::{InputsState, SimulatedInputs};
use crate::pitch_error::PitchError;
use crate::probe::{ProbeState, SimulatedProbe};
use crate::state_bytes::{put, put_bytes, taken};

/// Drives, motors and mechanics of all axes.
#[derive(Debug, Clone)]
pub struct SimulatedDrives {
    axes: Vec<SimulatedAxis>,
    /// Tables that are joined.
    pub(crate) bridges: Vec<BridgedAxes>,
    /// What axes get of where others are.
    pub(crate) cross_talk: Vec<CrossTalk>,
    /// Spindle and tool changer.
    pub auxiliaries: SimulatedAuxiliaries,
    probe: Option<SimulatedProbe>,
    inputs: SimulatedInputs,
    /// Devices at named inputs.
    pub(crate) contacts: SimulatedContacts,
}

/// A bridge, and the axes whose tables it joins.
#[derive(Debug, Clone, Copy)]
pub struct BridgedAxes {
    /// Index of the first motor's axis.
    pub first: usize,
    /// Index of the second motor's axis.
    pub second: usize,
    /// What joins them.
    pub bridge: Bridge,
}

#[derive(Debug, Clone)]
struct SimulatedAxis {
    simulation: AxisSimulation,
    /// The command that acts in this scan.
    acts: DriveCommand,
    samples: [InstrumentSample; MAX_SUBSAMPLES],
    /// It has braked by itself for want of commands, and is off until it is switched on.
    off: bool,
    /// Commands on their way to the drive, the next one first: as many as the dead time is longer than one scan.
    on_the_way: Vec<DriveCommand>,
    homing: SimulatedHoming,
    /// Error of its screw.
    pitch: Option<PitchError>,
}

/// A command on its way, as it is saved.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SavedCommand {
    kind: u64,
    values: [f64; 3],
}

impl SimulatedAxis {
    /// The command that acts now, where this one is handed over.
    fn acting(&mut self, command: DriveCommand) -> DriveCommand {
        let Some(next) = self.on_the_way.first().copied() else {
            return command;
        };
        self.on_the_way.rotate_left(1);
        if let Some(last) = self.on_the_way.last_mut() {
            *last = command;
        }
        next
    }

    /// Where the table is that the screw's turns have here, in mm.
    fn true_mm(&self, table_mm: f64) -> f64 {
        match &self.pitch {
            Some(pitch) => table_mm + pitch.error_mm(table_mm),
            None => table_mm,
        }
    }

    fn state_bytes(&self) -> usize {
        size_of::<AxisState>()
            + size_of::<HomingState>()
            + self.on_the_way.len() * size_of::<SavedCommand>()
    }

    fn save(&self, bytes: &mut &mut [u8]) {
        put(bytes, self.simulation.state());
        put(bytes, &self.homing.state);
        for command in &self.on_the_way {
            let (kind, values) = command.parts();
            put(bytes, &SavedCommand { kind, values });
        }
    }
    /// Takes a saved state, with the commands that were on their way.
    fn restore(&mut self, bytes: &mut &[u8]) -> Result<(), StateRefused> {
        self.simulation.restore(&taken(bytes)?)?;
        self.homing.restore(&taken(bytes)?);
        for on_the_way in &mut self.on_the_way {
            let saved: SavedCommand = taken(bytes)?;
            *on_the_way = DriveCommand::of_parts(saved.kind, saved.values).ok_or(StateRefused)?;
        }
        Ok(())
    }

    /// A deceleration in mm/s² that brings it to rest in this time; 0 where nobody says so, for the drive's own quick stop.
    fn evenly_mm_s2(&self, braking_s: Option<f64>) -> f64 {
        let speed_mm_s = self.simulation.velocity_mm_s().abs();
        let together_mm_s2 = braking_s.map_or(0.0, |braking_s| speed_mm_s / braking_s);
        let finite = together_mm_s2.is_finite();
        if finite { together_mm_s2 } else { 0.0 }
    }

    /// Nothing more comes to it.
    fn has_run_down(&mut self) {
        self.on_the_way.fill(DriveCommand::Disabled);
        let table_mm = self.simulation.instruments().table_mm;
        self.homing.moved(&self.simulation, table_mm);
    }
}

/// An axis that moves alone, or two that a bridge joins.
enum Moved<'a> {
    Alone(&'a mut SimulatedAxis),
    Joined([&'a mut SimulatedAxis; 2], &'a Bridge),
}

/// Does it with everything that moves, with the index of its first axis.
fn each_moved(
    axes: &mut [SimulatedAxis],
    bridges: &[BridgedAxes],
    mut act: impl FnMut(usize, Moved<'_>),
) {
    for index in 0..axes.len() {
        if bridges.iter().any(|of| of.second == index) {
            continue;
        }
        let joined = bridges.iter().find(|of| of.first == index);
        if let Some(of) = joined {
            if let Ok(ends) = axes.get_disjoint_mut([of.first, of.second]) {
                act(index, Moved::Joined(ends, &of.bridge));
            }
        } else if let Some(axis) = axes.get_mut(index) {
            act(index, Moved::Alone(axis));
        }
    }
}

/// One scan of all axes, with the commands that act in it.
fn advance(axes: &mut [SimulatedAxis], bridges: &[BridgedAxes]) {
    each_moved(axes, bridges, |_, moved| match moved {
        Moved::Alone(axis) => axis.simulation.scan(&axis.acts, &mut axis.samples),
        Moved::Joined([first, second], bridge) => Joined {
            ends: [&mut first.simulation, &mut second.simulation],
            bridge,
        }
        .scan(
            [&first.acts, &second.acts],
            [&mut first.samples, &mut second.samples],
        ),
    });
}

/// All axes that are not off brake by themselves. No command names a deceleration any more: the drive's own quick stop counts, or the
/// time in which a spindle stops that an axis is in step with.
fn run_down(axes: &mut [SimulatedAxis], bridges: &[BridgedAxes], together: Option<(usize, f64)>) {
    each_moved(axes, bridges, |index, moved| {
        let braking_s = of_axis(together, index);
        match moved {
            Moved::Alone(axis) if axis.off => {}
            Moved::Alone(axis) => {
                let evenly_mm_s2 = axis.evenly_mm_s2(braking_s);
                axis.simulation.run_down(evenly_mm_s2);
                axis.has_run_down();
            }
            Moved::Joined([first, second], _) if first.off && second.off => {}
            Moved::Joined([first, second], bridge) => {
                let evenly_mm_s2 = first.evenly_mm_s2(braking_s);
                let ends = [&mut first.simulation, &mut second.simulation];
                Joined { ends, bridge }.run_down(evenly_mm_s2);
                first.has_run_down();
                second.has_run_down();
            }
        }
    });
}

impl SimulatedDrives {
    /// These axes, whose commands act so many scans after the feedback that they answer, at least one.
    pub fn with_dead_time(simulations: Vec<AxisSimulation>, scans: u32) -> SimulatedDrives {
        let axis = |simulation| SimulatedAxis {
            simulation,
            acts: DriveCommand::Disabled,
            samples: [InstrumentSample::default(); MAX_SUBSAMPLES],
            off: false,
            on_the_way: vec![DriveCommand::Disabled; scans.saturating_sub(1) as usize],
            homing: SimulatedHoming::default(),
            pitch: None,
        };
        SimulatedDrives {
            axes: simulations.into_iter().map(axis).collect(),
            bridges: Vec::new(),
            cross_talk: Vec::new(),
            auxiliaries: SimulatedAuxiliaries::new(None, None, 1e-3),
            probe: None,
            inputs: SimulatedInputs::default(),
            contacts: SimulatedContacts::default(),
        }
    }

    /// The same with a touch probe, if there is one, and inputs.
    pub fn with_inputs(mut self, probe: Option<SimulatedProbe>, inputs: SimulatedInputs) -> Self {
        (self.probe, self.inputs) = (probe, inputs);
        let (axes, talks) = (&self.axes, &self.cross_talk);
        if let Some(probe) = &mut self.probe {
            probe.stand(|axis| table_mm(axes, talks, axis));
        }
        self
    }

    /// Gives axes the errors of their screws.
    pub(crate) fn bend_screws(&mut self, of_axis: impl Fn(usize) -> Option<PitchError>) {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            axis.pitch = of_axis(index);
        }
    }

    /// The drive of an axis has lost its power: it has none before it is switched on again.
    pub fn lose_power(&mut self, axis: usize) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.simulation.power(false);
        }
    }

    /// The same with what its axes have to find their places; absolute encoders where it says nothing.
    pub fn with_homing(
        mut self,
        of_axis: impl Fn(usize, &AxisSimulation) -> Option<SimulatedHoming>,
    ) -> SimulatedDrives {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            axis.homing = of_axis(index, &axis.simulation).unwrap_or_default();
        }
        self
    }
}

/// Where a tool sees the table of an axis now; 0 of one that there is not.
fn table_mm(axes: &[SimulatedAxis], talks: &[CrossTalk], axis: usize) -> f64 {
    let alone_mm = |axis: usize| {
        let axis = axes.get(axis);
        axis.map_or(0.0, |axis| {
            axis.true_mm(axis.simulation.instruments().table_mm)
        })
    };
    let talks = talks.iter().filter(|talk| talk.of == axis);
    talks.fold(alone_mm(axis), |seen_mm, talk| {
        seen_mm + talk.error_mm(alone_mm(talk.from))
    })
}

/// Friction in the scan that begins, by where the other axes are.
fn rub(axes: &mut [SimulatedAxis], talks: &[CrossTalk]) {
    if talks.is_empty() {
        return;
    }
    let mut shares = [0.0; MAX_AXES];
    for talk in talks {
        let from_mm = axes
            .get(talk.from)
            .map_or(0.0, |axis| axis.simulation.instruments().table_mm);
        if let Some(share) = shares.get_mut(talk.of) {
            *share += talk.friction_share(from_mm);
        }
    }
    for (axis, share) in axes.iter_mut().zip(shares) {
        axis.simulation.rub_more(share.max(FRICTION_SHARE_MIN));
    }
}

/// What the tool sees of the axes' screws, and of the other axes, in the samples of a scan.
fn show(axes: &mut [SimulatedAxis], talks: &[CrossTalk]) {
    for axis in axes.iter_mut() {
        let Some(pitch) = &axis.pitch else {
            continue;
        };
        for sample in &mut axis.samples {
            sample.table_mm += pitch.error_mm(sample.table_mm);
        }
    }
    if talks.is_empty() {
        return;
    }
    let mut alone = [[0.0; MAX_SUBSAMPLES]; MAX_AXES];
    for (kept, axis) in alone.iter_mut().zip(axes.iter()) {
        *kept = axis.samples.map(|sample| sample.table_mm);
    }
    for talk in talks {
        let (Some(axis), Some(from)) = (axes.get_mut(talk.of), alone.get(talk.from)) else {
            continue;
        };
        for (sample, from_mm) in axis.samples.iter_mut().zip(from) {
            sample.table_mm += talk.error_mm(*from_mm);
        }
    }
}

/// The time over which an axis brakes with the spindle, if it is the one that does.
fn of_axis(together: Option<(usize, f64)>, index: usize) -> Option<f64> {
    together
        .filter(|(axis, _)| *axis == index)
        .map(|(_, braking_s)| braking_s)
}

impl Drives for SimulatedDrives {
    fn count(&self) -> usize {
        self.axes.len()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        let Some(axis) = self.axes.get(axis) else {
            return DriveFeedback {
                state: DriveState::Lost { code: 0 },
                ..DriveFeedback::default()
            };
        };
        let simulation = &axis.simulation;
        DriveFeedback {
            restarted: false,
            motor_position_mm: axis.homing.shown_mm(simulation),
            scale_position_mm: simulation.scale_position_mm().map(|mm| axis.true_mm(mm)),
            velocity_mm_s: simulation.velocity_mm_s(),
            torque_nm: simulation.torque_nm(),
            winding_rise_k: simulation.winding_rise_k(),
            torque_limited: simulation.torque_limited(),
            referenced: axis.homing.referenced(),
            index_mm: axis.homing.index_mm(),
            probe_mm: None,
            state: match axis.off || !simulation.follows() {
                true => DriveState::Off,
                false => DriveState::Ready,
            },
        }
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        rub(&mut self.axes, &self.cross_talk);
        for (axis, command) in self.axes.iter_mut().zip(commands) {
            let acting = axis.acting(*command);
            if *command == DriveCommand::SwitchOn {
                axis.off = false;
                axis.simulation.power(true);
            }
            axis.homing.hand_over(command, &axis.simulation);
            axis.acts = axis.homing.act(acting, &axis.simulation);
        }
        advance(&mut self.axes, &self.bridges);
        for axis in &mut self.axes {
            let table_mm = axis.simulation.instruments().table_mm;
            axis.homing.scan(&axis.simulation, table_mm);
        }
        show(&mut self.axes, &self.cross_talk);
        let axes = &self.axes;
        let place_mm = |axis: usize| {
            axes.get(axis)
                .map_or(0.0, |axis| axis.simulation.instruments().table_mm)
        };
        self.contacts.scan(place_mm);
        if let Some(probe) = &mut self.probe {
            let samples = axes
                .first()
                .map(|axis| axis.simulation.settings.samples_per_scan());
            probe.scan(samples.unwrap_or(1).max(1), |axis, sample| {
                let samples = axes.get(axis).map(|axis| &axis.samples);
                let sample = samples.and_then(|samples| samples.get(sample));
                sample.map_or(0.0, |sample| sample.table_mm)
            });
        }
    }

    fn open_brakes(&mut self, axes: u64) {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            axis.simulation.release(axes >> index & 1 == 1);
        }
    }

    fn command_levels(&mut self, levels: &Levels) {
        self.auxiliaries.scan(levels);
        self.inputs.scan(levels.digital);
    }

    fn command_signals(&mut self, values: &[f64]) {
        self.contacts.command(values);
    }

    fn signal(&self, index: usize) -> Option<f64> {
        self.contacts.shown(index)
    }

    fn inputs(&self) -> InputFeedback {
        let mut shown = self.inputs.shown;
        for axis in &self.axes {
            shown.digital |= axis.homing.inputs();
        }
        if let Some(probe) = &self.probe {
            probe.show(&mut shown);
        }
        shown
    }

    fn auxiliary(&self) -> AuxiliaryFeedback {
        self.auxiliaries.feedback()
    }

    fn stalled(&mut self) {
        let together = self.auxiliaries.brakes_together();
        self.auxiliaries.run_down();
        // A drive that is off has nothing to brake with.
        run_down(&mut self.axes, &self.bridges, together);
        for axis in &mut self.axes {
            axis.off = true;
            if axis.simulation.is_braked() {
                axis.simulation.power(false);
            }
        }
    }

    fn instruments(&self, axis: usize) -> &[InstrumentSample] {
        self.axes.get(axis).map_or(&[], |axis| {
            let count = axis.simulation.settings.samples_per_scan();
            axis.samples.get(..count).unwrap_or(&axis.samples)
        })
    }

    fn state_bytes(&self) -> usize {
        let axes: usize = self.axes.iter().map(SimulatedAxis::state_bytes).sum();
        let beside =
            size_of::<AuxiliaryState>() + size_of::<ProbeState>() + size_of::<InputsState>();
        beside + self.contacts.state_bytes() + axes
    }

    fn save(&self, mut bytes: &mut [u8]) {
        let bytes = &mut bytes;
        put(bytes, self.auxiliaries.state());
        let probe = self.probe.as_ref().map(|probe| probe.state);
        put(bytes, &probe.unwrap_or_default());
        put(bytes, &self.inputs.state);
        self.contacts.save(|part| put_bytes(bytes, part));
        self.axes.iter().for_each(|axis| axis.save(bytes));
    }
    fn restore(&mut self, mut bytes: &[u8]) -> Result<(), StateRefused> {
        let bytes = &mut bytes;
        if !self.auxiliaries.restore(&taken(bytes)?) {
            return Err(StateRefused);
        }
        let probe = taken(bytes)?;
        self.inputs.state = taken(bytes)?;
        self.contacts.restore(bytes)?;
        let together = self.auxiliaries.brakes_together();
        self.auxiliaries.run_down();
        for axis in &mut self.axes {
            axis.restore(bytes)?;
        }
        // What was on its way arrives; after it comes nothing more, and the drives brake by themselves.
        let on_the_way = self.axes.first().map_or(0, |axis| axis.on_the_way.len());
        for next in 0..on_the_way {
            for axis in &mut self.axes {
                axis.acts = axis.on_the_way.get(next).copied().unwrap_or_default();
            }
            advance(&mut self.axes, &self.bridges);
        }
        run_down(&mut self.axes, &self.bridges, together);
        let axes = &self.axes;
        if let Some(of_this) = &mut self.probe {
            of_this.state = probe;
            let talks = &self.cross_talk;
            of_this.stand(|axis| table_mm(axes, talks, axis));
        }
        Ok(())
    }
}
