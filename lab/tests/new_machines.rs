//! `quadrant new machine` for whatever axes people have: what they say of them is written, checks, homes, jogs and runs its first
//! program. Only numbers that were given and contradict each other are refused, and what the refusal says is right is taken.

use std::fs;

use bus::sample::{Cause, Feedback, Mode, OperatorRequest, Order, Reference, Refused};
use console::exit::Failure;
use lab::cell::InProcessCell;
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;
use tune::options::NewMachineOptions;

use crate::size;

/// A machine as it was written, with its first program.
struct Written {
    machine: Machine,
    plant: PlantFile,
    program: String,
}

/// Writes a machine of these axes as `quadrant new machine` does, which checks it; or what it says against them.
fn written(axes: &[String], scan_us: u32) -> Result<Written, String> {
    let home = tempfile::tempdir().expect("a folder");
    let folder = home.path().join("mine");
    let options = NewMachineOptions {
        folder: folder.clone(),
        axis: axes.to_vec(),
        name: None,
        scan_us,
    };
    match tune::new_machine::new_machine(&options) {
        Ok(()) => Ok(Written {
            machine: Machine::load(&folder).expect("machine.toml"),
            plant: PlantFile::load(&folder.join("plant.toml")).expect("plant.toml"),
            program: fs::read_to_string(folder.join("programs/first.ngc")).expect("first.ngc"),
        }),
        Err(Failure::Input(why)) => Err(format!("{why:#}")),
        Err(other) => panic!("{axes:?}: {other:?}"),
    }
}

/// A number between two, each decade as likely as the other, as people write it.
fn about(random: &mut Rng, low: f64, high: f64) -> String {
    let value = random.between(low.ln(), high.ln()).exp();
    let places = (1.0 - value.log10().floor()).max(0.0) as usize;
    format!("{value:.places$}")
}

/// Something, or nothing, as likely as each other.
fn perhaps(random: &mut Rng, key: &str, low: f64, high: f64) -> String {
    if random.one_in(2) {
        return String::new();
    }
    format!(",{key}={}", about(random, low, high))
}

/// An axis that somebody has.
fn axis(random: &mut Rng, letter: &str, longest: f64) -> String {
    let rotary = letter == "A";
    let mut text = format!("{letter}:travel={}", travel(random, rotary, longest));
    text += &match (rotary, random.below(5)) {
        (true, 0) | (false, 0) => String::new(),
        (true, _) => format!(",gear={}", about(random, 1.0, 360.0)),
        (false, 1 | 2) => format!(",lead={}", about(random, 2.0, 50.0)),
        (false, 3) => format!(
            ",rack={}x{}{}",
            random.pick(&[1.0, 1.5, 2.0, 3.0, 4.0]).expect("a module"),
            random.within(15, 40),
            perhaps(random, "ratio", 1.0, 30.0)
        ),
        (false, _) => format!(
            ",belt={}x{}{}",
            random.pick(&[3, 5, 8, 10]).expect("a pitch"),
            random.within(12, 48),
            perhaps(random, "ratio", 1.0, 20.0)
        ),
    };
    text += &match rotary {
        true => perhaps(random, "inertia", 0.01, 50.0),
        false => perhaps(random, "mass", 1.0, 3000.0),
    };
    if !rotary && random.one_in(3) {
        text += ",motors=2";
    }
    if !text.contains("endless") && random.one_in(2) {
        text += ",encoder=incremental";
    }
    text
}

fn travel(random: &mut Rng, rotary: bool, longest: f64) -> String {
    if rotary && random.one_in(4) {
        return "endless".into();
    }
    let length: f64 = about(random, 3.0, longest).parse().expect("a number");
    let low = *random.pick(&[0.0, -0.5, -1.0]).expect("a place") * length;
    format!("{low}..{}", low + length)
}

/// Adds one of the numbers that the others have to fit, or none.
fn with_one_more(random: &mut Rng, axis: &str) -> String {
    let rotary = axis.starts_with('A');
    axis.to_string()
        + &match random.below(4) {
            0 => String::new(),
            1 => format!(",speed={}", about(random, 2.0, 1500.0)),
            2 if rotary => format!(",acceleration={}", about(random, 20.0, 5000.0)),
            2 => format!(",acceleration={}", about(random, 20.0, 20_000.0)),
            _ => format!(",torque={}", about(random, 0.1, 100.0)),
        }
}

/// Takes the number that a refusal says is right: `KEY=VALUE: … at most RIGHT with …`.
fn corrected(axis: &str, why: &str) -> Option<String> {
    let (before, after) = why.split_once(": at most ").or_else(|| {
        let (before, after) = why.rsplit_once(" at most ")?;
        Some((before, after))
    })?;
    let right = after.split_once(" with ")?.0;
    let pair = before
        .rsplit(": ")
        .find(|part| part.starts_with("acceleration=") || part.starts_with("friction="))?;
    let (key, value) = pair.split_once('=')?;
    let found = format!("{key}={value}");
    axis.contains(&found)
        .then(|| axis.replace(&found, &format!("{key}={right}")))
}

#[test]
fn an_axis_with_a_screw_of_4_5_or_6_mm_is_written() {
    for lead in [2, 4, 5, 6, 8, 10, 16, 20, 25, 32, 40, 50] {
        for more in ["", ",motors=2", ",encoder=incremental"] {
            let axis = format!("X:travel=0..300,lead={lead}{more}");
            let why = written(std::slice::from_ref(&axis), 1000).err();
            assert_eq!(why, None, "{axis}");
        }
    }
}

#[test]
fn an_endless_axis_with_an_incremental_encoder_is_refused_and_what_is_said_to_be_right_is_written()
{
    let axis = "A:travel=endless,gear=10,encoder=incremental".to_string();
    let why = written(std::slice::from_ref(&axis), 1000)
        .err()
        .expect("a refusal");
    assert!(
        why.contains("leave it out") && why.contains("travel=-180..180"),
        "{why}"
    );
    for right in [
        axis.replace(",encoder=incremental", ""),
        axis.replace("endless", "-180..180"),
    ] {
        assert_eq!(
            written(std::slice::from_ref(&right), 1000).err(),
            None,
            "{right}"
        );
    }
}

#[test]
fn whatever_is_said_of_an_axis_and_one_of_speed_acceleration_and_torque_is_written_and_checks() {
    for seed in 0..size::number("SEEDS", 100, 400) {
        let mut random = Rng::new(seed);
        let letter = *random.pick(&["X", "Y", "Z", "A"]).expect("a letter");
        let axis = axis(&mut random, letter, 3000.0);
        let axis = with_one_more(&mut random, &axis);
        let scan_us = *random.pick(&[250, 1000, 2000]).expect("a period");
        let Err(why) = written(std::slice::from_ref(&axis), scan_us) else {
            continue;
        };
        // A way in a turn of the motor that was given may be too small for an acceleration that was given.
        let given = ["lead=", "rack=", "belt=", "gear="]
            .iter()
            .any(|key| axis.contains(key));
        assert!(
            given && axis.contains("acceleration="),
            "seed {seed}: {axis}: {why}"
        );
        let right = corrected(&axis, &why).unwrap_or_else(|| panic!("seed {seed}: {why}"));
        let why = written(std::slice::from_ref(&right), scan_us).err();
        assert_eq!(why, None, "seed {seed}: {right} instead of {axis}");
    }
}

#[test]
fn what_is_refused_contradicts_itself_and_is_written_with_what_is_said_to_be_right() {
    let mut refused = 0;
    for seed in 0..size::number("SEEDS", 100, 400) {
        let mut random = Rng::new(1_000 + seed);
        let letter = *random.pick(&["X", "A"]).expect("a letter");
        let mut axis = axis(&mut random, letter, 3000.0);
        for (key, low, high) in [
            ("speed", 2.0, 1500.0),
            ("acceleration", 20.0, 50_000.0),
            ("torque", 0.1, 100.0),
            ("friction", 1.0, 3000.0),
        ] {
            axis += &perhaps(&mut random, key, low, high);
        }
        let mut asked = axis.clone();
        for _ in 0..3 {
            let Err(why) = written(std::slice::from_ref(&asked), 1000) else {
                break;
            };
            refused += 1;
            asked = corrected(&asked, &why).unwrap_or_else(|| panic!("seed {seed}: {axis}: {why}"));
        }
        let why = written(std::slice::from_ref(&asked), 1000).err();
        assert_eq!(why, None, "seed {seed}: {asked} instead of {axis}");
    }
    assert!(refused > 5, "{refused}");
}

/// What an operator does with a new machine: homes it, jogs each axis there and back, runs its first program.
struct Bench {
    cell: InProcessCell,
    machine: Machine,
    now: Feedback,
    axes: String,
}

impl Bench {
    fn of(axes: &[&str]) -> Bench {
        let said: Vec<String> = axes.iter().map(|axis| (*axis).to_string()).collect();
        let Written {
            machine,
            plant,
            program,
        } = written(&said, 1000).unwrap_or_else(|why| panic!("{axes:?}: {why}"));
        let cell = InProcessCell::new(&machine, &plant, "first.ngc", &program);
        Bench {
            cell: cell.expect("a cell"),
            machine,
            now: bytemuck::Zeroable::zeroed(),
            axes: format!("{axes:?}"),
        }
    }

    fn scan(&mut self) -> bool {
        let published = self.cell.scan();
        if let Some(published) = &published {
            self.now = *published.feedback;
        }
        let cause = Cause::from_wire(self.now.cause);
        let axis = self.machine.axis_name(self.now.cause_axis as usize);
        let (scan, axes) = (self.now.scan, &self.axes);
        assert_eq!(
            cause,
            Some(Cause::None),
            "{axes}: axis {axis} in scan {scan}"
        );
        assert!(scan < 600_000, "{axes}: it never ends");
        published.is_some()
    }

    fn scans(&mut self, count: u64) {
        for _ in 0..count {
            assert!(self.scan(), "{}: the run has ended", self.axes);
        }
    }

    /// Once an order of the operator is taken, until nothing moves by hand.
    fn by_hand(&mut self, order: Order, axis: u32, value: f64) {
        self.scans(200);
        let request = OperatorRequest {
            order: order as u32,
            axis,
            value,
            ..OperatorRequest::default()
        };
        let refused = Refused::from_wire(self.cell.order(&request).reason);
        assert_eq!(
            refused,
            Some(Refused::Not),
            "{}: {order:?} {axis}",
            self.axes
        );
        self.scans(2);
        while self.now.mode == Mode::Jogging as u32 {
            self.scans(1);
        }
    }

    fn place(&self, axis: usize) -> f64 {
        self.now.axes[axis].command_position as f64 * self.machine.axes[axis].increment_mm()
    }

    fn homes_jogs_and_runs(mut self) {
        self.scans(1);
        if self.now.hold == 0 {
            let request = OperatorRequest::of(Order::Hold);
            assert_eq!(self.cell.order(&request).accepted, 1, "{}", self.axes);
            self.scans(300);
        }
        let homes = self.machine.axes.iter().any(|axis| axis.homing.is_some());
        if homes {
            self.by_hand(Order::Home, 0, 0.0);
        }
        for index in 0..self.machine.program_axes().len() {
            let known = self.now.axes[index].reference;
            assert_eq!(known, Reference::Known as u32, "{}: {index}", self.axes);
            let axis = &self.machine.axes[index];
            let (low, high) = (axis.travel_min_mm, axis.travel_max_mm);
            let way = (0.1 * (high - low)).min(3.0);
            let inwards = if self.place(index) > 0.5 * (low + high) {
                -way
            } else {
                way
            };
            for way in [inwards, -0.9 * inwards] {
                let from = self.place(index);
                self.by_hand(Order::Jog, index as u32, way);
                let off = self.place(index) - from - way;
                // To the increment.
                let increment_mm = self.machine.axes[index].increment_mm();
                assert!(
                    off.abs() <= 0.51 * increment_mm,
                    "{}: axis {index} by {way}: {off} off",
                    self.axes
                );
            }
        }
        self.scans(200);
        let request = OperatorRequest::of(Order::Resume);
        assert_eq!(self.cell.order(&request).accepted, 1, "{}", self.axes);
        while self.scan() {}
        assert_eq!(self.now.mode, Mode::Finished as u32, "{}", self.axes);
    }
}

#[test]
fn machines_that_people_have_home_jog_and_run_their_first_program_as_written() {
    let machines: [&[&str]; 14] = [
        // Screws that people have.
        &[
            "X:travel=0..300,lead=5,encoder=incremental",
            "Y:travel=-100..100,lead=4",
            "Z:travel=-80..0,lead=6,encoder=incremental",
        ],
        &[
            "X:travel=-60..0,lead=2,mass=20,motors=2,encoder=incremental",
            "Z:travel=-40..0,lead=2.5,mass=8",
        ],
        &[
            "X:travel=0..300,lead=50,mass=20",
            "Y:travel=0..300,lead=5,mass=3000",
        ],
        // A motor that is there, weak or strong.
        &[
            "X:travel=0..300,torque=0.1",
            "Y:travel=0..300,lead=5,torque=0.3,mass=500",
            "A:travel=-90..90,torque=0.2",
        ],
        &[
            "X:travel=0..300,lead=5,torque=60,encoder=incremental",
            "Y:travel=0..300,belt=5x24,torque=30,mass=4",
        ],
        // Fast and slow.
        &[
            "X:travel=0..900,speed=1500",
            "Y:travel=0..900,speed=800,acceleration=15000",
            "A:travel=endless,acceleration=4000",
        ],
        &[
            "X:travel=0..20,speed=20",
            "Y:travel=0..20,lead=5,acceleration=20",
            "Z:travel=-4..0,speed=10,encoder=incremental",
        ],
        // Travels of few turns of the motor.
        &[
            "X:travel=0..3,lead=10,encoder=incremental",
            "Y:travel=-5..5,rack=2x20,ratio=4,encoder=incremental",
            "A:travel=-3..3,gear=20,encoder=incremental",
        ],
        &[
            "X:travel=0..30,rack=3x25,ratio=5,motors=2,encoder=incremental",
            "Z:travel=-5..0,lead=5,encoder=incremental",
        ],
        // Tables.
        &[
            "A:travel=-90..90,gear=360,encoder=incremental",
            "B:travel=endless,gear=10",
            "C:travel=-10..10,gear=10,inertia=20",
        ],
        // Racks and belts.
        &[
            "X:travel=0..2000,rack=4x40,ratio=10,mass=800,motors=2",
            "Y:travel=0..800,belt=10x48,ratio=8,mass=1",
            "Z:travel=-100..0,belt=3x12,ratio=20",
        ],
        // Without a gear: much way in a turn of the motor, and so in a count of its encoder.
        &[
            "X:travel=0..1500,rack=2x20,mass=60",
            "Y:travel=0..800,belt=5x40,mass=10",
            "A:travel=-180..180,gear=1",
        ],
        &[
            "X:travel=0..1500,belt=10x48,mass=20,motors=2,encoder=incremental",
            "A:travel=endless,gear=1",
        ],
        // Slow.
        &["X:travel=0..20,speed=2", "Y:travel=-10..0,speed=2,lead=20"],
    ];
    for axes in size::one_in(3, machines) {
        Bench::of(axes).homes_jogs_and_runs();
    }
}

#[test]
fn machines_of_any_numbers_home_jog_and_run_their_first_program_as_written() {
    for seed in 0..size::number("SEEDS", 3, 8) {
        let mut random = Rng::new(5_000 + seed);
        let said = ["X", "Y", "A"].map(|letter| {
            loop {
                let axis = axis(&mut random, letter, 200.0);
                let axis = with_one_more(&mut random, &axis);
                // A search over a long travel at a low speed takes hours.
                let slow = axis.contains("speed=");
                if !slow && written(std::slice::from_ref(&axis), 1000).is_ok() {
                    break axis;
                }
            }
        });
        Bench::of(&said.each_ref().map(String::as_str)).homes_jogs_and_runs();
    }
}
