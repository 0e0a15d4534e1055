//! What a client sees of the cell that it gives orders to.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::port::Reader;
use bus::sample::{Feedback, Mode};

use super::Client;
use crate::exit::{Failure, Kind, Outcome};
use crate::output::say;

/// A cell of which nothing was heard by then is silent.
const SILENCE: Duration = Duration::from_secs(10);
/// Time between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// The cell's feedback, as a client sees it.
pub struct Eyes<'a> {
    reader: Option<Reader<Feedback>>,
    newest: Option<Feedback>,
    heard: Instant,
    client: &'a Client,
}

impl Drop for Eyes<'_> {
    fn drop(&mut self) {
        if self.client.has_ended() {
            // What is closed now would be the service of the next cell of that name.
            std::mem::forget(self.reader.take());
        }
    }
}

impl Eyes<'_> {
    /// Looks at the cell of this client.
    ///
    /// # Errors
    /// It cannot be entered.
    pub fn open(client: &Client) -> Result<Eyes<'_>, Failure> {
        Ok(Eyes {
            reader: Some(client.bus.feedback_reader(1).environment()?),
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
        loop {
            let newest = self.reader.as_mut().and_then(|r| r.newest(u64::MAX));
            if let Some(feedback) = newest {
                self.newest = Some(feedback);
                self.heard = Instant::now();
            }
            if self.heard.elapsed() > SILENCE {
                return Err(Failure::Stopped(anyhow!(
                    "cell {:?} says nothing any more: its master is lost, or the cell has ended",
                    self.client.place.name()
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
}
