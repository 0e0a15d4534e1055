//! A vertical axis of 80 kg that nothing balances: whatever comes, at every instant of random programs and of switching on and off, it
//! drops no further than the closing time of its brake allows (docs/howto/vertical-axis.md).

use std::fmt::Write;

use bus::sample::{Job, Mode, Order, ProgramState, Refused};
use lab::staying::Cell;
use machine::{BrakeBy, DriveMode, Machine};
use master::Drives;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;

use crate::size;

/// Random programs of a run of this test, and in full: `SEEDS=200 STRIDE=1` for all instants, `FIRST=50` for others.
const SEEDS: [u64; 2] = [2, 6];
/// The vertical axis.
const Z: usize = 2;
/// Instants of a program that are passed over, and in full.
const STRIDE: [u64; 2] = [29, 7];
/// Time in which all has come to rest, in scans.
const SETTLES_SCANS: u64 = 160;
/// What the brake gives and what screw and friction let go when the torque is gone, in µm.
const ELASTIC_UM: f64 = 8.0;
/// An axis that has stood so long has been brought to rest, in scans: what the loop of its drive swings before is no drop.
const STOOD_SCANS: u32 = 50;
/// It stands, in mm/s.
const STANDS_MM_S: f64 = 0.5;
/// What the drive's loop lets the axis sag where it takes over, in µm.
const LOOP_UM: f64 = 8.0;

/// What comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comes {
    EmergencyStop,
    Trip,
    ServoKilled,
    MasterKilled,
    DriveFault,
    DriveOff,
}

const ALL: [Comes; 6] = [
    Comes::EmergencyStop,
    Comes::Trip,
    Comes::ServoKilled,
    Comes::MasterKilled,
    Comes::DriveFault,
    Comes::DriveOff,
];

/// The mill with a brake that this one opens.
fn mill(by: BrakeBy, mode: DriveMode) -> Cell {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
    let mut machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    machine.program.work_offset_mm.clear();
    machine
        .axes
        .iter_mut()
        .for_each(|axis| axis.standby = false);
    let axis = &mut machine.axes[Z];
    axis.brake.as_mut().expect("a brake").by = by;
    axis.drive_mode = mode;
    let mut cell = Cell::new(machine, plant);
    cell.lay("M2\n");
    cell.scans(5);
    cell
}

/// True place of the table, lowest and last of the scan, and speed of the motor, in mm and mm/s.
fn seen(cell: &Cell) -> (f64, f64, f64) {
    let drives = cell.master.drives();
    let mut places = drives.instruments(Z).iter().map(|of| of.table_mm);
    let lowest = places.clone().fold(f64::INFINITY, f64::min);
    let last = places.next_back().expect("a sample");
    (lowest, last, drives.feedback(Z).velocity_mm_s)
}

/// The axis as physics has it: mass in kg, weight and what the brake holds in N, closing time and scan in s.
struct Physics {
    mass_kg: f64,
    weight_n: f64,
    brake_n: f64,
    closing_s: f64,
    scan_s: f64,
    /// Moved mass over the gain of the drive's velocity loop, and the loop's integral time, in s.
    lag_s: f64,
    integral_s: f64,
    quick_stop_m_s2: f64,
    /// Travel in a radian of the motor, in m.
    radius_m: f64,
}

impl Physics {
    fn of(cell: &Cell) -> Physics {
        let plant = &cell.plant.axes[Z];
        let brake = plant.brake.expect("a brake");
        let axis = &cell.machine.axes[Z];
        let mass_kg = plant.motor_mass_kg() + plant.table.mass_kg;
        Physics {
            lag_s: mass_kg / axis.velocity_loop.gain_n_s_per_m,
            integral_s: axis.velocity_loop.integral_time_ms * 1e-3,
            quick_stop_m_s2: axis.quick_stop_mm_s2 * 1e-3,
            radius_m: plant.radius_m(),
            mass_kg,
            weight_n: plant.gravity.expect("weight").force_n,
            brake_n: brake.torque_nm / plant.radius_m(),
            closing_s: brake.closing_ms * 1e-3,
            scan_s: cell.machine.scan_period_s(),
        }
    }

    /// Where torque brakes it from a speed downwards, in µm: as hard as it may, after a scan and the lag of the loop, whose integral
    /// then lets go of the force that braked.
    fn brakes_um(&self, down_mm_s: f64) -> f64 {
        let v = down_mm_s.max(0.0) * 1e-3;
        let swing_m = self.quick_stop_m_s2 * self.lag_s * self.integral_s;
        let way_m = v * (self.scan_s + self.lag_s) + v * v / (2.0 * self.quick_stop_m_s2);
        (way_m + swing_m * (v / (self.quick_stop_m_s2 * self.integral_s)).min(1.0)) * 1e6
    }

    /// What the loop of a drive swings that takes over with this torque, in µm: its integral lets go of all but the weight.
    fn swings_um(&self, torque_nm: f64) -> f64 {
        let beyond_n = (torque_nm / self.radius_m - self.weight_n).abs();
        beyond_n / self.mass_kg * self.lag_s * self.integral_s * 1e6
    }

    /// Way down from a speed downwards, in µm: without torque and without friction until the brake holds, then braked by it.
    fn falls_um(&self, down_mm_s: f64) -> f64 {
        let (v, t) = (down_mm_s.max(0.0) * 1e-3, self.closing_s);
        let a = self.weight_n / self.mass_kg;
        let faster = v + a * t;
        let stops = (self.brake_n - self.weight_n) / self.mass_kg;
        (v * t + 0.5 * a * t * t + faster * faster / (2.0 * stops)) * 1e6
    }
}

/// Drop of the axis, and the largest that is allowed, in µm.
#[derive(Debug, Clone, Copy, Default)]
struct Drop {
    um: f64,
    allowed_um: f64,
}

/// It comes now; what the axis does then.
fn drop_after(before: &Cell, comes: Comes, physics: &Physics) -> Drop {
    let mut cell = before.clone();
    let (_, from_mm, speed_mm_s) = seen(&cell);
    let down_mm_s = (-speed_mm_s).max(0.0);
    let torque_nm = cell.master.drives().feedback(Z).torque_nm;
    match comes {
        Comes::EmergencyStop => assert_eq!(cell.order(Order::EmergencyStop), Refused::Not),
        Comes::Trip => cell.trips = Some(Z),
        Comes::ServoKilled => cell.dies(Job::Servo, Z),
        Comes::MasterKilled => cell.replace_master(),
        Comes::DriveFault => cell.master.drives().fault(Z),
        Comes::DriveOff => cell.master.drives().lose_power(Z),
    }
    let by = cell.machine.axes[Z].brake.map(|brake| brake.by);
    // A drive with a fault brakes first; one that does not close the brake itself then lets go.
    let fault_lets_go = comes == Comes::DriveFault && by == Some(BrakeBy::Controller);
    if comes == Comes::DriveOff || fault_lets_go {
        let mut lowest_mm = from_mm;
        for _ in 0..SETTLES_SCANS {
            cell.scan();
            lowest_mm = lowest_mm.min(seen(&cell).0);
        }
        // The scan that its power fails in is one in which it moves as before.
        let before_um = down_mm_s * physics.scan_s * 1e3;
        return Drop {
            um: (from_mm - lowest_mm) * 1e3,
            allowed_um: before_um
                + ELASTIC_UM
                + match comes {
                    Comes::DriveOff => physics.falls_um(down_mm_s),
                    _ => physics.falls_um(0.5) + physics.brakes_um(down_mm_s),
                },
        };
    }
    if comes == Comes::MasterKilled {
        // Its drives have braked by themselves meanwhile; from there it is to be held.
        cell.scans(SETTLES_SCANS);
        return Drop {
            um: (from_mm - seen(&cell).1) * 1e3,
            allowed_um: physics.brakes_um(down_mm_s) + physics.swings_um(torque_nm) + LOOP_UM,
        };
    }
    // Torque brakes it. From then on where it stands it is to be held.
    let stood = down_mm_s.max(speed_mm_s) <= STANDS_MM_S;
    let (mut stands, mut held_mm, mut dropped_mm) = (u32::from(stood) * STOOD_SCANS, None, 0.0_f64);
    for _ in 0..SETTLES_SCANS * 3 {
        cell.scan();
        let (lowest_mm, last_mm, speed_mm_s) = seen(&cell);
        let moves = cell.mode() != Mode::Disabled && cell.mode() != Mode::Tripped;
        stands = if speed_mm_s.abs() <= STANDS_MM_S {
            stands + 1
        } else {
            0
        };
        match held_mm {
            _ if moves => held_mm = None,
            Some(from) => dropped_mm = dropped_mm.max(from - lowest_mm),
            None if stands >= STOOD_SCANS => held_mm = Some(last_mm),
            None => {}
        }
    }
    Drop {
        um: dropped_mm * 1e3,
        allowed_um: LOOP_UM,
    }
}

/// The largest drops by what came, and those beyond what is allowed.
#[derive(Default)]
struct Tally {
    most: [Drop; ALL.len()],
    count: u64,
    beyond: Vec<String>,
}

impl Tally {
    fn take(&mut self, comes: Comes, drop: Drop, at: impl Fn() -> String) {
        self.count += 1;
        let most = &mut self.most[comes as usize];
        if drop.um > most.um {
            *most = drop;
        }
        // No number is beyond.
        let is_within = drop.um <= drop.allowed_um;
        if !is_within {
            self.beyond.push(format!(
                "{}: {comes:?}: dropped by {:.1} µm, {:.1} allowed",
                at(),
                drop.um,
                drop.allowed_um
            ));
        }
    }

    fn conclude(self, what: &str) {
        let mut words = format!("{what}: {} instants", self.count);
        for (comes, most) in ALL.iter().zip(&self.most) {
            let _ = write!(
                words,
                "\n  {comes:?}: {:.1} µm, {:.1} allowed",
                most.um, most.allowed_um
            );
        }
        println!("{words}");
        let count = self.beyond.len();
        let first: Vec<String> = self.beyond.into_iter().take(12).collect();
        assert!(first.is_empty(), "{count} of them:\n{}", first.join("\n"));
    }
}

/// A program of short moves, up and down and to the side, at any feed.
fn program(rng: &mut Rng) -> String {
    let mut text = String::from("G21 G90 G64\n");
    let mut z = -50.0_f64;
    for _ in 0..rng.within(3, 6) {
        z = (z + rng.between(-12.0, 12.0)).clamp(-80.0, -20.0);
        let (x, y) = (rng.between(235.0, 265.0), rng.between(185.0, 215.0));
        let feed = rng.between(300.0, 12_000.0);
        let _ = match rng.below(4) {
            0 => writeln!(text, "G0 Z{z:.3}"),
            1 => writeln!(text, "G1 Z{z:.3} F{feed:.0}"),
            2 => writeln!(text, "G1 X{x:.3} Y{y:.3} Z{z:.3} F{feed:.0}"),
            _ => writeln!(text, "G1 X{x:.3} F{feed:.0}\nG4 P0.02\nG1 Z{z:.3}"),
        };
    }
    text + "M2\n"
}

#[test]
fn at_every_instant_of_random_programs_it_drops_no_further_than_the_brake_allows() {
    let mut tally = Tally::default();
    let seeds = size::number("SEEDS", SEEDS[0], SEEDS[1]);
    let stride = size::number("STRIDE", STRIDE[0], STRIDE[1]);
    let first = size::number("FIRST", 0, 0);
    for seed in first..first + seeds {
        let mut rng = Rng::new(seed);
        let by = [BrakeBy::Drive, BrakeBy::Controller][(seed % 2) as usize];
        let mut cell = mill(by, DriveMode::Velocity);
        cell.ready();
        let physics = Physics::of(&cell);
        let text = program(&mut rng);
        cell.load_and_start(&text);
        let mut scan = 0;
        while cell.now.program != ProgramState::Done as u32 {
            cell.scan();
            scan += 1;
            assert!(scan < 60_000, "seed {seed} never ends: {:?}", cell.mode());
            if (scan + seed).is_multiple_of(stride) {
                let comes = ALL[(((scan + seed) / stride + seed) % ALL.len() as u64) as usize];
                let drop = drop_after(&cell, comes, &physics);
                tally.take(comes, drop, || {
                    format!("seed {seed}, scan {scan} of\n{text}")
                });
            }
        }
    }
    tally.conclude("programs");
}

#[test]
fn switched_off_and_on_and_interrupted_in_every_scan_it_drops_no_further_than_the_brake_allows() {
    let mut tally = Tally::default();
    let modes = [DriveMode::Velocity, DriveMode::Position];
    for (by, mode) in [BrakeBy::Drive, BrakeBy::Controller].into_iter().zip(modes) {
        let mut cell = mill(by, mode);
        let physics = Physics::of(&cell);
        let mut each = |cell: &mut Cell, scans: u64, what: &str| {
            let stood_mm = seen(cell).1;
            let mut lowest_mm = stood_mm;
            for scan in 0..scans {
                cell.scan();
                lowest_mm = lowest_mm.min(seen(cell).0);
                if !scan.is_multiple_of(size::number("CYCLE_STRIDE", 5, 1)) {
                    continue;
                }
                for comes in ALL {
                    let drop = drop_after(cell, comes, &physics);
                    tally.take(comes, drop, || format!("{by:?}, {what}, scan {scan}"));
                }
            }
            let drop_um = (stood_mm - lowest_mm) * 1e3;
            println!("{by:?}, {what}: {drop_um:.2} µm");
            assert!(drop_um <= LOOP_UM, "{by:?}, {what}: {drop_um} µm");
        };
        for turn in 0..2 {
            assert_eq!(cell.order(Order::Enable), Refused::Not);
            each(&mut cell, 120, &format!("turn {turn}, switched on"));
            assert_eq!(cell.mode(), Mode::Ready);
            assert_eq!(cell.order(Order::Disable), Refused::Not);
            each(&mut cell, 60, &format!("turn {turn}, switched off"));
            assert_eq!(cell.mode(), Mode::Disabled);
            // Called back while the brake closes.
            assert_eq!(cell.order(Order::Enable), Refused::Not);
            cell.scans(200);
            assert_eq!(cell.order(Order::Disable), Refused::Not);
            cell.scans(10 + 10 * turn);
            assert_eq!(cell.order(Order::Enable), Refused::Not);
            each(&mut cell, 120, &format!("turn {turn}, called back"));
            assert_eq!(cell.mode(), Mode::Ready);
            assert_eq!(cell.order(Order::Disable), Refused::Not);
            cell.scans(200);
        }
    }
    tally.conclude("switching on and off");
}
