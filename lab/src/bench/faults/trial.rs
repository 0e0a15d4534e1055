//! One seed, run and judged.

use std::sync::{Mutex, PoisonError};

use crate::cell::{InProcessCell, Script};
use crate::invariants::{Course, Shown, Stop, Violation};
use bus::sample::{Cause, Job, Mode, OperatorRequest, Order};
use machine::{AfterLoss, AfterMaster, Machine, Process};
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults::{Action, Corruption, Fault};
use plant_sim::script::orders::ScriptedOrder;

use super::judges::Judges;
use super::operator::{Operator, state};
use super::programs::ShortProgram;
use super::seed::{Scenario, policy};

/// A run that takes longer does not end.
const SCANS_MAX: u64 = 20_000;
/// Places of a program in which a feed hold is measured, at most.
const HOLDS_MAX: u64 = 160;
/// How long the tool is in them or, in the shorter ones, does not come to stand, in interpolation periods.
const STANDING_PERIODS: [u64; 5] = [1, 2, 5, 12, 64];
/// So many stops in a row may add up in one contour error.
const STOPS_TOGETHER: usize = 2;
/// A feed hold that a late window is compared with lasts so long.
const STANDING_SCANS: u64 = 96;
/// The contour error of a fault may be larger than that of a feed hold in its place by so much, in mm.
const CONTOUR_SLACK_MM: f64 = 0.001;
/// A window that ends brings the tool to rest where no hold does, and how far the rest of a short rapid carries the table
/// depends on how long it is: 112 and 114 % of the worst hold are the most that was seen in 100,000 seeds.
const BETWEEN_HOLDS: f64 = 1.2;

/// A machine with and without standbys.
#[derive(Debug)]
pub struct Machines {
    /// Every axis has one servo.
    pub alone: Machine,
    /// Every axis has two.
    pub standby: Machine,
    /// The simulated machine.
    pub plant: PlantFile,
}

/// A number that takes long to measure: measured once.
#[derive(Debug, Default)]
pub struct Measured(Mutex<Option<f64>>);

impl Measured {
    /// It, measured now if it has not been.
    fn get_or_try(&self, measure: impl FnOnce() -> anyhow::Result<f64>) -> anyhow::Result<f64> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(value) = *kept {
            return Ok(value);
        }
        let value = measure()?;
        *kept = Some(value);
        Ok(value)
    }

    /// It, if it has been measured.
    pub fn get(&self) -> Option<f64> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A program and what its undisturbed run has shown.
#[derive(Debug)]
pub struct Prepared {
    /// The program.
    pub program: ShortProgram,
    /// Its path.
    pub course: Course,
    /// Its undisturbed run.
    pub undisturbed: Shown,
    /// Largest contour error of runs with one feed hold somewhere, in mm; measured when it is first asked for.
    pub held_contour_mm: Measured,
}

/// What became of a seed.
#[derive(Debug)]
pub struct Verdict {
    /// What the run has shown.
    pub shown: Shown,
    /// What must not be.
    pub violations: Vec<Violation>,
    /// Runs it took: one, and one for each that it was compared with.
    pub runs: u64,
    /// Which faults fired.
    pub fired: Vec<bool>,
    /// What the machine asked for, and was ordered, beside the script: each with its scan.
    pub obeyed: Vec<(u64, Order)>,
    /// Who was lost for good.
    pub lost: Vec<Process>,
}

impl Verdict {
    /// Of a run that panicked.
    pub fn panicked() -> Verdict {
        Verdict {
            shown: Shown::default(),
            violations: vec![Violation {
                scan: 0,
                what: "a panic".into(),
            }],
            runs: 1,
            fired: Vec::new(),
            obeyed: Vec::new(),
            lost: Vec::new(),
        }
    }
}

/// Runs a script to its end; the machine file without its restart policies counts.
pub fn run(
    machine: &Machine,
    plant: &PlantFile,
    program: &ShortProgram,
    course: &Course,
    script: Script,
) -> anyhow::Result<Verdict> {
    let mut restart = machine.restart;
    let faults: Vec<Fault> = script.faults.as_ref().map_or_else(Vec::new, |s| {
        s.restart.apply(&mut restart);
        s.faults.clone()
    });
    let mut judges = Judges::new(machine, course, &faults, &script);
    let mut cell =
        InProcessCell::with_script(machine, plant, (&program.name, &program.text), script)?;
    let mut operator = Operator::new(restart);
    let mut hangs = None;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        let window_sent = judges.take(&published);
        judges.look(&cell, feedback.scan, window_sent);
        if feedback.last == 0 && judges.rests() {
            judges.liveness.disturb();
            hangs = operator.obey(&mut cell, &feedback).err();
            let obeyed = operator.last().into_iter();
            obeyed.for_each(|order| judges.promises.obeyed(order));
        }
        if feedback.scan > SCANS_MAX {
            hangs = Some(format!(
                "does not end within {SCANS_MAX} scans: {}",
                state(&feedback)
            ));
        }
        if hangs.is_some() {
            break;
        }
    }
    let (shown, mut violations, fired) = judges.end(&cell);
    let scan = shown.scans;
    violations.extend(hangs.map(|what| Violation {
        scan,
        what: format!("the run {what}"),
    }));
    Ok(Verdict {
        shown,
        violations,
        runs: 1,
        fired,
        obeyed: operator.given(),
        lost: cell.lost_for_good().to_vec(),
    })
}

impl Machines {
    fn of(&self, standby: bool) -> &Machine {
        if standby { &self.standby } else { &self.alone }
    }

    /// Runs a program under a script.
    fn run(
        &self,
        scenario: &Scenario,
        prepared: &Prepared,
        script: Script,
    ) -> anyhow::Result<Verdict> {
        let machine = self.of(scenario.standby);
        run(
            machine,
            &self.plant,
            &prepared.program,
            &prepared.course,
            script,
        )
    }

    /// Runs and judges one seed.
    ///
    /// # Errors
    /// The cell cannot run in one process.
    pub fn judge(&self, scenario: &Scenario, prepared: &Prepared) -> anyhow::Result<Verdict> {
        let script = Script {
            faults: Some(scenario.faults.clone()),
            orders: scenario.orders.clone(),
            supervised: scenario.supervised,
            tampering: scenario.tampering,
        };
        let mut verdict = self.run(scenario, prepared, script)?;
        let faults = scenario.faults.faults.iter().zip(&verdict.fired);
        let struck: Vec<&Fault> = faults
            .filter_map(|(fault, fired)| fired.then_some(fault))
            .collect();
        let machine = self.of(scenario.standby);
        let wrong = [
            unexpected_end(machine, scenario, &struck, &verdict)
                .filter(|_| !scenario.tampering.is_some_and(|t| t.resealed)),
            self.changed_motion(scenario, prepared, &struck, &mut verdict)?,
            self.off_path(scenario, prepared, &struck, &mut verdict)?,
        ];
        let scan = verdict.shown.scans;
        let wrong = wrong.into_iter().flatten();
        verdict
            .violations
            .extend(wrong.map(|what| Violation { scan, what }));
        Ok(verdict)
    }

    /// A motion that is not that of the undisturbed run, although only servos and recorder were struck and no scan was missed.
    fn changed_motion(
        &self,
        scenario: &Scenario,
        prepared: &Prepared,
        struck: &[&Fault],
        verdict: &mut Verdict,
    ) -> anyhow::Result<Option<String>> {
        let shown = &verdict.shown;
        let covered = struck.iter().all(|fault| match fault.action {
            // Whose command is taken says which window its axis holds.
            Action::Spoil { field, .. } if field.name().starts_with("command.pending") => false,
            _ => matches!(fault.process.job, Job::Servo | Job::Monitor),
        });
        if shown.trips > 0 || shown.missed > 0 || !covered || scenario.tampering.is_some() {
            return Ok(None);
        }
        let digest = shown.digest;
        let undisturbed = if scenario.orders.is_empty() {
            prepared.undisturbed.digest
        } else {
            verdict.runs += 1;
            let orders_alone = Script {
                faults: None,
                orders: scenario.orders.clone(),
                ..Script::default()
            };
            self.run(scenario, prepared, orders_alone)?.shown.digest
        };
        let what = "not the motion of the undisturbed run although every fault was covered";
        Ok((undisturbed != digest).then(|| what.into()))
    }

    /// A table that leaves the path further than feed holds in place of the faults would make it.
    fn off_path(
        &self,
        scenario: &Scenario,
        prepared: &Prepared,
        struck: &[&Fault],
        verdict: &mut Verdict,
    ) -> anyhow::Result<Option<String>> {
        let shown = verdict.shown.clone();
        let has = |job: Job| struck.iter().any(|fault| fault.process.job == job);
        // Where only servos were struck, the motion is that of the undisturbed run to the bit: judged above.
        let stays_on_path =
            shown.trips == 0 && shown.missed == 0 && !has(Job::Master) && has(Job::Planner);
        let usual_mm = prepared.undisturbed.contour_mm.0;
        let worse_than = |mm: f64| shown.contour_mm.0 > mm + CONTOUR_SLACK_MM;
        if !stays_on_path || !worse_than(usual_mm) {
            return Ok(None);
        }
        let worst_mm = prepared
            .held_contour_mm
            .get_or_try(|| held_contour_mm(self, prepared))?;
        // The friction of one stop is not forgotten by the next: the cost of two may add up.
        let together = shown.stops.len().clamp(1, STOPS_TOGETHER) as f64;
        let mut held_mm = usual_mm + together * (worst_mm - usual_mm).max(0.0);
        for orders in held_instead(&shown, scenario) {
            verdict.runs += 1;
            let holds_alone = Script {
                faults: None,
                orders,
                ..Script::default()
            };
            let twin = self.run(scenario, prepared, holds_alone)?;
            held_mm = held_mm.max(twin.shown.contour_mm.0);
        }
        let (mm, scan) = shown.contour_mm;
        Ok(worse_than(held_mm * BETWEEN_HOLDS).then(|| {
            format!(
                "table {mm:.4} mm off the path in scan {scan}: with feed holds instead {held_mm:.4}, undisturbed {usual_mm:.4}"
            )
        }))
    }
}

/// The orders of a scenario, with feed holds that take effect in the setpoints in which its faults brought the machine to rest.
/// A window that came late, but before the one before it braked, costs what a hold there costs: one set of orders for
/// each of these, and one for all stops.
fn held_instead(shown: &Shown, scenario: &Scenario) -> Vec<Vec<ScriptedOrder>> {
    let order = |scan: u64, order: Order| ScriptedOrder {
        scan,
        request: OperatorRequest::of(order),
    };
    // Seen at the boundary a period before the setpoint, in effect from the setpoint on.
    let seen = |scan: u64| scan.saturating_sub(9);
    let overrides: Vec<ScriptedOrder> = scenario
        .orders
        .iter()
        .filter(|o| o.request.order == Order::Override as u32)
        .copied()
        .collect();
    let holds = |stops: &[Stop], foreseen: Option<&Stop>| {
        let mut orders = overrides.clone();
        for stop in stops.iter().filter(|stop| !stop.foreseen) {
            orders.push(order(seen(stop.from), Order::Hold));
            if let Some(until) = stop.until {
                orders.push(order(seen(until), Order::Resume));
            }
        }
        if let Some(stop) = foreseen {
            orders.push(order(seen(stop.from), Order::Hold));
            orders.push(order(seen(stop.from) + STANDING_SCANS, Order::Resume));
        }
        orders.sort_by_key(|order| order.scan);
        orders
    };
    // What the operator asked for costs what it costs.
    let mut sets = vec![scenario.orders.clone(), holds(&shown.stops, None)];
    for (index, stop) in shown.stops.iter().enumerate() {
        if stop.foreseen {
            sets.push(holds(&shown.stops[..index], Some(stop)));
        }
    }
    sets
}

/// How the run must not have ended.
fn unexpected_end(
    machine: &Machine,
    scenario: &Scenario,
    struck: &[&Fault],
    verdict: &Verdict,
) -> Option<String> {
    let shown = &verdict.shown;
    // Who is lost for good has the launcher order a stop.
    let lost = |job: Job| verdict.lost.iter().any(|process| process.job == job);
    let stops = scenario.stops || lost(Job::Planner) || lost(Job::Servo) || lost(Job::Master);
    let restart = policy(machine, &scenario.faults);
    let any = |wanted: &dyn Fn(&Fault) -> bool| struck.iter().any(|fault| wanted(fault));
    let bad_command = |fault: &Fault| {
        fault.process.job == Job::Servo
            && matches!(
                fault.action,
                Action::Corrupt {
                    what: Corruption::NotANumber | Corruption::Infinity | Corruption::Jump,
                    ..
                } | Action::Spoil { .. }
            )
    };
    let servo_for_good = any(&bad_command)
        || (restart.servo == AfterLoss::End && any(&|fault| fault.process.job == Job::Servo));
    let side_for_good = lost(Job::Master)
        || (restart.master == AfterMaster::End && any(&|fault| fault.process.job == Job::Master));
    // An axis that ran on without commands may be too far off when they come again.
    let ran_off = shown.missed > 0 && shown.cause == Some(Cause::FollowingError);
    let fine = match shown.mode {
        Some(Mode::Finished) => true,
        Some(Mode::Tripped) => {
            servo_for_good || ran_off || side_for_good || (stops && shown.trips > 0)
        }
        Some(Mode::Stopped) => stops,
        Some(Mode::Disabled) => stops || side_for_good,
        Some(Mode::Enabled | Mode::Stopping | Mode::Jogging | Mode::Ready) => side_for_good,
        None => side_for_good,
    };
    (!fine).then(|| {
        let mode = shown.mode.map_or("nothing", Mode::word);
        let cause = shown.cause.map_or("an unknown cause", Cause::words);
        format!("the run ended {mode} ({cause}), and nothing in its script says why")
    })
}

/// Runs a program undisturbed, and with a feed hold in places all along it.
///
/// # Errors
/// Program and machine do not fit, or the undisturbed run violates something.
pub fn prepare(machines: &Machines, program: ShortProgram) -> anyhow::Result<Prepared> {
    let (machine, plant) = (&machines.alone, &machines.plant);
    let course = Course::of(machine, plant, &program.name, &program.text)
        .map_err(|error| anyhow::anyhow!("{error}"))?;
    let undisturbed = run(machine, plant, &program, &course, Script::default())?;
    anyhow::ensure!(
        undisturbed.violations.is_empty(),
        "{} undisturbed: {:?}",
        program.name,
        undisturbed.violations
    );
    Ok(Prepared {
        undisturbed: undisturbed.shown,
        program,
        course,
        held_contour_mm: Measured::default(),
    })
}

/// Largest contour error of runs with one feed hold each: at places all along the program, short and long.
fn held_contour_mm(machines: &Machines, prepared: &Prepared) -> anyhow::Result<f64> {
    let Prepared {
        program,
        course,
        undisturbed,
        ..
    } = prepared;
    let period = u64::from(machines.alone.scan.interpolation_period_scans).max(1);
    let apart = (undisturbed.scans / HOLDS_MAX)
        .next_multiple_of(period)
        .max(period);
    let order = |scan: u64, order: Order| ScriptedOrder {
        scan,
        request: OperatorRequest::of(order),
    };
    let mut largest_mm = 0.0f64;
    let mut scan = period;
    while scan < undisturbed.scans {
        for standing in STANDING_PERIODS.map(|periods| periods * period) {
            let orders = vec![
                order(scan - 1, Order::Hold),
                order(scan - 1 + standing, Order::Resume),
            ];
            let script = Script {
                faults: None,
                orders,
                ..Script::default()
            };
            let held = run(&machines.alone, &machines.plant, program, course, script)?;
            anyhow::ensure!(
                held.violations.is_empty(),
                "{} with a feed hold in scan {scan}: {:?}",
                program.name,
                held.violations
            );
            largest_mm = largest_mm.max(held.shown.contour_mm.0);
        }
        scan += apart;
    }
    Ok(largest_mm)
}
