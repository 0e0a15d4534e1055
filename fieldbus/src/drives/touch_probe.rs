//! The touch-probe unit of a drive (CiA 402 objects 60B8h to 60BDh): it latches the position at an edge of an input, or at the index of
//! the encoder, to the increment and whenever in the scan it comes.
//!
//! An edge is waited for once: the unit is asked, shows that it has latched, and is asked no more before the next time. What is stored
//! from an earlier time does not count.

use machine::ProbeEdge;

use crate::cia402;
use crate::field::Field;
use crate::process_data::{self, Pdo};

/// An edge that the unit can wait for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The index of the motor encoder ("zero impulse").
    Index,
    /// The input of the probe goes on.
    Rising,
    /// It goes off.
    Falling,
}

impl From<ProbeEdge> for Edge {
    fn from(edge: ProbeEdge) -> Edge {
        match edge {
            ProbeEdge::Rising => Edge::Rising,
            ProbeEdge::Falling => Edge::Falling,
        }
    }
}

/// One of the two latches of a unit.
#[derive(Debug, Clone, Copy)]
struct Latch {
    /// How far left its byte is in 60B8 and 60B9.
    shift: u32,
    /// Where it shows the position of a positive and of a negative edge.
    positions: [Option<Field>; 2],
    /// What it is asked for.
    asked: Option<Edge>,
    step: Step,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// It is asked for nothing, and may show what it stored before.
    Off,
    /// It waits for the edge.
    Waits,
    /// It has shown it.
    Done,
}

/// Bits of the byte of a latch: it is in use (60B8) and waits (60B9), the source is the index, and the edges.
const ENABLE: u16 = 1;
const AT_INDEX: u16 = 1 << 2;
const AT_EDGES: [u16; 2] = [1 << 4, 1 << 5];
const STORED: [u16; 2] = [1 << 1, 1 << 2];

impl Edge {
    /// Whether it is a negative edge.
    fn place(self) -> usize {
        usize::from(self == Edge::Falling)
    }
}

impl Latch {
    fn of(shift: u32, positions: [u16; 2], transmit: &[Pdo]) -> Latch {
        Latch {
            shift,
            positions: positions.map(|index| process_data::field(transmit, index, 0)),
            asked: None,
            step: Step::Off,
        }
    }

    fn has(&self, edge: Edge) -> bool {
        self.positions
            .get(edge.place())
            .is_some_and(Option::is_some)
    }

    /// Another edge is waited for from an unused unit on.
    fn ask(&mut self, wanted: Option<Edge>) {
        if wanted != self.asked {
            self.asked = wanted;
            self.step = Step::Off;
        }
    }

    fn function(&self) -> u16 {
        let Some(edge) = self.asked.filter(|_| self.step != Step::Off) else {
            return 0;
        };
        let source = if edge == Edge::Index { AT_INDEX } else { 0 };
        let at = AT_EDGES.get(edge.place()).copied().unwrap_or(0);
        (ENABLE | source | at) << self.shift
    }

    /// Takes what the unit shows: the position of an edge that came.
    fn take(&mut self, status: u16, own: &[u8]) -> Option<(Edge, i32)> {
        let status = status >> self.shift;
        let edge = self.asked?;
        let stored = STORED.get(edge.place()).copied().unwrap_or(0);
        match self.step {
            Step::Off if status & (ENABLE | stored) == 0 => self.step = Step::Waits,
            Step::Waits if status & stored != 0 => {
                self.step = Step::Done;
                let field = self.positions.get(edge.place()).copied().flatten()?;
                return Some((edge, field.read_signed(own)));
            }
            _ => {}
        }
        None
    }
}

/// The unit of one drive.
#[derive(Debug, Clone, Copy)]
pub struct TouchProbe {
    function: Field,
    status: Field,
    latches: [Latch; 2],
    /// The index is looked for whenever the probe is not.
    looks_for_index: bool,
}

impl TouchProbe {
    /// Of a drive that exchanges its objects; none where it lacks them.
    pub fn of(receive: &[Pdo], transmit: &[Pdo], looks_for_index: bool) -> Option<TouchProbe> {
        let objects = [
            [cia402::TOUCH_PROBE_1_RISING, cia402::TOUCH_PROBE_1_FALLING],
            [cia402::TOUCH_PROBE_2_RISING, cia402::TOUCH_PROBE_2_FALLING],
        ];
        let [first, second] = objects;
        Some(TouchProbe {
            function: process_data::field(receive, cia402::TOUCH_PROBE_FUNCTION, 0)?,
            status: process_data::field(transmit, cia402::TOUCH_PROBE_STATUS, 0)?,
            latches: [
                Latch::of(0, first, transmit),
                Latch::of(8, second, transmit),
            ],
            looks_for_index,
        })
    }

    /// Whether it can latch at this edge: the probe is at its first input, the index with either latch.
    pub fn can(&self, edge: Edge) -> bool {
        let [first, second] = &self.latches;
        first.has(edge) || edge == Edge::Index && second.has(edge)
    }

    /// What the drive is sent; `probe` is the edge of the probe that is waited for. The index goes to the latch that the probe has not.
    pub fn command(&mut self, probe: Option<Edge>, own: &mut [u8]) {
        let index = self.looks_for_index.then_some(Edge::Index);
        let [first, second] = &mut self.latches;
        let apart = second.has(Edge::Index);
        let probe = probe.filter(|edge| first.has(*edge));
        first.ask(probe.or(index.filter(|_| !apart)));
        second.ask(index.filter(|_| apart));
        let function = first.function() | second.function();
        self.function.write(own, function.into());
    }

    /// Takes what the drive shows: the edges that came, each with the position that was latched.
    pub fn take(&mut self, own: &[u8]) -> impl Iterator<Item = (Edge, i32)> {
        let status = self.status.read(own) as u16;
        let came = self.latches.each_mut().map(|latch| {
            let came = latch.take(status, own);
            // The next index is another one.
            if latch.step == Step::Done && latch.asked == Some(Edge::Index) {
                latch.step = Step::Off;
            }
            came
        });
        came.into_iter().flatten()
    }

    /// The drive was lost: what it was asked for it may have forgotten.
    pub fn lose(&mut self) {
        for latch in &mut self.latches {
            latch.step = Step::Off;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process_data::Entry;

    fn pdo(index: u16, objects: &[(u16, u32)]) -> Vec<Pdo> {
        let entries = objects.iter().map(|(of, bits)| Entry::of(*of, 0, *bits));
        let entries = entries.collect();
        vec![Pdo { index, entries }]
    }

    /// A unit whose drive shows 60B9, 60BA, 60BB and 60BC in this order.
    fn unit(looks_for_index: bool) -> TouchProbe {
        let shown = [(0x60B9, 16), (0x60BA, 32), (0x60BB, 32), (0x60BC, 32)];
        let receive = pdo(0x1600, &[(0x60B8, 16)]);
        TouchProbe::of(&receive, &pdo(0x1A00, &shown), looks_for_index).expect("a unit")
    }

    /// One cycle: what it is sent, then what it makes of what it shows.
    fn cycle(unit: &mut TouchProbe, probe: Option<Edge>, status: u16) -> (u16, Vec<(Edge, i32)>) {
        let mut own = [0; 2];
        unit.command(probe, &mut own);
        let mut shown = status.to_le_bytes().to_vec();
        for place in [-11_i32, 22, 33] {
            shown.extend(place.to_le_bytes());
        }
        (u16::from_le_bytes(own), unit.take(&shown).collect())
    }

    #[test]
    fn an_edge_of_the_probe_is_told_once_for_each_time_that_it_is_watched() {
        let mut unit = unit(false);
        let rising = Some(Edge::Rising);
        // What is stored from before is taken off first.
        assert_eq!(cycle(&mut unit, rising, 0x0003), (0, vec![]));
        assert_eq!(cycle(&mut unit, rising, 0), (0, vec![]));
        assert_eq!(cycle(&mut unit, rising, 0), (0x0011, vec![]));
        assert_eq!(cycle(&mut unit, rising, 1), (0x0011, vec![]));
        let came = vec![(Edge::Rising, -11)];
        assert_eq!(cycle(&mut unit, rising, 3), (0x0011, came));
        assert_eq!(cycle(&mut unit, rising, 3), (0x0011, vec![]));
        assert_eq!(cycle(&mut unit, None, 3), (0, vec![]));
        // The other edge, by its own bits.
        let falling = Some(Edge::Falling);
        cycle(&mut unit, falling, 0);
        assert_eq!(cycle(&mut unit, falling, 1), (0x0021, vec![]));
        let came = vec![(Edge::Falling, 22)];
        assert_eq!(cycle(&mut unit, falling, 5), (0x0021, came));
    }

    #[test]
    fn the_index_is_told_each_time_that_it_passes_beside_a_probe_that_is_watched() {
        let mut unit = unit(true);
        cycle(&mut unit, Some(Edge::Rising), 0);
        assert_eq!(cycle(&mut unit, Some(Edge::Rising), 0x0101).0, 0x1511);
        for _ in 0..3 {
            let came = vec![(Edge::Index, 33)];
            assert_eq!(cycle(&mut unit, Some(Edge::Rising), 0x0301), (0x1511, came));
            assert_eq!(
                cycle(&mut unit, Some(Edge::Rising), 0x0301),
                (0x0011, vec![])
            );
            assert_eq!(
                cycle(&mut unit, Some(Edge::Rising), 0x0001),
                (0x0011, vec![])
            );
            assert_eq!(
                cycle(&mut unit, Some(Edge::Rising), 0x0101),
                (0x1511, vec![])
            );
        }
        // A drive that came back may have forgotten.
        unit.lose();
        assert_eq!(cycle(&mut unit, Some(Edge::Rising), 0).0, 0);
    }

    #[test]
    fn a_unit_with_one_latch_looks_for_the_index_with_it_unless_the_probe_is_watched() {
        let shown = [(0x60B9, 16), (0x60BA, 32)];
        let receive = pdo(0x1600, &[(0x60B8, 16)]);
        let mut unit = TouchProbe::of(&receive, &pdo(0x1A00, &shown), true).expect("a unit");
        assert!(unit.can(Edge::Rising) && unit.can(Edge::Index) && !unit.can(Edge::Falling));
        cycle(&mut unit, None, 0);
        assert_eq!(cycle(&mut unit, None, 0).0, 0x0015);
        assert_eq!(cycle(&mut unit, Some(Edge::Rising), 1).0, 0);
        cycle(&mut unit, Some(Edge::Rising), 0);
        assert_eq!(cycle(&mut unit, Some(Edge::Rising), 0).0, 0x0011);
        assert!(TouchProbe::of(&[], &pdo(0x1A00, &shown), true).is_none());
    }
}
