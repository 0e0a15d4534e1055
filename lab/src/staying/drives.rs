//! Simulated drives that can have a fault or be lost, as drives on a bus can: each brakes by itself then, and comes back when it is
//! switched on.

use std::sync::atomic::{AtomicU64, Ordering};

use bus::sample::{Levels, MAX_AXES};
use master::{
    AuxiliaryFeedback, DriveCommand, DriveFeedback, DriveState, Drives, InputFeedback,
    InstrumentSample, STANDSTILL_MM_S, StateRefused,
};
use plant_sim::SimulatedDrives;

/// From the order to switch on to a drive that follows, once its fault is reset.
const SWITCHES_ON_SCANS: u32 = 20;
/// A bus that is started again is away for so long.
const AWAY_SCANS: u32 = 200;
/// A fault code that no drive of the product has: "the lab's".
const CODE: u32 = 0xFF01;

/// What is wrong with a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Trouble {
    None,
    /// Until it is reset, which comes with the order to switch on.
    Fault,
    /// Until the bus is started again, which comes with the same order.
    Lost,
    /// The bus starts: lost for so many scans more.
    Away(u32),
    /// Off, and on after so many scans of that order.
    Off(u32),
}

/// Axes, a bit each.
#[derive(Debug, Default)]
struct Axes(AtomicU64);

impl Axes {
    fn add(&self, axis: usize) {
        self.0.fetch_or(1 << axis, Ordering::Relaxed);
    }

    fn take(&self) -> impl Iterator<Item = usize> + use<> {
        let bits = self.0.swap(0, Ordering::Relaxed);
        (0..MAX_AXES).filter(move |axis| bits >> axis & 1 == 1)
    }
}

impl Clone for Axes {
    fn clone(&self) -> Axes {
        Axes(AtomicU64::new(self.0.load(Ordering::Relaxed)))
    }
}

/// The drives of a machine.
#[derive(Debug, Clone)]
pub struct TroubledDrives {
    drives: SimulatedDrives,
    /// Troubles that begin with the next scan: the drives of a master can be looked at alone, not changed.
    faults: Axes,
    losses: Axes,
    outages: Axes,
    troubles: [Trouble; MAX_AXES],
    /// What each has shown last while it was heard.
    heard: [DriveFeedback; MAX_AXES],
    commands: Vec<DriveCommand>,
}

impl TroubledDrives {
    /// None of them is troubled.
    pub fn new(drives: SimulatedDrives) -> TroubledDrives {
        TroubledDrives {
            commands: vec![DriveCommand::Disabled; drives.count()],
            drives,
            faults: Axes::default(),
            losses: Axes::default(),
            outages: Axes::default(),
            troubles: [Trouble::None; MAX_AXES],
            heard: [DriveFeedback::default(); MAX_AXES],
        }
    }

    /// The drive of an axis has a fault of its own.
    pub fn fault(&self, axis: usize) {
        self.faults.add(axis);
    }

    /// The drive of an axis does not answer any more.
    pub fn lose(&self, axis: usize) {
        self.losses.add(axis);
    }

    /// The drive of an axis loses its power.
    pub fn lose_power(&self, axis: usize) {
        self.outages.add(axis);
    }

    /// The same troubles as these have: another master has taken the drives.
    pub fn be_troubled_as(&mut self, others: &TroubledDrives) {
        (self.troubles, self.heard) = (others.troubles, others.heard);
        (self.faults, self.losses) = (others.faults.clone(), others.losses.clone());
    }

    /// Whether any has a trouble.
    pub fn are_troubled(&self) -> bool {
        self.troubles.iter().any(|of| *of != Trouble::None)
    }

    /// What a drive does that has been told this.
    fn told(&mut self, axis: usize, command: DriveCommand) -> DriveCommand {
        let switches_on = command == DriveCommand::SwitchOn;
        let next = match self.troubles[axis] {
            Trouble::None => return command,
            Trouble::Fault if switches_on => Trouble::Off(SWITCHES_ON_SCANS),
            Trouble::Away(0) => Trouble::Off(SWITCHES_ON_SCANS),
            Trouble::Away(scans) => Trouble::Away(scans - 1),
            Trouble::Off(0) => Trouble::None,
            Trouble::Off(scans) if switches_on => Trouble::Off(scans - 1),
            stays => stays,
        };
        self.troubles[axis] = next;
        // It brakes by its own quick stop, and then has no power.
        match self.drives.feedback(axis).velocity_mm_s.abs() > STANDSTILL_MM_S {
            true => DriveCommand::Brake {
                deceleration_mm_s2: 0.0,
            },
            false => DriveCommand::Disabled,
        }
    }
}

impl Drives for TroubledDrives {
    fn count(&self) -> usize {
        self.drives.count()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        let shown = self.drives.feedback(axis);
        let state = match self.troubles.get(axis) {
            None | Some(Trouble::None) => return shown,
            Some(Trouble::Fault) => DriveState::Fault { code: CODE },
            Some(Trouble::Off(_)) => DriveState::Off,
            Some(Trouble::Lost | Trouble::Away(_)) => {
                let state = DriveState::Lost { code: 0 };
                return DriveFeedback {
                    state,
                    index_mm: None,
                    ..self.heard[axis]
                };
            }
        };
        DriveFeedback { state, ..shown }
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        for axis in self.faults.take() {
            self.troubles[axis] = Trouble::Fault;
        }
        for axis in self.losses.take() {
            self.troubles[axis] = Trouble::Lost;
        }
        for axis in self.outages.take() {
            self.drives.lose_power(axis);
        }
        let lost = self.troubles.contains(&Trouble::Lost);
        if lost && commands.contains(&DriveCommand::SwitchOn) {
            self.troubles = [Trouble::Away(AWAY_SCANS); MAX_AXES];
        }
        let mut told = std::mem::take(&mut self.commands);
        for (axis, (told, command)) in told.iter_mut().zip(commands).enumerate() {
            *told = self.told(axis, *command);
        }
        self.drives.exchange(&told);
        self.commands = told;
        for axis in 0..self.count() {
            if !matches!(self.troubles[axis], Trouble::Lost | Trouble::Away(_)) {
                self.heard[axis] = self.drives.feedback(axis);
            }
        }
    }

    fn stalled(&mut self) {
        self.drives.stalled();
    }

    fn open_brakes(&mut self, axes: u64) {
        self.drives.open_brakes(axes);
    }

    fn command_levels(&mut self, levels: &Levels) {
        self.drives.command_levels(levels);
    }

    fn auxiliary(&self) -> AuxiliaryFeedback {
        self.drives.auxiliary()
    }

    fn inputs(&self) -> InputFeedback {
        self.drives.inputs()
    }

    fn signal(&self, index: usize) -> Option<f64> {
        self.drives.signal(index)
    }

    fn command_signals(&mut self, values: &[f64]) {
        self.drives.command_signals(values);
    }

    fn instruments(&self, axis: usize) -> &[InstrumentSample] {
        self.drives.instruments(axis)
    }

    fn state_bytes(&self) -> usize {
        self.drives.state_bytes()
    }

    fn save(&self, bytes: &mut [u8]) {
        self.drives.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused> {
        self.drives.restore(bytes)
    }
}
