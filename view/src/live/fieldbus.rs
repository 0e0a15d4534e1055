//! The fieldbus of a cell as its drive page shows it: what its owner counts, and how the slaves are.

use bus::drive_codes::al_state;
use bus::drive_page::{BusState as Bus, DrivePage, Inputs, SlaveState as Slave};
use machine::Machine;
use remote::state::{BusState, SlaveState};

use super::state::rounded;

/// The error bit of an AL status.
const AL_ERROR: u16 = 0x10;

/// State of a slave in operation.
const OPERATES: &str = "OP";

/// A slave in words.
fn slave_words(slave: &Slave) -> String {
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

/// What a drive page shows now.
pub fn of(page: &DrivePage, machine: &Machine) -> BusState {
    let (wiring, owner_pid) = (page.wiring(), page.owner());
    let state = owner_pid.map_or(Bus::Free, |_| page.state());
    let seen = Seen {
        state,
        owner_pid,
        slave_count: wiring.slaves().len(),
        distributed_clocks: wiring.reference_clock != 0,
        inputs: page.newest_inputs(),
        failure: page.failure(),
    };
    seen.told(machine)
}

/// What was read of a page.
struct Seen {
    state: Bus,
    owner_pid: Option<u32>,
    slave_count: usize,
    distributed_clocks: bool,
    inputs: Option<Inputs>,
    /// Why the last start-up failed.
    failure: String,
}

impl Seen {
    fn told(&self, machine: &Machine) -> BusState {
        let inputs = self.inputs.as_ref();
        let counts = inputs.map(|inputs| inputs.counts).unwrap_or_default();
        // Of a bus that is not in operation the rest would be what was once.
        let now = inputs.filter(|_| self.state == Bus::Cycling);
        let answered = now.filter(|inputs| inputs.answered == 1);
        let us = |ns: i64| rounded(ns as f64 * 1e-3, 3);
        let axis_at = |place: usize| {
            let axes = machine.axes.iter().enumerate();
            let there = axes.filter(|(index, _)| machine.slave_of(*index) == place);
            let names: Vec<&str> = there.map(|(_, axis)| axis.name.as_str()).collect();
            (!names.is_empty()).then(|| names.join(" "))
        };
        let slaves = now.and_then(|now| now.slaves.get(..self.slave_count));
        let slaves = slaves.unwrap_or_default().iter().enumerate();
        let slaves: Vec<SlaveState> = slaves
            .map(|(place, slave)| SlaveState {
                place,
                axis: axis_at(place),
                al_state: slave_words(slave),
                al_status_code: slave.al_status_code,
            })
            .collect();
        let operates = |slave: &&SlaveState| slave.al_state == OPERATES;
        let operational = slaves.iter().filter(operates).count();
        let clocked = counts.clocked > 0;
        let mut told = BusState {
            state: self.state_words(operational).into(),
            owner_pid: self.owner_pid,
            frames: counts.sent,
            missed: counts.missed,
            short: counts.short,
            late: counts.late,
            foreign: counts.foreign,
            repeated: counts.repeated,
            round_trip_us: answered.map(|inputs| us(inputs.round_trip_ns as i64)),
            clock_offset_us: answered
                .filter(|_| self.distributed_clocks)
                .map(|inputs| us(inputs.clock_late_ns)),
            clock_offset_mean_us: clocked
                .then(|| us((counts.clock_off_sum_ns / counts.clocked) as i64)),
            clock_offset_peak_us: clocked.then(|| us(counts.clock_off_max_ns as i64)),
            slaves,
            ..BusState::default()
        };
        told.summary = self.words(&told, operational);
        let lost = counts.missed + counts.short;
        told.alarm = match operational {
            0 => Some(format!("bus {}", told.state)),
            _ if lost == 0 => None,
            _ => Some(format!("{lost} bus cycles missed or short")),
        };
        told
    }

    /// Where frames are exchanged, by how many slaves are in operation.
    fn state_words(&self, operational: usize) -> &'static str {
        let has_link = self.inputs.is_none_or(|inputs| inputs.no_link == 0);
        match (self.state, operational) {
            (Bus::Cycling, 0) if has_link => "out of operation",
            (Bus::Cycling, 0) => "without a link",
            (Bus::Cycling, some) if some < self.slave_count => "in operation in part",
            (state, _) => state.words(),
        }
    }

    /// In one line.
    fn words(&self, told: &BusState, operational: usize) -> String {
        let mut words = format!("bus {}", told.state);
        if self.state == Bus::Down && !self.failure.is_empty() {
            words += &format!(": {}", self.failure);
        }
        if self.inputs.is_none() {
            return words;
        }
        if self.state == Bus::Cycling {
            words += &format!(", {operational} of {} slaves in OP", self.slave_count);
        }
        if let Some(us) = told.round_trip_us {
            words += &format!(", round trip {us:.0} µs");
        }
        if let Some(us) = told.clock_offset_us {
            words += &format!(", clock offset {us:+.1} µs");
            if let (Some(mean), Some(peak)) = (told.clock_offset_mean_us, told.clock_offset_peak_us)
            {
                words += &format!(" (mean {mean:.1}, peak {peak:.1})");
            }
        }
        let (frames, missed, short) = (told.frames, told.missed, told.short);
        words + &format!(", {frames} frames, {missed} missed, {short} short")
    }
}

#[cfg(test)]
pub mod tests {
    use ::bus::drive_page::{Counts, SLAVES_MAX};
    use bytemuck::Zeroable;

    use super::*;
    use crate::live::test_support::machine;

    /// Two slaves of which the second is not in operation, with distributed clocks.
    fn seen() -> Seen {
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
            clocked: 10,
            clock_off_sum_ns: 24_000,
            clock_off_max_ns: 51_000,
        };
        for (slave, al_status) in inputs.slaves.iter_mut().zip([0x08, 0x14]) {
            slave.answered = 1;
            slave.al_status = al_status;
        }
        Seen {
            state: Bus::Cycling,
            owner_pid: Some(77),
            slave_count: 2,
            distributed_clocks: true,
            inputs: Some(inputs),
            failure: String::new(),
        }
    }

    /// What is told of them.
    pub fn example() -> BusState {
        seen().told(&machine())
    }

    #[test]
    fn a_bus_is_told_in_one_line_and_what_is_not_known_is_left_out() {
        let mut bus = seen();
        let told = |bus: &Seen| bus.told(&machine());
        assert_eq!(
            told(&bus).summary,
            "bus in operation in part, 1 of 2 slaves in OP, round trip 85 µs, clock offset -1.2 µs (mean 2.4, peak 51.0), 1000 frames, 2 missed, 3 short"
        );
        let slaves = told(&bus).slaves;
        let states: Vec<&str> = slaves.iter().map(|of| of.al_state.as_str()).collect();
        assert_eq!(states, ["OP", "SAFE-OP with an error"]);
        bus.distributed_clocks = false;
        assert_eq!(told(&bus).clock_offset_us, None);
        if let Some(inputs) = &mut bus.inputs {
            inputs.answered = 0;
            inputs.slaves = [Slave::default(); SLAVES_MAX];
        }
        assert_eq!(
            told(&bus).summary,
            "bus out of operation, 0 of 2 slaves in OP, 1000 frames, 2 missed, 3 short"
        );
        assert_eq!(told(&bus).slaves[0].al_state, "no answer");
        bus.inputs = None;
        bus.state = Bus::Starting;
        assert_eq!(told(&bus).summary, "bus starting");
        assert!(told(&bus).slaves.is_empty());
    }

    #[test]
    fn a_bus_that_is_not_in_operation_tells_what_was_counted_and_of_no_slave_how_it_was() {
        for state in [Bus::Free, Bus::Starting, Bus::Down] {
            let told = Seen { state, ..seen() }.told(&machine());
            let words = format!("bus {}, 1000 frames, 2 missed, 3 short", state.words());
            assert_eq!(told.summary, words);
            assert!(told.slaves.is_empty());
            assert_eq!((told.round_trip_us, told.clock_offset_us), (None, None));
        }
    }

    #[test]
    fn lost_cycles_and_a_bus_that_is_not_in_operation_need_a_look() {
        let mut bus = seen();
        let alarm = |bus: &Seen| bus.told(&machine()).alarm;
        assert_eq!(alarm(&bus).as_deref(), Some("5 bus cycles missed or short"));
        if let Some(inputs) = &mut bus.inputs {
            inputs.counts = Counts::default();
        }
        assert_eq!(alarm(&bus), None);
        bus.state = Bus::Down;
        assert_eq!(alarm(&bus).as_deref(), Some("bus down"));
        bus.failure = "axis X: another device is there".into();
        let told = bus.told(&machine());
        assert!(
            told.summary
                .starts_with("bus down: axis X: another device is there, ")
        );
    }
}
