//! Named inputs and outputs of drives and terminals, in each cycle.

use std::ops::Range;

use bus::drive_page::{Inputs, Outputs, Wiring};

use super::cia402_drives::{WireAnswer, operates};
use super::signal_places::{SignalDevice, SignalPlace, SignalPlaces};
use crate::field::Field;
use crate::process_data;
use crate::terminal_file::{ChannelKind, TerminalFile};

/// A terminal, as its file describes it.
#[derive(Debug, Clone)]
pub struct TerminalSetup {
    /// Its terminal file.
    pub terminal: TerminalFile,
    /// Its place on the cable, from 0.
    pub slave: usize,
}

/// A terminal in operation.
#[derive(Debug, Clone)]
struct Terminal {
    slave: usize,
    /// What it is sent where no signal says it.
    constants: Vec<(Field, i64)>,
    /// Cycles in a row that did not come back from it.
    missed: u32,
    lost: bool,
}

/// A signal that a device shows.
#[derive(Debug, Clone)]
struct Input {
    place: SignalPlace,
    /// What a counter has counted.
    counted: i64,
    /// The terminal has answered without a break since it was counted.
    counts: bool,
}

/// A signal that goes to a device, and what is commanded.
#[derive(Debug, Clone)]
struct Output {
    place: SignalPlace,
    value: f64,
}

/// The signals of a machine that devices have.
#[derive(Debug, Clone)]
pub(super) struct DeviceSignals {
    terminals: Vec<Terminal>,
    inputs: Vec<Input>,
    outputs: Vec<Output>,
    /// What each signal of the machine shows, where a device has it and answers.
    shown: Vec<Option<f64>>,
    /// Missed cycles in a row after which a terminal counts as lost.
    missed_max: u32,
}

impl DeviceSignals {
    /// None has been seen; outputs are what devices are sent while nobody commands them.
    pub fn new(places: &SignalPlaces, terminals: &[TerminalSetup], missed_max: u32) -> Self {
        let terminals = terminals.iter().map(|of| Terminal {
            slave: of.slave,
            constants: process_data::constants(&of.terminal.process_data.receive),
            missed: 0,
            lost: true,
        });
        let inputs = places.inputs.iter().map(|place| Input {
            place: *place,
            counted: 0,
            counts: false,
        });
        let outputs = places.outputs.iter().map(|place| Output {
            place: *place,
            value: place.lost,
        });
        let last = places.inputs.iter().map(|place| place.signal + 1).max();
        DeviceSignals {
            terminals: terminals.collect(),
            inputs: inputs.collect(),
            outputs: outputs.collect(),
            shown: vec![None; last.unwrap_or(0)],
            missed_max,
        }
    }

    /// What all signals of the machine are.
    pub fn command(&mut self, values: &[f64]) {
        for output in &mut self.outputs {
            if let Some(value) = values.get(output.place.signal) {
                output.value = *value;
            }
        }
    }

    /// Writes what terminals are sent, and the bits of drives; for those, what they are sent else is there already.
    pub fn write(&self, wiring: &Wiring, outputs: &mut Outputs) {
        for terminal in &self.terminals {
            let range = outputs_of(wiring, terminal.slave);
            for image in [&mut outputs.image, &mut outputs.silent] {
                let Some(own) = image.get_mut(range.clone()) else {
                    continue;
                };
                for (field, value) in &terminal.constants {
                    field.write(own, *value as u32);
                }
            }
        }
        for Output { place, value } in &self.outputs {
            let range = outputs_of(wiring, place.slave);
            for (image, value) in [
                (&mut outputs.image, *value),
                (&mut outputs.silent, place.lost),
            ] {
                if let Some(own) = image.get_mut(range.clone()) {
                    place.code.write(own, value);
                }
            }
        }
    }

    /// Takes the answer to a cycle, `sound` if all slaves took part in it; `is_lost` tells whether the drive of an axis is lost.
    pub fn take(
        &mut self,
        wiring: &Wiring,
        inputs: &Inputs,
        (answer, sound): (WireAnswer, bool),
        is_lost: impl Fn(usize) -> bool,
    ) {
        let answered = answer == WireAnswer::Answered;
        for terminal in &mut self.terminals {
            let state = inputs.slaves.get(terminal.slave).copied();
            let is_out = !operates(&state.unwrap_or_default());
            terminal.missed = match answered && sound {
                true => 0,
                false => terminal.missed.saturating_add(1),
            };
            let falls_silent = terminal.missed >= self.missed_max;
            let gone = answer == WireAnswer::Down || answered && is_out;
            terminal.lost = gone || falls_silent || terminal.lost && terminal.missed > 0;
        }
        for input in &mut self.inputs {
            let Some(shown) = self.shown.get_mut(input.place.signal) else {
                continue;
            };
            let lost = match input.place.device {
                SignalDevice::Drive(axis) => is_lost(axis),
                SignalDevice::Terminal(index) => self.terminals.get(index).is_none_or(|of| of.lost),
            };
            if lost {
                *shown = None;
                input.counts = false;
            } else if answered && sound {
                let own = inputs.image.get(inputs_of(wiring, input.place.slave));
                *shown = own.map(|own| input.read(own));
            }
        }
    }

    /// What a signal shows; none while its device does not answer.
    pub fn shown(&self, signal: usize) -> Option<f64> {
        self.shown.get(signal).copied().flatten()
    }

    /// Whether a terminal is lost.
    pub fn any_lost(&self) -> bool {
        self.terminals.iter().any(|terminal| terminal.lost)
    }

    /// What must outlive the process: of each counter its count, and whether it counts.
    pub fn counts(&self) -> impl Iterator<Item = [u64; 2]> + '_ {
        let counters = self.inputs.iter().filter(|input| input.is_counter());
        counters.map(|input| [input.counted as u64, u64::from(input.counts)])
    }

    /// Goes on from counts that were saved.
    pub fn count_from(&mut self, mut saved: impl Iterator<Item = [u64; 2]>) {
        for input in self.inputs.iter_mut().filter(|input| input.is_counter()) {
            if let Some([counted, counts]) = saved.next() {
                (input.counted, input.counts) = (counted as i64, counts == 1);
            }
        }
    }
}

impl Input {
    fn is_counter(&self) -> bool {
        self.place.code.kind == ChannelKind::Counter
    }

    fn read(&mut self, own: &[u8]) -> f64 {
        let code = &self.place.code;
        let number = code.number(own);
        if !self.is_counter() {
            return code.value_of(number);
        }
        self.counted = match self.counts {
            true => code.counted_on(self.counted, number),
            false => number,
        };
        self.counts = true;
        self.counted as f64
    }
}

/// Where the outputs of a slave are, and its inputs.
fn outputs_of(wiring: &Wiring, slave: usize) -> Range<usize> {
    let own = wiring.slaves().get(slave).copied().unwrap_or_default();
    usize::from(own.outputs_at)..usize::from(own.outputs_at + own.output_bytes)
}

fn inputs_of(wiring: &Wiring, slave: usize) -> Range<usize> {
    let own = wiring.slaves().get(slave).copied().unwrap_or_default();
    usize::from(own.inputs_at)..usize::from(own.inputs_at + own.input_bytes)
}
