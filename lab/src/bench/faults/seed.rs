//! What a seed stands for: a program, a machine with or without standbys, faults and orders.

use std::fmt::Write;

use bus::sample::Job;
use machine::settings_file::SettingsFileError;
use machine::{Machine, Restart};
use plant_sim::script::faults::{self, Action, Corruption, FaultScript};
use plant_sim::script::orders::{self, ScriptedOrder};
use plant_sim::script::split_mix::SplitMix64;

/// Scans from the last event to the first attempt to go on, and from one attempt to the next.
const RECOVERY_SCANS: (u64, u64) = (120, 260);
/// So often the operator tries.
const RECOVERIES: u64 = 7;
/// From `enable` to `resume`.
const ENABLE_SCANS: u64 = 30;

/// What a scenario is drawn with.
#[derive(Debug)]
struct Random(SplitMix64);

impl Random {
    /// One of `low..=high`.
    fn within(&mut self, low: u64, high: u64) -> u64 {
        self.0.within(low, high)
    }

    fn one_in(&mut self, count: u64) -> bool {
        self.within(1, count) == 1
    }

    fn of<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[self.within(0, all.len() as u64 - 1) as usize]
    }
}

/// What a run of this length and shape is made of.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    /// Scans of the undisturbed run.
    pub scans: u64,
    /// Elements of its path.
    pub elements: u64,
}

/// One seed, drawn.
#[derive(Debug)]
pub struct Scenario {
    /// Index of its program.
    pub program: usize,
    /// Every axis has a standby.
    pub standby: bool,
    /// The fault script as a file.
    pub faults_text: String,
    /// The same, read.
    pub faults: FaultScript,
    /// The orders as a file.
    pub orders_text: String,
    /// The same, read.
    pub orders: Vec<ScriptedOrder>,
    /// The operator stops the machine: the run may end before the program does.
    pub stops: bool,
}

/// Draws what a seed stands for.
///
/// # Errors
/// The script that was drawn is not one: a defect of this file.
pub fn draw(seed: u64, machine: &Machine, shapes: &[Shape]) -> Result<Scenario, SettingsFileError> {
    let mut random = Random(SplitMix64(seed));
    // Neighbouring seeds are to have nothing in common.
    random.0 = SplitMix64(random.0.bits());
    let program = random.within(0, shapes.len() as u64 - 1) as usize;
    let shape = shapes[program];
    let standby = !random.one_in(3);
    let planner = *random.of(&["resume", "resume", "wait"]);
    let servo = *random.of(&["resume", "wait", "end"]);
    let master = *random.of(&["wait", "wait", "wait", "end"]);
    let mut text =
        format!("[restart]\nplanner = \"{planner}\"\nservo = \"{servo}\"\nmaster = \"{master}\"\n");
    let last_scan = shape.scans.saturating_sub(20).max(20);
    for _ in 0..random.within(1, 4) {
        fault(&mut random, &mut text, machine, standby, shape, last_scan);
    }
    let faults = faults::parse("faults.toml", &text, machine)?;
    let (mut orders, mut stops) = (String::new(), false);
    let mut order = |scan: u64, word: &str, value: &str| {
        let _ = writeln!(
            orders,
            "[[order]]\nscan = {scan}\norder = \"{word}\"{value}\n"
        );
    };
    if random.one_in(4) {
        for _ in 0..random.within(1, 2) {
            let scan = random.within(5, last_scan);
            match random.within(0, 4) {
                0 | 1 => {
                    order(scan, "hold", "");
                    order(scan + random.within(1, 150), "resume", "");
                }
                2 | 3 => {
                    let percent = random.of(&["10.0", "50.0", "80.0", "0.0"]);
                    order(scan, "override", &format!("\nvalue = {percent}"));
                    let back = scan + random.within(10, 200);
                    order(back, "override", "\nvalue = 100.0");
                }
                _ => {
                    stops = true;
                    // A master that comes back knows nothing of a stop: it is asked once more.
                    for again in [0, 1500, 3000] {
                        order(scan + again, "stop", "");
                    }
                }
            }
        }
    }
    let waits = planner == "wait"
        || faults
            .faults
            .iter()
            .any(|fault| fault.job == Job::Master || (fault.job == Job::Servo && servo == "wait"));
    if waits && !stops {
        let mut scan = random.within(40, shape.scans);
        for _ in 0..RECOVERIES {
            scan += RECOVERY_SCANS.0 + random.within(0, RECOVERY_SCANS.1);
            order(scan, "enable", "");
            order(scan + ENABLE_SCANS, "resume", "");
        }
        // Whatever came late: nobody leaves before the machine goes on.
        scan = scan.max(shape.scans + 3000);
        for _ in 0..3 {
            scan += 1200;
            order(scan, "enable", "");
            order(scan + ENABLE_SCANS, "resume", "");
        }
    }
    Ok(Scenario {
        program,
        standby,
        orders: orders::parse("orders.toml", &orders, machine)?,
        orders_text: orders,
        faults_text: text,
        faults,
        stops,
    })
}

fn fault(
    random: &mut Random,
    text: &mut String,
    machine: &Machine,
    standby: bool,
    shape: Shape,
    last_scan: u64,
) {
    let axis = random.of(&machine.axes).name.clone();
    let at = match random.within(0, 7) {
        0 => format!("{{ element = {} }}", random.within(0, shape.elements - 1)),
        1 => format!("{{ reversal = 1, axis = \"{axis}\" }}"),
        _ => format!("{{ scan = {} }}", random.within(0, last_scan)),
    };
    let (job, process) = match random.within(0, 9) {
        0..=3 => (Job::Planner, "planner".to_owned()),
        4..=7 => {
            let role = if standby && random.one_in(3) {
                "b"
            } else {
                "a"
            };
            (Job::Servo, format!("servo-{axis}/{role}"))
        }
        8 => (Job::Master, "plant-sim".to_owned()),
        _ => (Job::Monitor, "monitor".to_owned()),
    };
    let bad_samples = matches!(job, Job::Planner | Job::Servo);
    let what = match random.within(0, if bad_samples { 6 } else { 0 }) {
        0..=2 => format!(
            "do = \"kill\"\nrestart_after_scans = {}",
            random.within(1, 60)
        ),
        3 => {
            // Long enough for a drive's watchdog now and then, and for queues to overflow.
            let most = if random.one_in(4) { 120 } else { 40 };
            format!("do = \"stop\"\nscans = {}", random.within(1, most))
        }
        4 => format!("do = \"drop\"\nscans = {}", random.within(1, 20)),
        5 => format!(
            "do = \"delay\"\nscans = {}\nlate_scans = {}",
            random.within(1, 20),
            random.within(1, faults::LATE_SCANS_MAX)
        ),
        _ => {
            let kinds: Vec<Corruption> = Corruption::ALL
                .into_iter()
                .filter(|kind| kind.befalls(job))
                .collect();
            format!(
                "do = \"corrupt\"\nscans = {}\nwhat = \"{}\"",
                random.within(1, 20),
                random.of(&kinds).word()
            )
        }
    };
    let _ = write!(
        text,
        "\n[[fault]]\nat = {at}\nprocess = \"{process}\"\n{what}\n"
    );
}

/// What is meant by each kind of fault in the summary.
pub fn kind_of(job: Job, action: &Action) -> (&'static str, &'static str) {
    let whose = match job {
        Job::Planner => "planner",
        Job::Servo => "servo",
        Job::Master => "master",
        Job::Monitor => "monitor",
    };
    let what = match action {
        Action::Kill { .. } => "kill",
        Action::Stop { .. } => "stop",
        Action::Drop { .. } => "drop",
        Action::Delay { .. } => "delay",
        Action::Corrupt { .. } => "corrupt",
    };
    (whose, what)
}

/// How long a fault that has fired disturbs: scans until the process is as the others again, its replacement's first scans
/// not counted.
pub fn lasts(action: &Action) -> u64 {
    match *action {
        Action::Kill {
            restart_after_scans,
        } => restart_after_scans,
        Action::Stop { scans } | Action::Drop { scans } | Action::Corrupt { scans, .. } => scans,
        Action::Delay { scans, late_scans } => scans + late_scans,
    }
}

/// The policy of a script on a machine.
pub fn policy(machine: &Machine, faults: &FaultScript) -> Restart {
    let mut restart = machine.restart;
    faults.restart.apply(&mut restart);
    restart
}
