//! A limit switch that is hit at any speed up to rapid: the axis rests within its braking distance, and afterwards nothing moves it but
//! the way off the switch.

use bus::sample::{Cause, Mode, OperatorRequest, Order, Refused};
use lab::staying::Cell;
use lab::stock::switch;
use machine::{LimitSwitches, SignalSource};
use master::Drives;
use plant_sim::plant_file::PlantContact;
use plant_sim::script::rng::Rng;

use crate::common::{axis_order, load};
use crate::size;

const MACHINES: [&str; 5] = ["xy", "xy-fast", "xy-torque", "xyz-mill", "xz-lathe"];
/// Hits of each end of each axis, and in full.
const HITS: [u64; 2] = [2, 40];
/// Scans from the switch to the first braking setpoint.
const SEEN_SCANS: f64 = 2.0;
/// What a loop lets the axis swing over where it has come to rest, in mm.
const SWING_MM: f64 = 0.05;

/// A machine with a switch at an end of an axis, which begins at a distance from it.
fn cell(name: &str, axis: usize, outwards: f64, switch_mm: f64, start_mm: f64) -> Cell {
    let (mut machine, mut plant) = load(name);
    let letter = machine.axes[axis].name.clone();
    let from = SignalSource {
        drive: Some(letter.clone()),
        bit: Some(0),
        ..SignalSource::default()
    };
    machine.signals.push(switch("end", from));
    let end = Some("end".to_string());
    machine.axes[axis].limit_switches = Some(match outwards > 0.0 {
        true => LimitSwitches {
            positive: end,
            negative: None,
        },
        false => LimitSwitches {
            positive: None,
            negative: end,
        },
    });
    plant.contacts.push(PlantContact {
        signal: "end".into(),
        value: None,
        broken: false,
        follows: None,
        axis: Some(letter.clone()),
        from_mm: (outwards > 0.0).then_some(switch_mm),
        to_mm: (outwards < 0.0).then_some(switch_mm),
        at_s: 0.0,
        until_s: None,
        on_delay_ms: 0.0,
        off_delay_ms: 0.0,
        period_ms: 0.0,
        bounce_ms: 3.0,
    });
    let of_plant = plant.axes.iter_mut().find(|of| of.name == letter);
    of_plant.expect("its plant").start_position_mm = start_mm;
    Cell::new(machine, plant)
}

/// True place of the motor and its speed.
fn seen(cell: &Cell, axis: usize) -> (f64, f64) {
    let drives = cell.master.drives();
    let last = drives.instruments(axis).last().expect("a sample");
    (last.motor_mm, drives.feedback(axis).velocity_mm_s)
}

/// Runs into the switch; speed there, way beyond it and what physics allows, in mm.
fn hit(cell: &mut Cell, axis: usize, outwards: f64, switch_mm: f64) -> (f64, f64, f64) {
    cell.ready_and_homed();
    let axis_of = &cell.machine.axes[axis];
    let letter = axis_of.name.chars().next().expect("a letter");
    let end_mm = match outwards > 0.0 {
        true => axis_of.travel_max_mm,
        false => axis_of.travel_min_mm,
    };
    let text = format!("G21 G90 G53 G0 {letter}{end_mm}\nM2\n");
    cell.load_and_start(&text);
    let beyond = |cell: &Cell| (seen(cell, axis).0 - switch_mm) * outwards;
    assert!(cell.until(20_000, |of| beyond(of) >= 0.0), "it gets there");
    // One that speeds up there gets faster until the switch has been seen.
    let (mut speed, mut most_mm) = (0.0_f64, 0.0_f64);
    for _ in 0..400 {
        speed = speed.max(seen(cell, axis).1 * outwards);
        most_mm = most_mm.max(beyond(cell));
        cell.scan();
    }
    assert_eq!(cell.mode(), Mode::Tripped);
    assert_eq!(
        (cell.cause(), cell.now.cause_axis),
        (Cause::LimitSwitch, axis as u32)
    );
    let settings = &cell.machine.axes[axis];
    let plant = cell.plant.axes.iter().find(|of| of.name == settings.name);
    let plant = plant.expect("its plant");
    let mass_kg = plant.motor_mass_kg() + plant.table.mass_kg;
    let lag_s = mass_kg / settings.velocity_loop.gain_n_s_per_m;
    let scans_s = SEEN_SCANS * cell.machine.scan_period_s();
    let allowed_mm = speed * (scans_s + lag_s) + speed * speed / (2.0 * settings.quick_stop_mm_s2);
    (speed, most_mm, allowed_mm + SWING_MM)
}

#[test]
fn at_any_speed_up_to_rapid_it_rests_within_its_braking_distance_and_goes_only_off_the_switch() {
    let hits = size::number("HITS", HITS[0], HITS[1]);
    let (mut count, mut nearest, mut wrong) = (0, 0.0_f64, Vec::new());
    for (number, name) in MACHINES.into_iter().enumerate() {
        let (machine, _) = load(name);
        for (axis, settings) in machine.axes.iter().enumerate() {
            for outwards in [1.0, -1.0] {
                let mut rng =
                    Rng::new(1_000 * number as u64 + 10 * axis as u64 + (outwards > 0.0) as u64);
                for _ in 0..hits {
                    let span = settings.travel_max_mm - settings.travel_min_mm;
                    let end = match outwards > 0.0 {
                        true => settings.travel_max_mm,
                        false => settings.travel_min_mm,
                    };
                    // From a crawl to rapid: the way before it is short or long.
                    let switch_mm = end - outwards * span * rng.between(0.15, 0.3);
                    let before_mm = (span * 0.6).min(10f64.powf(rng.between(-1.0, 2.5)));
                    let start_mm = switch_mm - outwards * before_mm;
                    let mut cell = cell(name, axis, outwards, switch_mm, start_mm);
                    let (speed, beyond_mm, allowed_mm) = hit(&mut cell, axis, outwards, switch_mm);
                    count += 1;
                    nearest = nearest.max(beyond_mm / allowed_mm);
                    let what =
                        format!("{name} {} {outwards} from {before_mm:.2} mm", settings.name);
                    if beyond_mm > allowed_mm {
                        wrong.push(format!(
                            "{what}: {beyond_mm:.3} mm beyond it at {speed:.1} mm/s, {allowed_mm:.3} allowed"
                        ));
                    }
                    goes_only_off(&mut cell, axis, outwards, &what);
                }
            }
        }
    }
    println!(
        "{count} hits: at most {:.0} % of what braking allows",
        nearest * 100.0
    );
    let first: Vec<String> = wrong.into_iter().take(12).collect();
    assert!(first.is_empty(), "{}", first.join("\n"));
}

/// Drives on again: no motion outwards and no program, but the way back, after which all is as before.
fn goes_only_off(cell: &mut Cell, axis: usize, outwards: f64, what: &str) {
    assert_eq!(cell.order(Order::Enable), Refused::Not, "{what}");
    let on = |of: &Cell| of.mode() == Mode::Enabled && of.now.hold == 1;
    assert!(cell.until(1_000, on), "{what}: {:?}", cell.mode());
    let rests = cell.until(4_000, |of| on(of) && of.now.rested == 1);
    let shown = (
        seen(cell, axis),
        cell.mode(),
        cell.now.hold,
        cell.cause(),
        cell.now.axes[axis],
    );
    assert!(rests, "{what}: {shown:?}");
    let jog = |way: f64| axis_order(Order::Jog, axis, way);
    for refused in [jog(outwards * 0.5), OperatorRequest::of(Order::Resume)] {
        let reason = Refused::from_wire(cell.ask(&refused).reason);
        assert_eq!(reason, Some(Refused::OnLimitSwitch), "{what}");
    }
    let before = seen(cell, axis).0;
    let answer = cell.ask(&jog(-outwards * 5.0)).reason;
    assert_eq!(answer, Refused::Not as u32, "{what}");
    cell.rests();
    assert!(on(cell), "{what}: {:?}", cell.cause());
    let gone = (before - seen(cell, axis).0) * outwards;
    assert!((gone - 5.0).abs() < 0.2, "{what}: {gone}");
}
