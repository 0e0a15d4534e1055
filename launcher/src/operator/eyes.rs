//! What a client sees of the cell that it gives orders to.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::observer::Held;
use bus::port::Reader;
use bus::sample::{Cause, Feedback, Mode, Reference};

use super::Client;
use super::client::soon_held;
use crate::exit::{Failure, Outcome};
use crate::output::say;

/// A cell of which nothing was heard by then is silent.
const SILENCE: Duration = Duration::from_secs(10);
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
                let cell = place.name();
                return Err(Failure::Stopped(anyhow!("cell {cell:?} has ended")));
            }
            if self.heard.elapsed() > SILENCE {
                return Err(Failure::Stopped(anyhow!(
                    "cell {:?} says nothing any more: its master is lost, or the cell has ended",
                    place.name()
                )));
            }
            if let Some(feedback) = self.newest {
                return Ok(feedback);
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until a jog that was ordered in `scan` has ended.
    ///
    /// # Errors
    /// The machine has tripped meanwhile, or the cell is silent.
    pub fn until_jogged(&mut self, scan: u64) -> Outcome {
        loop {
            let now = self.look()?;
            match Mode::from_wire(now.mode) {
                _ if now.scan <= scan => {}
                Some(Mode::Jogging) => {}
                Some(Mode::Tripped) => {
                    return Err(Failure::Stopped(anyhow!("the machine has tripped")));
                }
                _ => {
                    say("jogged");
                    return Ok(());
                }
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
            if now.scan <= scan || moves {
                std::thread::sleep(LOOK);
                continue;
            }
            let missing = axes.iter().filter(|index| {
                let axis = now.axes().get(**index);
                axis.is_none_or(|axis| axis.reference != Reference::Known as u32)
            });
            let names = missing.filter_map(|index| self.client.machine.axes.get(*index));
            let names: Vec<&str> = names.map(|axis| axis.name.as_str()).collect();
            if names.is_empty() {
                say("homed");
                return Ok(());
            }
            let why = match Cause::from_wire(now.cause) {
                None | Some(Cause::None) => "it was stopped",
                Some(cause) => cause.words(),
            };
            return Err(Failure::Stopped(anyhow!(
                "not homed: {}: {why}",
                names.join(" ")
            )));
        }
    }
}
