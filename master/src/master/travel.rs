//! Pulses by travel, such as of a lube pump: one when an axis moves first, then one each time it has gone so far.

use machine::{Machine, Signal};

/// A step of a scan that is so many times what the axis may travel in it is no motion: it was homed.
const STEPS_OF_RAPID: f64 = 2.0;

/// Pulses of one signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pulse {
    /// The signal.
    pub signal: usize,
    axis: usize,
    every_mm: f64,
    for_scans: u64,
    step_max_mm: f64,
    at_mm: Option<f64>,
    gone_mm: f64,
    left_scans: u64,
}

impl Pulse {
    /// Pulses of a signal by travel; none for a signal with another source.
    pub fn of(machine: &Machine, signal: usize, of: &Signal) -> Option<Pulse> {
        let from = &of.from;
        let axis = machine.axis_index(from.travel.as_ref()?).ok()? as usize;
        let settings = machine.axes.get(axis)?;
        let (scan_s, every_mm) = (machine.scan_period_s(), from.every_m? * 1e3);
        Some(Pulse {
            signal,
            axis,
            every_mm,
            for_scans: libm::ceil(from.for_ms? * 1e-3 / scan_s) as u64,
            step_max_mm: STEPS_OF_RAPID * settings.rapid_mm_s * scan_s,
            at_mm: None,
            // Nobody knows how long the machine was off.
            gone_mm: every_mm,
            left_scans: 0,
        })
    }

    /// One scan, with the place of each axis; none while it is not driven.
    pub fn step(&mut self, place_mm: impl Fn(usize) -> Option<f64>) {
        self.left_scans = self.left_scans.saturating_sub(1);
        let now_mm = place_mm(self.axis);
        let before_mm = std::mem::replace(&mut self.at_mm, now_mm);
        let step_mm = now_mm
            .zip(before_mm)
            .map_or(0.0, |(now, before)| (now - before).abs());
        if step_mm == 0.0 || step_mm > self.step_max_mm {
            return;
        }
        self.gone_mm += step_mm;
        if self.gone_mm >= self.every_mm {
            self.gone_mm = 0.0;
            self.left_scans = self.for_scans;
        }
    }

    pub fn is_on(&self) -> bool {
        self.left_scans > 0
    }

    /// What must outlive this master, in mm: a pulse that was cut off comes again.
    pub fn kept_mm(&self) -> f64 {
        if self.is_on() {
            self.every_mm
        } else {
            self.gone_mm
        }
    }

    /// Goes on where a master before this one left.
    pub fn resume(&mut self, kept_mm: f64) {
        self.gone_mm = kept_mm;
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, clippy::unwrap_used)]
mod tests {
    use super::*;

    fn pulse() -> Pulse {
        let lube = "name = \"xy\"\n[[signal]]\nname = \"lube\"\nfrom = { travel = \"X\", every_m = 0.05, for_ms = 20 }\n";
        let text = include_str!("../../../machines/xy/machine.toml");
        let machine = Machine::parse("machine.toml", &text.replacen("name = \"xy\"\n", lube, 1));
        let machine = machine.expect("a machine");
        Pulse::of(&machine, 0, &machine.signals[0]).expect("pulses")
    }

    #[test]
    fn it_comes_with_the_first_motion_and_then_each_so_many_millimetres_whoever_dies() {
        let mut pulse = pulse();
        let mut on = Vec::new();
        let mut scan = |pulse: &mut Pulse, place: Option<f64>| {
            pulse.step(|_| place);
            on.push(pulse.is_on());
        };
        (0..5).for_each(|_| scan(&mut pulse, Some(7.0)));
        for step in 1..=1_000 {
            // To and fro: it is the way that counts, 0.1 mm a scan.
            let there = step % 2;
            scan(&mut pulse, Some(7.0 + 0.1 * f64::from(there)));
        }
        let begins: Vec<usize> = (1..on.len()).filter(|&at| on[at] && !on[at - 1]).collect();
        assert_eq!(begins.len(), 2, "{begins:?}");
        assert_eq!(begins[0], 5);
        assert!((begins[1] - 5).abs_diff(500) <= 1, "{begins:?}");
        assert_eq!(on.iter().filter(|on| **on).count(), 40);
        // Homed, switched off, moved by somebody: no way of its own.
        let gone_mm = pulse.gone_mm;
        for place in [Some(500.0), None, Some(3.0)] {
            pulse.step(|_| place);
        }
        assert_eq!(pulse.gone_mm, gone_mm);
        let mut next = self::pulse();
        next.resume(pulse.kept_mm());
        assert_eq!(next.gone_mm, gone_mm);
    }
}
