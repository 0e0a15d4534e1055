//! `--view`: the live view in the launcher's own terminal, as a process of its own, so that a machine that moves never waits for
//! a screen. What the launcher has to say meanwhile is printed when the view is closed.

use std::io::IsTerminal;
use std::process::{Child, Command};
use std::time::Duration;

use anyhow::{Context, bail};

use crate::closing::close;
use console::output;

/// So long the view may take to give the terminal back; one that takes nothing more cannot be given back.
const CLOSE_LIMIT: Duration = Duration::from_secs(1);
/// Set in the environment of a launcher's view.
pub const OF_A_LAUNCHER: &str = "QUADRANT_VIEW_OF_LAUNCHER";
const LOOK: Duration = Duration::from_millis(10);

/// The view, as long as it is open.
#[derive(Debug)]
pub struct View {
    child: Option<Child>,
}

/// Whether there is a terminal to draw on.
///
/// # Errors
/// There is none.
pub fn check() -> anyhow::Result<()> {
    if std::io::stdout().is_terminal() && std::io::stdin().is_terminal() {
        return Ok(());
    }
    bail!("--view: needs a terminal; without one, `quadrant monitor --json` writes lines")
}

impl View {
    /// Opens it on a cell that runs, if it is wanted.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn open_if(wanted: bool, cell: &str) -> anyhow::Result<Option<View>> {
        if !wanted {
            return Ok(None);
        }
        let child = Command::new("/proc/self/exe")
            .args(["monitor", "--cell", cell])
            .env(OF_A_LAUNCHER, "1")
            .spawn()
            .context("starting the view")?;
        output::hold_back();
        Ok(Some(View { child: Some(child) }))
    }

    /// Reaps it once somebody has closed it; whether that was just now.
    pub fn look(&mut self) -> bool {
        let closed = |child: &mut Child| !matches!(child.try_wait(), Ok(None));
        let closed = self.child.as_mut().is_some_and(closed);
        if closed {
            self.child = None;
            output::release();
        }
        closed
    }
}

impl Drop for View {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else {
            return;
        };
        close(&mut child, CLOSE_LIMIT, LOOK);
        output::release();
    }
}
