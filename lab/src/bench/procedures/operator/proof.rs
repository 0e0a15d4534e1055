//! What shows that a machine has recovered: a program that goes on, jogs and a block that end where they say, and motors that rest.

use bus::sample::{Cause, MAX_AXES, Mode, Order, ProgramState};
use launcher::hints;

use super::{Done, K_SCANS, LONG_SCANS, Operator, Stop, WAIT_SCANS, state};
use crate::bench::procedures::interruptions::{inwards, order};
use crate::bench::procedures::run::Prepared;
use crate::staying::Cell;

/// A machine that stands for so long has come to rest in every respect.
const STANDS_SCANS: u64 = 300;
/// A motor of a gantry that stands holds no more than what breaks its own end of the bridge loose, and this share of what moves the
/// gantry: friction that creeps, and noise.
const STORED_SHARE_MAX: f64 = 0.05;
/// Way of the jog and of the block that show that it can be moved, in mm.
const WAYS_MM: [f64; 2] = [0.5, 0.75];

impl Operator<'_> {
    /// The program that was begun comes to its end, as the machine says.
    pub(super) fn goes_on(&mut self) -> Done {
        let meant = (self.run.cell.now.load, self.run.cell.now.run);
        let (mut since, mut ran) = (0, false);
        loop {
            let cell = &self.run.cell;
            let goes_on = cell.now.program == ProgramState::Running as u32
                && (cell.now.load, cell.now.run) == meant;
            if !goes_on {
                break;
            }
            ran = true;
            if since > LONG_SCANS {
                return Err(Stop::Violation(format!(
                    "the program never ends: {}",
                    state(cell)
                )));
            }
            let hint = hints::lost_in(&cell.now);
            match (cell.mode(), hint) {
                (Mode::Tripped | Mode::Disabled, Some(hint)) => {
                    for what in hint.orders {
                        self.demand(what.word(), |_| order(*what))?;
                        self.scans(2)?;
                        self.until("power", K_SCANS, |of| of.mode() != Mode::Disabled)?;
                    }
                }
                (Mode::Tripped | Mode::Disabled, None) => self.switches_on()?,
                (Mode::Enabled, _) if cell.now.hold == 1 => {
                    self.demand("resume", |_| order(Order::Resume))?;
                }
                (Mode::Stopped, _) => {
                    self.demand("resume", |_| order(Order::Resume))?;
                }
                _ => {}
            }
            self.scans(WAIT_SCANS)?;
            since += WAIT_SCANS;
        }
        let Prepared {
            procedure, ends, ..
        } = self.prepared;
        let cell = &self.run.cell;
        let is_done = ran && cell.now.program == ProgramState::Done as u32;
        if procedure.ends_there && is_done && !self.is_another {
            self.until("the end", K_SCANS, |of| of.mode() == Mode::Ready)?;
            return self.is_at(ends);
        }
        Ok(())
    }

    pub(super) fn is_at(&self, ends: &[i64; MAX_AXES]) -> Done {
        let found = self.run.cell.now.axes.map(|axis| axis.command_position);
        match found == *ends {
            true => Ok(()),
            false => {
                let count = self.run.cell.machine.axes.len();
                let (found, ends) = (&found[..count], &ends[..count]);
                Err(Stop::Violation(format!(
                    "the program ends at {found:?}, not at {ends:?}"
                )))
            }
        }
    }

    /// Ready, not in hold, and no program begun. What has come may show only while he is at it: he looks again then.
    pub(super) fn makes_ready(&mut self) -> Done {
        for _ in 0..4 {
            self.rests()?;
            if matches!(self.run.cell.mode(), Mode::Disabled | Mode::Tripped) {
                self.switches_on()?;
            }
            if matches!(self.run.cell.mode(), Mode::Enabled | Mode::Stopped) {
                self.gives_up()?;
                self.scans(2)?;
            }
            if self.run.cell.now.hold == 1 {
                self.demand("resume", |_| order(Order::Resume))?;
                self.scans(2)?;
            }
            self.rests()?;
            let cell = &self.run.cell;
            if cell.mode() == Mode::Ready && cell.now.hold == 0 {
                return Ok(());
            }
        }
        let state = state(&self.run.cell);
        Err(Stop::Violation(format!("it is never ready: {state}")))
    }

    /// Jogs and a block, both exact, and a rest in which nothing pulls at nothing.
    pub(super) fn moves(&mut self) -> Done {
        self.is_slack()?;
        let followers: Vec<usize> = self
            .run
            .cell
            .machine
            .gantries()
            .map(|of| of.follower)
            .collect();
        let axes: Vec<usize> = (0..self.run.cell.machine.axes.len())
            .filter(|axis| !followers.contains(axis))
            .collect();
        let [jog_mm, block_mm] = WAYS_MM;
        for axis in &axes {
            let way_mm = jog_mm * inwards(&self.run.cell, *axis);
            self.jogs(*axis, way_mm)?;
        }
        let ways: Vec<f64> = axes
            .iter()
            .map(|axis| block_mm * inwards(&self.run.cell, *axis))
            .collect();
        let mut text = "G21 G91 G94\nG1 F1500".to_owned();
        for (axis, way_mm) in axes.iter().zip(&ways) {
            text += &format!(" {}{way_mm}", self.run.cell.machine.axes[*axis].name);
        }
        text += "\n";
        // A hold that ended what came last would keep the block.
        self.makes_ready()?;
        let run = self.run.cell.now.run;
        let mut from = [0; MAX_AXES];
        self.demand("typed-in blocks", |of| {
            from = of.now.axes.map(|axis| axis.command_position);
            of.typed_of(&text)
        })?;
        self.until("a block", K_SCANS, |of| {
            of.now.run > run && of.mode() == Mode::Ready
        })?;
        for (axis, way_mm) in axes.iter().zip(&ways) {
            self.ends_at("a block", from[*axis], *axis, *way_mm)?;
        }
        self.is_slack()?;
        let cell = &self.run.cell;
        match (cell.mode(), cell.cause()) {
            (Mode::Ready, Cause::None) => Ok(()),
            _ => Err(Stop::Violation(format!("it ends {}", state(cell)))),
        }
    }

    /// It stands, and no motor of a pair holds more than breaking its own end loose takes: what is stored moves nothing.
    pub(super) fn is_slack(&mut self) -> Done {
        self.scans(STANDS_SCANS)?;
        let cell = &self.run.cell;
        let mut held = Vec::new();
        for pair in cell.machine.gantries() {
            let motors = [pair.leader, pair.follower];
            let percents = motors.map(|axis| {
                let rated_nm = cell.machine.axes[axis].motor.rated_torque_nm;
                let percent = |torque_nm: f64| 100.0 * torque_nm / rated_nm;
                (
                    percent(cell.now.axes[axis].torque_nm),
                    percent(breaks_loose_nm(cell, axis)),
                )
            });
            held.push(percents);
            let [(first, _), (second, _)] = percents;
            let against = match first * second < 0.0 {
                true => first.abs().min(second.abs()),
                false => 0.0,
            };
            let most = self.strain_percent.get_or_insert([0.0; 2]);
            *most = [most[0].max((second - first).abs()), most[1].max(against)];
        }
        self.tell(|_| format!("it stands; % of rated torque, and what moving takes: {held:.1?}"));
        // What a motor holds beyond the friction of its own end, the bridge has stored.
        let stores = |pair: &[(f64, f64); 2]| {
            let moves = pair.iter().map(|(_, moves)| moves).sum::<f64>();
            let beyond = pair.iter().map(|(holds, moves)| holds.abs() - moves);
            beyond.fold(0.0, f64::max) > STORED_SHARE_MAX * moves
        };
        match held.iter().any(stores) {
            false => Ok(()),
            true => Err(Stop::Violation(format!(
                "its motors pull at each other, % of rated torque, and what moving takes: {held:.1?}: {}",
                state(&self.run.cell)
            ))),
        }
    }

    /// The procedure once more, undisturbed.
    pub(super) fn repeats(&mut self) -> Done {
        self.run.begin();
        let homes = self.prepared.procedure.homes;
        loop {
            if let Some(next) = self.later.first()
                && self.interrupted + next.0 <= self.run.cell.now.scan
            {
                self.scan()?;
            }
            match self.run.advance() {
                Ok(true) => {}
                Ok(false) => break,
                Err(why) => return Err(Stop::Violation(format!("once more: {why}"))),
            }
        }
        let ends = &self.prepared.ends;
        if self.prepared.procedure.ends_there {
            self.is_at(ends)?;
        }
        if homes {
            self.has_its_zero()?;
        }
        if homes && !self.run.cell.is_homed() {
            return Err(Stop::Violation(format!(
                "it is not homed: {}",
                state(&self.run.cell)
            )));
        }
        self.is_slack()
    }
}

/// Torque at which an axis breaks loose from rest, in N·m at its motor: as it truly is.
fn breaks_loose_nm(cell: &Cell, axis: usize) -> f64 {
    let settings = &cell.machine.axes[axis];
    let plant = cell.plant.axes.iter().find(|of| of.name == settings.name);
    plant.map_or(0.0, |of| {
        let table_nm = of.table.friction.static_n * settings.lead_mm * 1e-3 / std::f64::consts::TAU;
        of.motor.friction.static_torque_nm + table_nm
    })
}
