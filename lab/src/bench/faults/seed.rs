//! What a seed stands for: a program, a machine with or without standbys, faults and orders.

use std::fmt::Write;

use bus::layout::Leaf;
use bus::sample::Job;
use machine::settings_file::SettingsFileError;
use machine::{Machine, Restart};
use plant_sim::script::faults::{self, Action, Corruption, FaultScript, Sent, Spoil};
use plant_sim::script::orders::{self, ScriptedOrder};
use plant_sim::script::rng::Rng;

use crate::tampering::Tampering;

/// Scans from the last event to the first attempt to go on, and from one attempt to the next.
const RECOVERY_SCANS: (u64, u64) = (120, 260);
/// So often an operator tries at most who does not wait for what the machine says.
const RECOVERIES: u64 = 3;
/// From `enable` to `resume`.
const ENABLE_SCANS: u64 = 30;

/// One element of a list that is never empty.
fn one_of<'a, T>(rng: &mut Rng, all: &'a [T]) -> &'a T {
    rng.pick(all).expect("a list with elements")
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
    /// Processes die by themselves: the launcher's rules decide what follows.
    pub supervised: bool,
    /// Samples are damaged behind their senders' backs.
    pub tampering: Option<Tampering>,
}

/// Draws what a seed stands for.
///
/// # Errors
/// The script that was drawn is not one: a defect of this file.
pub fn draw(seed: u64, machine: &Machine, shapes: &[Shape]) -> Result<Scenario, SettingsFileError> {
    // Neighbouring seeds are to have nothing in common.
    let mut rng = Rng::new(Rng::new(seed).bits());
    let program = rng.within(0, shapes.len() as u64 - 1) as usize;
    let shape = shapes[program];
    let standby = !rng.one_in(3);
    let supervised = rng.one_in(4);
    let planner = *one_of(
        &mut rng,
        &["resume", "resume", "resume", "wait", "wait", "end"],
    );
    let servo = *one_of(&mut rng, &["resume", "wait", "end"]);
    let master = *one_of(&mut rng, &["wait", "wait", "wait", "end"]);
    let mut text =
        format!("[restart]\nplanner = \"{planner}\"\nservo = \"{servo}\"\nmaster = \"{master}\"\n");
    let last_scan = shape.scans.saturating_sub(20).max(20);
    if supervised {
        let _ = writeln!(text, "restarts_max = {}", rng.within(1, 6));
    }
    for _ in 0..rng.within(1, 4) {
        fault(&mut rng, &mut text, machine, standby, shape, last_scan);
    }
    let faults = faults::parse("faults.toml", &text, machine)?;
    let mut orders = Orders::default();
    if rng.one_in(4) {
        for _ in 0..rng.within(1, 2) {
            orders.draw_one(&mut rng, last_scan);
        }
    }
    let waits = planner == "wait"
        || faults.faults.iter().any(|fault| {
            fault.process.job == Job::Master || (fault.process.job == Job::Servo && servo == "wait")
        });
    if waits && !orders.stops {
        orders.draw_recoveries(&mut rng, shape);
    }
    let tampering = rng.one_in(6).then(|| Tampering::draw(&mut rng, last_scan));
    Ok(Scenario {
        tampering,
        program,
        standby,
        orders: orders::parse("orders.toml", &orders.text, machine)?,
        orders_text: orders.text,
        faults_text: text,
        faults,
        stops: orders.stops,
        supervised,
    })
}

/// The orders of an operator, as a file.
#[derive(Default)]
struct Orders {
    text: String,
    /// One of them stops the machine.
    stops: bool,
}

impl Orders {
    fn add(&mut self, scan: u64, word: &str, value: &str) {
        let _ = writeln!(
            self.text,
            "[[order]]\nscan = {scan}\norder = \"{word}\"{value}\n"
        );
    }

    /// One order, and where it needs one, the order that takes it back.
    fn draw_one(&mut self, rng: &mut Rng, last_scan: u64) {
        let scan = rng.within(5, last_scan);
        match rng.within(0, 4) {
            0 | 1 => {
                self.add(scan, "hold", "");
                self.add(scan + rng.within(1, 150), "resume", "");
            }
            2 | 3 => {
                let percent = one_of(rng, &["10.0", "50.0", "80.0", "0.0"]);
                self.add(scan, "override", &format!("\nvalue = {percent}"));
                let back = scan + rng.within(10, 200);
                self.add(back, "override", "\nvalue = 100.0");
            }
            _ => {
                self.stops = true;
                // A master that comes back knows nothing of a stop: it is asked once more.
                for again in [0, 1500, 3000] {
                    self.add(scan + again, "stop", "");
                }
            }
        }
    }

    /// Enables and resumes, again and again, as an operator does who waits for the machine.
    fn draw_recoveries(&mut self, rng: &mut Rng, shape: Shape) {
        let mut scan = rng.within(40, shape.scans);
        for _ in 0..rng.within(0, RECOVERIES) {
            scan += RECOVERY_SCANS.0 + rng.within(0, RECOVERY_SCANS.1);
            self.recover(scan);
        }
    }

    fn recover(&mut self, scan: u64) {
        self.add(scan, "enable", "");
        self.add(scan + ENABLE_SCANS, "resume", "");
    }
}

fn fault(
    rng: &mut Rng,
    text: &mut String,
    machine: &Machine,
    standby: bool,
    shape: Shape,
    last_scan: u64,
) {
    let axis = one_of(rng, &machine.axes).name.clone();
    let at = match rng.within(0, 7) {
        0 => format!("{{ element = {} }}", rng.within(0, shape.elements - 1)),
        1 => format!("{{ reversal = 1, axis = \"{axis}\" }}"),
        _ => format!("{{ scan = {} }}", rng.within(0, last_scan)),
    };
    let (job, process) = match rng.within(0, 9) {
        0..=3 => (Job::Planner, "planner".to_owned()),
        4..=7 => {
            let role = if standby && rng.one_in(3) { "b" } else { "a" };
            (Job::Servo, format!("servo-{axis}/{role}"))
        }
        8 => (Job::Master, "plant-sim".to_owned()),
        _ => (Job::Monitor, "monitor".to_owned()),
    };
    let bad_samples = matches!(job, Job::Planner | Job::Servo);
    let by_scan = at.contains("scan");
    let what = match rng.within(0, if bad_samples { 8 } else { 0 }) {
        // Again and again: who dies too often is given up.
        0 if by_scan && rng.one_in(2) => format!(
            "do = \"kill\"\nrestart_after_scans = {}\nrepeat = {{ times = {}, every_scans = {} }}",
            rng.within(1, 20),
            rng.within(2, 7),
            rng.within(15, 120)
        ),
        0..=2 => format!("do = \"kill\"\nrestart_after_scans = {}", rng.within(1, 60)),
        3 => {
            // Long enough for a drive's watchdog now and then, and for queues to overflow.
            let most = if rng.one_in(4) { 120 } else { 40 };
            format!("do = \"stop\"\nscans = {}", rng.within(1, most))
        }
        4 => format!("do = \"drop\"\nscans = {}", rng.within(1, 20)),
        5 => format!(
            "do = \"delay\"\nscans = {}\nlate_scans = {}",
            rng.within(1, 20),
            rng.within(1, faults::LATE_SCANS_MAX)
        ),
        7 | 8 => spoil(rng, job),
        _ => {
            let kinds: Vec<Corruption> = Corruption::ALL
                .into_iter()
                .filter(|kind| kind.befalls(job))
                .collect();
            format!(
                "do = \"corrupt\"\nscans = {}\nwhat = \"{}\"",
                rng.within(1, 20),
                one_of(rng, &kinds).word()
            )
        }
    };
    let _ = write!(
        text,
        "\n[[fault]]\nat = {at}\nprocess = \"{process}\"\n{what}\n"
    );
}

/// What only a checksum would find out, or nobody: how a drive is to get where it is commanded, which the master believes.
const BELIEVED: [&str; 2] = ["velocity_mm_s", "torque_nm"];
/// What a planner that seals it is believed, because nobody else knows the program.
const KNOWN_TO_PLANNER: [&str; 2] = ["program_hash", "ends_program"];

/// One number of a sample, wrong in one way.
fn spoil(rng: &mut Rng, job: Job) -> String {
    let sent: Vec<Sent> = Sent::ALL
        .into_iter()
        .filter(|sent| sent.job() == job)
        .collect();
    let sent = *one_of(rng, &sent);
    // Most numbers of a command are its servo's state.
    let of_state = rng.one_in(6);
    let leaves: Vec<&Leaf> = sent
        .leaves()
        .iter()
        .filter(|leaf| !BELIEVED.contains(&leaf.name.as_str()))
        .filter(|leaf| sent != Sent::Command || leaf.name.starts_with("state.") == of_state)
        .collect();
    let leaf = *one_of(rng, &leaves);
    let float = leaf.number == "float64";
    let how = match rng.within(0, if float { 6 } else { 5 }) {
        0 => Spoil::AllBits,
        1 => Spoil::Most,
        2 => Spoil::Zero,
        3 => Spoil::OneMore,
        4 => Spoil::OneLess,
        5 => Spoil::Bit(rng.within(0, 8 * leaf.bytes as u64 - 1) as u8),
        _ => Spoil::NotANumber,
    };
    let believed = sent == Sent::Setpoint || KNOWN_TO_PLANNER.contains(&leaf.name.as_str());
    let sealed = if believed { "\nsealed = false" } else { "" };
    let scans = if rng.one_in(2) { 1 } else { rng.within(2, 40) };
    format!(
        "do = \"corrupt\"\nscans = {scans}\nfield = \"{}.{}\"\nwhat = \"{}\"{sealed}",
        sent.word(),
        leaf.name,
        how.word()
    )
}

/// What is meant by each kind of fault in the summary.
pub fn kind_of(job: Job, action: &Action) -> (&'static str, &'static str) {
    let whose = match job {
        Job::Planner => "planner",
        Job::Servo => "servo",
        Job::Master => "master",
        Job::Monitor => "monitor",
        Job::Fieldbus => "fieldbus",
        Job::Logic => "logic",
    };
    let what = match action {
        Action::Kill { .. } => "kill",
        Action::Stop { .. } => "stop",
        Action::Drop { .. } => "drop",
        Action::Delay { .. } => "delay",
        Action::Corrupt { .. } => "corrupt",
        Action::Spoil { field, .. } => field.sent.word(),
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
        Action::Stop { scans }
        | Action::Drop { scans }
        | Action::Corrupt { scans, .. }
        | Action::Spoil { scans, .. } => scans,
        Action::Delay { scans, late_scans } => scans + late_scans,
    }
}

/// The policy of a script on a machine.
pub fn policy(machine: &Machine, faults: &FaultScript) -> Restart {
    let mut restart = machine.restart;
    faults.restart.apply(&mut restart);
    restart
}
