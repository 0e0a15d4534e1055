//! What a client sees of the cell that it gives orders to.

use std::time::{Duration, Instant};

use bus::messages;
use bus::observer::Held;
use bus::port::Reader;
use bus::sample::{AxisFeedback, Cause, Driver, Feedback, Mode, Reference};
use loops::hand_course::HandCourse;
use machine::PositionFeedback;

use super::Client;
use super::client::{probe_words, soon_held};
use console::exit::{Failure, Outcome};
use console::output::joined;
use launcher::supervise::stop_words;

/// A cell of which nothing was heard by then is silent.
const SILENCE: Duration = Duration::from_secs(10);
/// So long drives may take to come on; a fieldbus may be started again for it.
const DRIVES_ON_WITHIN: Duration = Duration::from_secs(10);
/// So long an axis may take to settle.
const SETTLED_WITHIN: Duration = Duration::from_secs(2);
/// Time between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// The cell's feedback, as a client sees it.
pub struct Eyes<'a> {
    reader: Held<Reader<Feedback>>,
    newest: Option<Feedback>,
    heard: Instant,
    client: &'a Client,
}

impl Eyes<'_> {
    /// Looks at the cell of this client.
    ///
    /// # Errors
    /// It cannot be entered.
    pub fn open(client: &Client) -> Result<Eyes<'_>, Failure> {
        Ok(Eyes {
            reader: soon_held(&client.cell, || client.bus.feedback_reader(1))?,
            newest: None,
            heard: Instant::now(),
            client,
        })
    }

    /// The newest feedback, waited for if there was none yet.
    ///
    /// # Errors
    /// The cell is silent.
    pub fn look(&mut self) -> Result<Feedback, Failure> {
        let place = &self.client.cell.place;
        loop {
            // Looked at first: what was said before the end is there after it.
            let gone = self.client.cell.is_gone();
            if let Some(feedback) = self.reader.newest(u64::MAX) {
                self.newest = Some(feedback);
                self.heard = Instant::now();
            } else if gone {
                return Err(Failure::stopped(format!(
                    "cell {:?} has ended",
                    place.name()
                )));
            }
            if self.heard.elapsed() > SILENCE {
                let why = "says nothing any more: its master is lost, or the cell has ended";
                return Err(Failure::stopped(format!("cell {:?} {why}", place.name())));
            }
            if let Some(feedback) = self.newest {
                return Ok(feedback);
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until a jog that was ordered in `scan` has ended: its axes are in position at their goals, in increments, or nothing is
    /// jogged any more; what the cell shows then.
    ///
    /// # Errors
    /// The machine has tripped meanwhile, or the cell is silent.
    pub fn until_jogged(&mut self, scan: u64, goals: &[(usize, i64)]) -> Result<Feedback, Failure> {
        let mut ended = None;
        loop {
            let now = self.look()?;
            let mut axes = goals.iter().map(|(axis, _)| *axis);
            let off = axes.find(|axis| !self.is_in_position(&now, *axis));
            let are_there = goals.iter().all(|(axis, goal)| {
                let axis = now.axes().get(*axis);
                axis.is_some_and(|axis| course(axis).rests() && axis.command_position == *goal)
            });
            let mut others = now.axes().iter().enumerate();
            let others_move = others.any(|(index, axis)| {
                let is_asked = goals.iter().any(|(of, _)| *of == index);
                !is_asked && axis.driver == Driver::Manual as u32 && !course(axis).rests()
            });
            let probed = probe_words(&now, scan);
            match Mode::from_wire(now.mode) {
                _ if now.scan <= scan => {}
                Some(Mode::Jogging) if others_move && are_there && off.is_none() => {
                    return Ok(now);
                }
                Some(Mode::Jogging) => {}
                Some(Mode::Tripped) => return Err(self.client.fails("the machine has tripped")),
                _ if probed.is_some() => {
                    return Err(self.client.fails(probed.unwrap_or_default()));
                }
                _ if off.is_none() && now.rested == 1 => return Ok(now),
                _ => {
                    // By the scans of the cell: a client that gets no time of its PC has seen nothing of them.
                    let ended_in: u64 = *ended.get_or_insert(now.scan);
                    let scans = u64::from(self.client.scans(SETTLED_WITHIN));
                    if now.scan > ended_in + scans {
                        let first = goals.first().map(|(axis, _)| *axis);
                        let axis = off.or(first).unwrap_or(0);
                        let key = match self.client.unit(axis as u32) {
                            "deg" => "in_position_mdeg",
                            _ => "in_position_um",
                        };
                        let words =
                            format!("the jog has ended, and the axis is not in position (`{key}`)");
                        return Err(self.client.fails(&words));
                    }
                }
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Whether an axis is where it is commanded to be, as closely as its machine file asks for.
    fn is_in_position(&self, now: &Feedback, axis: usize) -> bool {
        let settings = self.client.machine.axes.get(axis);
        settings
            .zip(now.axes().get(axis))
            .is_some_and(|(of, axis)| {
                let measured = match of.feedback {
                    PositionFeedback::Motor => axis.motor_position,
                    PositionFeedback::Scale => axis.scale_position,
                };
                let off = measured.saturating_sub(axis.command_position) as f64;
                off.abs() * of.increment_mm() <= of.in_position_window_um() * 1e-3
            })
    }

    /// Why the planner refuses what it was to read.
    pub fn planners_reason(&self, now: &Feedback) -> String {
        let said = messages::why(&self.client.cell.place.messages(), now);
        let elsewhere = || "its reason stands in the terminal of `quadrant up`".into();
        said.map_or_else(elsewhere, |said| said.to_string())
    }

    /// Waits until the drives that an order in `scan` switches on are on; what the cell shows then.
    ///
    /// # Errors
    /// The machine trips in place of it, or they are not in time.
    pub fn until_enabled(&mut self, scan: u64) -> Result<Feedback, Failure> {
        let asked = Instant::now();
        let mut were_on = false;
        loop {
            let now = self.look()?;
            let (on, moves) = match Mode::from_wire(now.mode) {
                Some(Mode::Disabled | Mode::Tripped) => (false, false),
                Some(Mode::Enabled) => (true, now.hold == 0),
                Some(Mode::Jogging | Mode::Stopping) => (true, true),
                _ => (true, false),
            };
            if now.scan > scan && now.cause != Cause::None as u32 && now.cause_scan > scan {
                let why = stop_words(&now, &self.client.machine, None);
                let words = format!("the drives did not come on: {why}");
                return Err(self.client.fails(&words));
            }
            if now.scan > scan && on && (moves || now.rested == 1) {
                return Ok(now);
            }
            if now.scan > scan && !on && were_on {
                let words = "the drives are off again: another order took this one back";
                return Err(self.client.fails(words));
            }
            were_on |= now.scan > scan && on;
            if asked.elapsed() > DRIVES_ON_WITHIN {
                let limit_s = DRIVES_ON_WITHIN.as_secs();
                let words = format!("the drives are not on after {limit_s} s");
                return Err(self.client.fails(&words));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until axes whose homing was ordered in `scan` are homed.
    ///
    /// # Errors
    /// They are not when homing ends, with the cause; or the cell is silent.
    pub fn until_homed(&mut self, scan: u64, axes: &[usize]) -> Outcome {
        loop {
            let now = self.look()?;
            let mode = Mode::from_wire(now.mode);
            let moves = matches!(mode, Some(Mode::Jogging | Mode::Stopping));
            let settles = now.rested == 0 && mode != Some(Mode::Tripped);
            if now.scan <= scan || moves || settles {
                std::thread::sleep(LOOK);
                continue;
            }
            let missing = axes.iter().filter(|index| {
                let axis = now.axes().get(**index);
                axis.is_none_or(|axis| axis.reference != Reference::Known as u32)
            });
            let names = missing.filter_map(|index| self.client.machine.axes.get(*index));
            let names = joined(names.map(|axis| &axis.name), " ");
            if names.is_empty() {
                self.client.say("homed");
                return Ok(());
            }
            let why = match Cause::from_wire(now.cause) {
                None | Some(Cause::None) => "it was stopped",
                Some(cause) => cause.words(),
            };
            return Err(self.client.fails(&format!("not homed: {names}: {why}")));
        }
    }
}

/// The course of an axis that is moved by hand.
pub fn course(axis: &AxisFeedback) -> HandCourse {
    bytemuck::cast(axis.hand)
}
