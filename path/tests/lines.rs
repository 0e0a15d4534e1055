//! Random lines: at every scan each slave within one increment of the exact line, no faster than its master.

use path::geometry::PATH_AXES;
use path::line::StraightLine;
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

use crate::size;

/// A fixed sequence, so that a failure names its line for good.
struct Random(SplitMix64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Evenly from 0 to `most`, both included.
    fn up_to(&mut self, most: u64) -> u64 {
        ((u128::from(self.next()) * (u128::from(most) + 1)) >> 64) as u64
    }

    /// A travel of either sign and any size up to 10 m at 1 nm, every order of magnitude as often.
    fn travel(&mut self) -> i64 {
        let most = 10_000_000_000u64 >> self.up_to(33);
        let size = self.up_to(most) as i64;
        if self.next() & 1 == 0 { size } else { -size }
    }
}

const LINES: [u64; 2] = [200_000, 1_000_000];
/// Scans of each line between its start and its end.
const SCANS: u64 = 12;

#[test]
fn on_any_line_no_axis_is_an_increment_off_at_any_scan() {
    let mut random = Random(SplitMix64::seed_from_u64(3_608_587));
    let mut slave_was_first = [false; PATH_AXES];
    for number in 0..size::number("LINES", LINES[0], LINES[1]) {
        let axes = 1 + random.up_to(PATH_AXES as u64 - 1) as usize;
        let (mut from, mut to) = ([0; PATH_AXES], [0; PATH_AXES]);
        for (from, to) in from.iter_mut().zip(&mut to).take(axes) {
            *from = random.travel() / 2;
            *to = *from + random.travel();
        }
        let line = StraightLine::new(from, to);
        let travel: [i64; PATH_AXES] = std::array::from_fn(|axis| to[axis] - from[axis]);
        let master = line.master;
        slave_was_first[master] = true;
        let whole = travel[master].unsigned_abs();
        assert!(travel.iter().all(|by| by.unsigned_abs() <= whole));

        let (mut at, mut before, mut step_before) = (0u64, from, [0i64; PATH_AXES]);
        let mut master_step_before = 0i64;
        for scan in 0..=SCANS {
            let step = if scan == SCANS {
                whole - at
            } else {
                // Unequal steps that together stay on the line, none of them smooth.
                random.up_to(2 * (whole - at) / (SCANS - scan + 1))
            };
            at += step;
            let master_step = step as i64;
            let place = line.at_master(from[master] + travel[master].signum() * at as i64);
            for axis in 0..axes {
                // (y − y_start)·Δx − x·Δy, the distance from the exact line times Δx.
                let of_axis = i128::from(place[axis] - from[axis]) * i128::from(whole);
                let off = of_axis - i128::from(at) * i128::from(travel[axis]);
                assert!(
                    off.unsigned_abs() < u128::from(whole.max(1)),
                    "line {number}, axis {axis}, scan {scan}: {off} of {whole}"
                );
                let moved = place[axis] - before[axis];
                assert!(
                    moved.abs() <= master_step,
                    "line {number}, axis {axis}, scan {scan}: {moved} against {master_step}"
                );
                let change = (moved - step_before[axis]).abs();
                let master_change = (master_step - master_step_before).abs();
                assert!(
                    change <= master_change + 1,
                    "line {number}, axis {axis}, scan {scan}: {change} against {master_change}"
                );
                step_before[axis] = moved;
            }
            before = place;
            master_step_before = master_step;
        }
        assert_eq!(before, to, "line {number}");
    }
    assert_eq!(slave_was_first, [true; PATH_AXES], "every axis was master");
}
