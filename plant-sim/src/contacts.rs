//! What simulated devices show at named inputs: contacts that follow an output, a place of an axis or the time, with their delays, their
//! bouncing and their faults.

use bytemuck::{Pod, Zeroable};
use machine::Machine;
use master::StateRefused;

use crate::axis::SetupError;
use crate::plant_file::PlantContact;
use crate::state_bytes::taken;

/// What of a contact outlives the process.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
struct ContactState {
    /// Scan in which what it follows changed last.
    changed: u64,
    /// Scan in which the contact itself did.
    switched: u64,
    /// 1 while what it follows is so.
    met: u32,
    /// 1 while the contact says so.
    on: u32,
}

/// One contact of the plant file, with what it names by their indexes.
#[derive(Debug, Clone)]
struct Contact {
    of: PlantContact,
    signal: usize,
    follows: Option<usize>,
    axis: Option<usize>,
    state: ContactState,
}

/// The simulated devices at named inputs.
#[derive(Debug, Clone, Default)]
pub struct SimulatedContacts {
    contacts: Vec<Contact>,
    scan_s: f64,
    scans: u64,
    /// What signals showed when they were commanded last.
    commanded: Vec<f64>,
    /// Of each signal, what its device shows; none while it is lost.
    shown: Vec<Option<f64>>,
    defaults: Vec<f64>,
}

impl SimulatedContacts {
    /// The contacts of a plant at the signals of its machine.
    ///
    /// # Errors
    /// A contact names what the machine does not have, or a signal that no device shows.
    pub fn new(plant: &[PlantContact], machine: &Machine) -> Result<SimulatedContacts, SetupError> {
        let mut contacts = Vec::new();
        for (number, of) in plant.iter().enumerate() {
            let wrong = |what: String| SetupError(format!("[[contact]] {}: {what}", number + 1));
            let named = |name: &str| {
                let none = || wrong(format!("the machine file has no [[signal]] {name:?}"));
                machine.signal(name).ok_or_else(none)
            };
            let signal = named(&of.signal)?;
            let from = machine.signals.get(signal).map(|signal| &signal.from);
            if !from.is_some_and(machine::SignalSource::is_outside) {
                return Err(wrong(format!(
                    "signal {:?} has another source than a drive or terminal",
                    of.signal
                )));
            }
            contacts.push(Contact {
                signal,
                follows: of.follows.as_deref().map(named).transpose()?,
                axis: match &of.axis {
                    Some(name) => Some(machine.axis_index(name).map_err(wrong)? as usize),
                    None => None,
                },
                of: of.clone(),
                state: ContactState::default(),
            });
        }
        let defaults: Vec<f64> = machine
            .signals
            .iter()
            .map(|signal| signal.default)
            .collect();
        Ok(SimulatedContacts {
            contacts,
            scan_s: machine.scan_period_s(),
            scans: 0,
            commanded: defaults.clone(),
            shown: defaults.iter().copied().map(Some).collect(),
            defaults,
        })
    }

    /// What signals are commanded to show in this scan.
    pub fn command(&mut self, values: &[f64]) {
        for (slot, value) in self.commanded.iter_mut().zip(values) {
            *slot = *value;
        }
    }

    /// One scan, at whose end the axes are at these places, in mm.
    pub fn scan(&mut self, place_mm: impl Fn(usize) -> f64) {
        if self.defaults.is_empty() {
            return;
        }
        self.scans += 1;
        for (shown, default) in self.shown.iter_mut().zip(&self.defaults) {
            *shown = Some(*default);
        }
        for contact in &mut self.contacts {
            contact.step(self.scans, self.scan_s, &self.commanded, &place_mm);
            let Some(shown) = self.shown.get_mut(contact.signal) else {
                continue;
            };
            let before = shown.unwrap_or_default();
            if let Some(said) = contact.says(self.scans, self.scan_s, before) {
                *shown = said;
            }
        }
    }

    /// What the device of a signal shows; none while it is lost.
    pub fn shown(&self, signal: usize) -> Option<f64> {
        self.shown.get(signal).copied().flatten()
    }

    /// Bytes of its saved state.
    pub fn state_bytes(&self) -> usize {
        size_of::<u64>() + self.contacts.len() * size_of::<ContactState>()
    }

    /// Each part of the state, for saving it.
    pub fn save(&self, mut put: impl FnMut(&[u8])) {
        put(bytemuck::bytes_of(&self.scans));
        for contact in &self.contacts {
            put(bytemuck::bytes_of(&contact.state));
        }
    }

    /// Goes on from a saved state.
    ///
    /// # Errors
    /// The state is too short.
    pub fn restore(&mut self, bytes: &mut &[u8]) -> Result<(), StateRefused> {
        self.scans = taken(bytes)?;
        for contact in &mut self.contacts {
            contact.state = taken(bytes)?;
        }
        Ok(())
    }
}

impl Contact {
    /// Whether all that it follows is so.
    fn is_met(&self, time_s: f64, commanded: &[f64], place_mm: impl Fn(usize) -> f64) -> bool {
        let of = &self.of;
        let in_time = time_s >= of.at_s && of.until_s.is_none_or(|until_s| time_s < until_s);
        let follows = self.follows.and_then(|signal| commanded.get(signal));
        let is_on = follows.is_none_or(|value| *value != 0.0);
        let is_there = self.axis.is_none_or(|axis| {
            let place_mm = place_mm(axis);
            of.from_mm.is_none_or(|from| place_mm >= from)
                && of.to_mm.is_none_or(|to| place_mm <= to)
        });
        in_time && is_on && is_there
    }

    fn step(
        &mut self,
        scans: u64,
        scan_s: f64,
        commanded: &[f64],
        place_mm: impl Fn(usize) -> f64,
    ) {
        let met = self.is_met(scans as f64 * scan_s, commanded, place_mm);
        let state = &mut self.state;
        if met != (state.met == 1) {
            state.met = u32::from(met);
            state.changed = scans;
        }
        let delay_ms = if met {
            self.of.on_delay_ms
        } else {
            self.of.off_delay_ms
        };
        let waited_ms = scans.saturating_sub(state.changed) as f64 * scan_s * 1e3;
        if state.on != state.met && waited_ms >= delay_ms {
            state.on = state.met;
            state.switched = scans;
        }
    }

    /// What it says, if it says anything: a value, or that the device is lost. While it bounces, every other scan is as before.
    fn says(&self, scans: u64, scan_s: f64, before: f64) -> Option<Option<f64>> {
        let since = scans.saturating_sub(self.state.switched);
        let bounces = self.state.switched != 0
            && since % 2 == 1
            && since as f64 * scan_s * 1e3 < self.of.bounce_ms;
        let since_ms = since as f64 * scan_s * 1e3;
        let in_period = self.of.period_ms > 0.0;
        let off_half = in_period && since_ms % self.of.period_ms < self.of.period_ms / 2.0;
        let on = ((self.state.on == 1) != bounces) && !off_half;
        if !on {
            return None;
        }
        Some(if self.of.broken {
            None
        } else {
            Some(self.of.value.unwrap_or(1.0 - before))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINE: &str = include_str!("../../machines/xy/machine.toml");
    const SIGNALS: &str = r#"
[[signal]]
name = "pressure"
from = { terminal = 2, channel = 1 }
[[signal]]
name = "pump"
from = { state = "flood" }
[[signal]]
name = "end_of_x"
default = 1.0
from = { drive = "X", bit = 3 }
"#;

    fn machine() -> Machine {
        let name = "name = \"xy\"\n";
        let text = MACHINE.replacen(name, &format!("{name}{SIGNALS}"), 1);
        Machine::parse("machine.toml", &text).expect("a machine")
    }

    fn contact(signal: &str) -> PlantContact {
        PlantContact {
            signal: signal.into(),
            value: None,
            broken: false,
            follows: None,
            axis: None,
            from_mm: None,
            to_mm: None,
            at_s: 0.0,
            until_s: None,
            on_delay_ms: 0.0,
            off_delay_ms: 0.0,
            period_ms: 0.0,
            bounce_ms: 0.0,
        }
    }

    fn contacts(of: &[PlantContact]) -> SimulatedContacts {
        SimulatedContacts::new(of, &machine()).expect("contacts")
    }

    #[test]
    fn a_contact_follows_an_output_after_its_delays_and_bounces() {
        let of = PlantContact {
            follows: Some("pump".into()),
            on_delay_ms: 10.0,
            off_delay_ms: 5.0,
            bounce_ms: 3.0,
            ..contact("pressure")
        };
        let mut contacts = contacts(&[of]);
        let mut ones = Vec::new();
        for scan in 1..100 {
            contacts.command(&[0.0, f64::from(u8::from((30..60).contains(&scan))), 1.0]);
            contacts.scan(|_| 0.0);
            if contacts.shown(0) == Some(1.0) {
                ones.push(scan);
            }
        }
        let mut expected: Vec<i32> = (40..65).filter(|scan| *scan != 41).collect();
        expected.push(66);
        assert_eq!(ones, expected);
    }

    #[test]
    fn a_contact_is_where_its_axis_is_and_a_broken_wire_shows_nothing() {
        let ends = PlantContact {
            axis: Some("X".into()),
            from_mm: Some(105.0),
            ..contact("end_of_x")
        };
        let broken = PlantContact {
            broken: true,
            at_s: 0.003,
            ..contact("end_of_x")
        };
        let mut contacts = contacts(&[ends, broken]);
        contacts.scan(|_| 104.9);
        assert_eq!(contacts.shown(2), Some(1.0));
        contacts.scan(|_| 105.1);
        assert_eq!(contacts.shown(2), Some(0.0));
        contacts.scan(|_| 0.0);
        assert_eq!(contacts.shown(2), None);
    }

    #[test]
    fn a_contact_at_what_is_no_input_is_refused() {
        let wrong = |of: PlantContact| {
            let refused = SimulatedContacts::new(&[of], &machine());
            refused.expect_err("a contact that cannot be").to_string()
        };
        assert!(wrong(contact("pump")).contains("another source"));
        assert!(wrong(contact("nothing")).contains("no [[signal]] \"nothing\""));
        let at = PlantContact {
            axis: Some("Q".into()),
            ..contact("pressure")
        };
        assert!(wrong(at).contains("axis \"Q\""));
    }
}
