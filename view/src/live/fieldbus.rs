//! The fieldbus of a cell as its drive page shows it: what its owner counts, and how the slaves are.

use bus::drive_codes::al_state;
use bus::drive_page::{BusState, DrivePage, Inputs, SlaveState};

/// The error bit of an AL status.
const AL_ERROR: u16 = 0x10;

/// The fieldbus, seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct BusView {
    /// What its owner does; it dies with it.
    pub state: BusState,
    /// Process id of the owner; none while nobody has it.
    pub owner_pid: Option<u32>,
    /// How many slaves there are.
    pub slave_count: usize,
    /// Whether distributed clocks are in use.
    pub distributed_clocks: bool,
    /// What came back in the last cycle; none before the first.
    pub inputs: Option<Inputs>,
}

/// A slave in words.
pub fn slave_words(slave: &SlaveState) -> String {
    if slave.answered != 1 {
        return "no answer".into();
    }
    let error = if slave.al_status & AL_ERROR != 0 {
        " with an error"
    } else {
        ""
    };
    format!("{}{error}", al_state(slave.al_status))
}

impl BusView {
    /// What this page shows now.
    pub fn of(page: &DrivePage) -> BusView {
        let wiring = page.wiring();
        let owner_pid = page.owner();
        BusView {
            state: owner_pid.map_or(BusState::Free, |_| page.state()),
            owner_pid,
            slave_count: wiring.slaves().len(),
            distributed_clocks: wiring.reference_clock != 0,
            inputs: page.newest_inputs(),
        }
    }

    /// What came back in the last cycle, while cycles are exchanged: of a bus that is not in operation it would be what was once.
    fn now(&self) -> Option<&Inputs> {
        let inputs = self.inputs.as_ref();
        inputs.filter(|_| self.state == BusState::Cycling)
    }

    /// The slaves, in the order of the cable; none before the first cycle, and while the bus is not in operation.
    pub fn slaves(&self) -> &[SlaveState] {
        let all = self.now().map(|inputs| &inputs.slaves);
        all.and_then(|slaves| slaves.get(..self.slave_count))
            .unwrap_or(&[])
    }

    /// From sending to the answer, in µs; none if the last cycle was not answered.
    pub fn round_trip_us(&self) -> Option<f64> {
        let inputs = self.now().filter(|inputs| inputs.answered == 1);
        inputs.map(|inputs| inputs.round_trip_ns as f64 * 1e-3)
    }

    /// How much later than in the middle between two SYNC0 the last frame passed the reference clock, in µs; none without distributed
    /// clocks, or if the last cycle was not answered.
    pub fn clock_offset_us(&self) -> Option<f64> {
        let inputs = self.now().filter(|inputs| inputs.answered == 1);
        let known = inputs.filter(|_| self.distributed_clocks);
        known.map(|inputs| inputs.clock_late_ns as f64 * 1e-3)
    }

    /// In one line.
    pub fn words(&self) -> String {
        let mut words = format!("bus {}", self.state.words());
        let Some(inputs) = &self.inputs else {
            return words;
        };
        if self.state == BusState::Cycling {
            let slaves = self.slaves().iter();
            let operational = slaves.filter(|slave| slave_words(slave) == "OP").count();
            words += &format!(", {operational} of {} slaves in OP", self.slave_count);
        }
        if let Some(us) = self.round_trip_us() {
            words += &format!(", round trip {us:.0} µs");
        }
        if let Some(us) = self.clock_offset_us() {
            words += &format!(", clock offset {us:+.1} µs");
        }
        let counts = &inputs.counts;
        words += &format!(
            ", {} frames, {} missed, {} short",
            counts.sent, counts.missed, counts.short
        );
        words
    }

    /// What needs a look, in a few words; none while all is well.
    pub fn alarm(&self) -> Option<String> {
        if self.state != BusState::Cycling {
            return Some(format!("bus {}", self.state.words()));
        }
        let counts = self.inputs.as_ref()?.counts;
        let lost = counts.missed + counts.short;
        (lost > 0).then(|| format!("{lost} bus cycles missed or short"))
    }
}

#[cfg(test)]
pub mod tests {
    use bus::drive_page::Counts;
    use bytemuck::Zeroable;

    use super::*;

    /// Two slaves of which the second is not in operation, with distributed clocks.
    pub fn example() -> BusView {
        let mut inputs = Inputs::zeroed();
        inputs.answered = 1;
        inputs.round_trip_ns = 84_600;
        inputs.clock_late_ns = -1_250;
        inputs.counts = Counts {
            sent: 1000,
            missed: 2,
            short: 3,
            late: 4,
            foreign: 5,
            repeated: 6,
        };
        for (slave, al_status) in inputs.slaves.iter_mut().zip([0x08, 0x14]) {
            slave.answered = 1;
            slave.al_status = al_status;
        }
        BusView {
            state: BusState::Cycling,
            owner_pid: Some(77),
            slave_count: 2,
            distributed_clocks: true,
            inputs: Some(inputs),
        }
    }

    #[test]
    fn a_bus_is_told_in_one_line_and_what_is_not_known_is_left_out() {
        let mut view = example();
        assert_eq!(
            view.words(),
            "bus in operation, 1 of 2 slaves in OP, round trip 85 µs, clock offset -1.2 µs, 1000 frames, 2 missed, 3 short"
        );
        let states: Vec<String> = view.slaves().iter().map(slave_words).collect();
        assert_eq!(states, ["OP", "SAFE-OP with an error"]);
        view.distributed_clocks = false;
        assert_eq!(view.clock_offset_us(), None);
        if let Some(inputs) = &mut view.inputs {
            inputs.answered = 0;
            inputs.slaves = [SlaveState::default(); bus::drive_page::SLAVES_MAX];
        }
        assert_eq!(
            view.words(),
            "bus in operation, 0 of 2 slaves in OP, 1000 frames, 2 missed, 3 short"
        );
        assert_eq!(slave_words(&SlaveState::default()), "no answer");
        view.inputs = None;
        view.state = BusState::Starting;
        assert_eq!(view.words(), "bus starting");
        assert!(view.slaves().is_empty());
    }

    #[test]
    fn a_bus_that_is_not_in_operation_tells_what_was_counted_and_of_no_slave_how_it_was() {
        for state in [BusState::Free, BusState::Starting, BusState::Down] {
            let view = BusView { state, ..example() };
            let words = format!("bus {}, 1000 frames, 2 missed, 3 short", state.words());
            assert_eq!(view.words(), words);
            assert!(view.slaves().is_empty());
            assert_eq!((view.round_trip_us(), view.clock_offset_us()), (None, None));
        }
    }

    #[test]
    fn lost_cycles_and_a_bus_that_is_not_in_operation_need_a_look() {
        let mut view = example();
        assert_eq!(
            view.alarm().as_deref(),
            Some("5 bus cycles missed or short")
        );
        if let Some(inputs) = &mut view.inputs {
            inputs.counts = Counts::default();
        }
        assert_eq!(view.alarm(), None);
        view.state = BusState::Down;
        assert_eq!(view.alarm().as_deref(), Some("bus down"));
    }
}
