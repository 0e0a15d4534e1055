//! Drives that note what they are asked for and show, and drives that show it again.

use bus::sample::Levels;
use master::{
    AuxiliaryFeedback, DriveCommand, DriveFeedback, Drives, InputFeedback, InstrumentSample,
    StateRefused,
};
use plant_sim::SimulatedDrives;

/// One exchange.
#[derive(Debug, Clone)]
pub(super) struct Exchange {
    /// What each drive was asked for.
    pub commands: Vec<DriveCommand>,
    /// What was shown behind it.
    shown: Shown,
}

/// What drives show.
#[derive(Debug, Clone)]
pub(super) struct Shown {
    axes: Vec<DriveFeedback>,
    auxiliary: AuxiliaryFeedback,
    inputs: InputFeedback,
}

impl Shown {
    pub fn by(drives: &impl Drives) -> Shown {
        Shown {
            axes: (0..drives.count())
                .map(|axis| drives.feedback(axis))
                .collect(),
            auxiliary: drives.auxiliary(),
            inputs: drives.inputs(),
        }
    }
}

/// Simulated drives that are listened to.
#[derive(Debug)]
pub(super) struct Heard {
    pub drives: SimulatedDrives,
    pub exchanges: Vec<Exchange>,
}

impl Drives for Heard {
    fn count(&self) -> usize {
        self.drives.count()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        self.drives.feedback(axis)
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        self.drives.exchange(commands);
        self.exchanges.push(Exchange {
            commands: commands.to_vec(),
            shown: Shown::by(&self.drives),
        });
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

/// Drives that do not move: they show what others have shown in the same scan.
#[derive(Debug)]
pub(super) struct Played<'a> {
    beginning: &'a Shown,
    exchanges: &'a [Exchange],
    instruments: Vec<InstrumentSample>,
    done: usize,
}

impl<'a> Played<'a> {
    pub fn new(beginning: &'a Shown, exchanges: &'a [Exchange], subsamples: u32) -> Played<'a> {
        Played {
            beginning,
            exchanges,
            instruments: vec![InstrumentSample::default(); subsamples as usize],
            done: 0,
        }
    }

    fn shown(&self) -> &Shown {
        let last = self.done.checked_sub(1);
        let last = last.and_then(|last| self.exchanges.get(last));
        last.map_or(self.beginning, |exchange| &exchange.shown)
    }
}

impl Drives for Played<'_> {
    fn count(&self) -> usize {
        self.beginning.axes.len()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        self.shown().axes.get(axis).copied().unwrap_or_default()
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        std::hint::black_box(commands);
        self.done += 1;
    }

    fn auxiliary(&self) -> AuxiliaryFeedback {
        self.shown().auxiliary
    }

    fn inputs(&self) -> InputFeedback {
        self.shown().inputs
    }

    fn instruments(&self, _axis: usize) -> &[InstrumentSample] {
        &self.instruments
    }

    fn state_bytes(&self) -> usize {
        0
    }

    fn save(&self, _bytes: &mut [u8]) {}

    fn restore(&mut self, _bytes: &[u8]) -> Result<(), StateRefused> {
        Ok(())
    }
}
