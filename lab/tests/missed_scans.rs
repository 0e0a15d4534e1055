//! Scans that the servos of an axis do not see, or whose commands do not come: what they feed forward in the scans behind is what an undisturbed
//! run feeds forward there, wherever the scans lie within a period and between two windows.

use crate::common::load;
use bus::sample::AxisCommand;
use lab::cell::{InProcessCell, Script};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;

const MACHINES: [&str; 5] = ["xy", "xy-fast", "xy-torque", "xyz-mill", "xz-lathe"];
/// A straight line at constant speed, in mm/s.
const SPEED_MM_S: f64 = 50.0;
const PROGRAM: &str = "G21 G91 G94\nG1 X40 F3000\nM2\n";
/// Scans in a row that are missed: three later the master commands the axis itself.
const MISSED_MAX: u64 = 3;
/// Periods whose scans are missed, one after the other.
const PERIODS: u64 = 2;
/// Periods that are looked at behind: the speed is smoothed over one.
const LOOKED_AT: u64 = 4;
/// Most by which the speed that is fed forward differs from the undisturbed run, in mm/s.
const FEED_FORWARD_MM_S: f64 = 0.01;
/// Most by which the command to the drive differs from the undisturbed run, in mm/s: the loop answers what the axis did meanwhile.
const COMMAND_MM_S: f64 = 0.05;

/// Commands of the first axis, scan by scan, up to this one.
fn commands(
    (machine, plant): &(Machine, PlantFile),
    script: Option<&str>,
    last: u64,
) -> Vec<Vec<AxisCommand>> {
    let script = Script {
        faults: script.map(|text| faults::parse("faults.toml", text, machine).expect("a script")),
        ..Script::default()
    };
    let mut cell =
        InProcessCell::with_script(machine, plant, ("line.ngc", PROGRAM), script).expect("a cell");
    let mut commands = Vec::new();
    while commands.len() as u64 <= last {
        let Some(published) = cell.scan() else { break };
        let of_axis = published.commands.iter().filter(|of| of.axis == 0);
        commands.push(of_axis.copied().collect());
    }
    commands
}

/// The first scan of a period in which the axis has long been at its speed.
fn steady_from(undisturbed: &[Vec<AxisCommand>], period: u64) -> u64 {
    let is_steady = |of: &Vec<AxisCommand>| {
        of.iter()
            .all(|of| (of.feed_forward_mm_s - SPEED_MM_S).abs() < 0.01 * SPEED_MM_S)
    };
    let begun = undisturbed
        .iter()
        .position(|of| !of.is_empty() && is_steady(of));
    let long = begun.expect("a speed that is kept") as u64 + 4 * period;
    long.next_multiple_of(period)
}

/// The farthest that what was found in a run is from the undisturbed run: feed-forward and command, in mm/s, and the scan of the latter.
fn farthest_off_mm_s(
    found: &[Vec<AxisCommand>],
    undisturbed: &[Vec<AxisCommand>],
    from: u64,
) -> (f64, f64, u64) {
    let (mut feed_forward, mut command, mut at) = (0.0f64, 0.0f64, from);
    let pairs = found.iter().zip(undisturbed).skip(from as usize);
    for (scan, (found, expected)) in (from..).zip(pairs) {
        for of in found {
            let off = |value: fn(&AxisCommand) -> f64| (value(of) - value(&expected[0])).abs();
            feed_forward = feed_forward.max(off(|of| of.feed_forward_mm_s));
            let off_mm_s = off(|of| of.velocity_mm_s);
            if off_mm_s > command {
                (command, at) = (off_mm_s, scan);
            }
        }
    }
    (feed_forward, command, at)
}

#[test]
fn scans_that_servos_miss_around_a_change_of_windows_leave_what_is_fed_forward_as_it_was() {
    let mut wrong = Vec::new();
    for name in MACHINES {
        let all = load(name);
        let axis = &all.0.axes[0];
        let period = u64::from(all.0.scan.interpolation_period_scans);
        let undisturbed = commands(&all, None, u64::MAX - 1);
        let from = steady_from(&undisturbed, period);
        let [a, b] = ["a", "b"].map(|role| format!("servo-{}/{role}", axis.name));
        let mut who = vec![vec![a.clone()]];
        if axis.standby {
            who.extend([vec![b.clone()], vec![a, b]]);
        }
        let kinds = (1..=MISSED_MAX).flat_map(|scans| ["stop", "drop"].map(|what| (what, scans)));
        for (who, (what, scans)) in who
            .iter()
            .flat_map(|who| kinds.clone().map(move |of| (who, of)))
        {
            let mut worst = (0.0f64, 0.0f64);
            for scan in from - 1..from + PERIODS * period {
                let fault = |process: &String| {
                    format!(
                        "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\ndo = \"{what}\"\nscans = {scans}\n"
                    )
                };
                let script: String = who.iter().map(fault).collect();
                let last = scan + scans + LOOKED_AT * period;
                let found = commands(&all, Some(&script), last);
                let (feed_forward, command, at) = farthest_off_mm_s(&found, &undisturbed, scan);
                worst = (worst.0.max(feed_forward), worst.1.max(command));
                if feed_forward > FEED_FORWARD_MM_S || command > COMMAND_MM_S {
                    wrong.push(format!(
                        "{name}: {who:?} {what} in scan {scan} for {scans}: feed-forward off by {feed_forward} mm/s, the command in scan {at} by {command} mm/s"
                    ));
                }
            }
            eprintln!("{name} {who:?} {what} {scans}: {worst:?}");
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
