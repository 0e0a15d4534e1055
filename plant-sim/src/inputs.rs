//! Simulated inputs: a script says when which of them changes.

use bus::sample::{DIGITAL_OUTPUTS, with_bit};
use bytemuck::{Pod, Zeroable};
use master::InputFeedback;

use crate::plant_file::PlantInput;

/// What outlives the process.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct InputsState {
    /// Scans so far.
    pub scans: u64,
    /// Digital outputs as the terminals show them.
    pub outputs: u64,
    /// The scan in which each of them was switched on last.
    pub on_since: [u64; DIGITAL_OUTPUTS],
}

impl Default for InputsState {
    fn default() -> InputsState {
        InputsState::zeroed()
    }
}

/// Digital and analogue inputs.
#[derive(Debug, Clone, Default)]
pub struct SimulatedInputs {
    script: Vec<PlantInput>,
    scan_s: f64,
    /// The state, for saving it.
    pub state: InputsState,
    /// What they show.
    pub shown: InputFeedback,
}

impl SimulatedInputs {
    /// Inputs that follow a script from now on.
    pub fn new(script: Vec<PlantInput>, scan_s: f64) -> SimulatedInputs {
        SimulatedInputs {
            script,
            scan_s,
            ..SimulatedInputs::default()
        }
    }

    /// One scan, with these digital outputs on.
    pub fn scan(&mut self, outputs: u64) {
        if self.script.is_empty() {
            return;
        }
        let state = &mut self.state;
        let rising = outputs & !state.outputs;
        for (output, since) in state.on_since.iter_mut().enumerate() {
            if rising >> output & 1 == 1 {
                *since = state.scans;
            }
        }
        state.outputs = outputs;
        state.scans += 1;
        let mut shown = InputFeedback::default();
        for line in self.script.iter().filter(|line| self.has_come(line)) {
            if let Some(input) = line.digital {
                shown.digital = with_bit(shown.digital, input as usize, line.value != 0.0);
            }
            let analog = line
                .analog
                .and_then(|input| shown.analog.get_mut(input as usize));
            if let Some(analog) = analog {
                *analog = line.value;
            }
        }
        self.shown = shown;
    }

    fn has_come(&self, line: &PlantInput) -> bool {
        let state = &self.state;
        let since = match line.after_output {
            None => 0,
            Some(output) if state.outputs >> output.min(63) & 1 == 0 => return false,
            Some(output) => state.on_since.get(output as usize).copied().unwrap_or(0),
        };
        state.scans.saturating_sub(since) as f64 * self.scan_s >= line.at_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(digital: u32, value: f64, at_s: f64, after_output: Option<u32>) -> PlantInput {
        PlantInput {
            digital: Some(digital),
            analog: None,
            value,
            at_s,
            after_output,
        }
    }

    #[test]
    fn inputs_change_when_the_script_says_and_behind_an_output() {
        let script = vec![
            line(3, 1.0, 0.010, None),
            line(3, 0.0, 0.020, None),
            line(4, 1.0, 0.005, Some(7)),
            PlantInput {
                digital: None,
                analog: Some(2),
                ..line(0, -2.5, 0.002, None)
            },
        ];
        let mut inputs = SimulatedInputs::new(script, 1e-3);
        let mut changes = Vec::new();
        let mut before = 0;
        for scan in 1..100u32 {
            // The output is on from scan 30 to 59.
            inputs.scan(if (30..60).contains(&scan) { 1 << 7 } else { 0 });
            let digital = inputs.shown.digital;
            if digital != before {
                changes.push((scan, digital));
            }
            before = digital;
            let analog = if scan < 2 { 0.0 } else { -2.5 };
            assert_eq!(inputs.shown.analog[2], analog);
            if scan == 32 {
                // A process that takes over goes on from the saved state.
                let mut other = SimulatedInputs::new(inputs.script.clone(), 1e-3);
                other.state = inputs.state;
                inputs = other;
            }
        }
        assert_eq!(changes, [(10, 8), (20, 0), (34, 16), (60, 0)]);
    }
}
