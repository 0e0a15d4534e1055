//! What the commands that start a cell show of it meanwhile: metrics, the page in the browser, the live view in their own terminal.

use std::io::IsTerminal;

use anyhow::bail;
use console::exit::{Failure, Kind};
use launcher::observers::{self, Observer};

use crate::live::OF_A_LAUNCHER;
use crate::metrics;
use crate::options::ShowOptions;
use crate::web::place::Place;

impl ShowOptions {
    /// Whether there is a terminal to draw on, if one is wanted.
    ///
    /// # Errors
    /// There is none.
    pub fn check(&self) -> anyhow::Result<()> {
        let terminal = std::io::stdout().is_terminal() && std::io::stdin().is_terminal();
        if self.view && !terminal {
            bail!("--view: needs a terminal; without one, `quadrant monitor --json` writes lines");
        }
        Ok(())
    }

    /// The processes that show the cell, their sockets open.
    ///
    /// # Errors
    /// An address is taken or not one of this PC's; the token's file is not usable.
    pub fn observers(&self) -> Result<Vec<Observer>, Failure> {
        let metrics = self.metrics.map(metrics::place::observer).transpose();
        let mut all = Vec::from_iter(metrics.environment()?);
        if let Some(address) = self.web {
            let place = Place::open(address, self.token.as_deref(), self.token_to_look)?;
            all.push(place.observer());
        }
        if self.view {
            all.push(Observer {
                name: "the view",
                subcommand: "monitor",
                arguments: &[],
                variables: vec![(OF_A_LAUNCHER, "1".into())],
                place: observers::Place::Terminal,
                greeting: None,
            });
        }
        Ok(all)
    }
}
