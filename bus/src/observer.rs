//! A running cell, seen from outside: who observes it or gives it orders notices its end, and leaves it undisturbed.

use std::cell::Cell;
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};
use std::rc::Rc;
use std::time::{Duration, Instant};

use crate::cell::CellPaths;
use crate::process::watch;
use crate::signal_page::{CellPhase, SignalPage};

/// The launcher of a cell that has ended may be at removing its files for so long.
const REMOVAL_LIMIT: Duration = Duration::from_millis(200);
const REMOVAL_LOOK: Duration = Duration::from_millis(2);

/// A running cell, seen from outside.
#[derive(Debug)]
pub struct Observer {
    /// Its place.
    pub place: CellPaths,
    /// Its signal page.
    pub page: SignalPage,
    last_seen: Cell<bool>,
    entered: Cell<bool>,
}

impl Observer {
    /// The cell at this place; none unless it is this user's, its launcher lives and it is not about to end.
    pub fn of(place: CellPaths) -> Option<Observer> {
        place.must_be_ours().ok()?;
        let page = SignalPage::open(&place).ok()?;
        let runs = page.phase() == CellPhase::Running && watch(page.launcher_pid()).is_ok();
        runs.then_some(Observer {
            place,
            page,
            last_seen: Cell::new(false),
            entered: Cell::new(false),
        })
    }

    /// Whether the cell is gone, or another one has its name.
    pub fn is_gone(&self) -> bool {
        let launcher = self.page.launcher_pid();
        self.page.phase() == CellPhase::Ending
            || Observer::of(self.place.clone())
                .is_none_or(|now| now.page.launcher_pid() != launcher)
    }

    /// The cell has published its last feedback.
    pub fn note_last(&self) {
        self.last_seen.set(true);
    }

    /// Whether the cell is gone, or about to go.
    pub fn has_ended(&self) -> bool {
        self.last_seen.get() || self.is_gone()
    }

    /// From now on this process has something in the cell's shared memory.
    pub fn note_entered(&self) {
        self.entered.set(true);
    }

    /// Removes what was made here while the launcher removed all that it found: nobody else does any more. What a launcher that
    /// was killed has left stays, and what another cell of the name has.
    fn clean_up(&self) {
        let since = Instant::now();
        while since.elapsed() < REMOVAL_LIMIT && Observer::of(self.place.clone()).is_none() {
            let removed = SignalPage::open(&self.place).is_err();
            if removed && (!self.place.has_traces() || self.place.own(Duration::ZERO).is_ok()) {
                return;
            }
            if !removed && watch(self.page.launcher_pid()).is_err() {
                return;
            }
            std::thread::sleep(REMOVAL_LOOK);
        }
    }

    /// Ports of this cell, closed in order only while it runs.
    pub fn hold<T>(self: &Rc<Self>, ports: T) -> Held<T> {
        self.note_entered();
        Held {
            ports: ManuallyDrop::new(ports),
            cell: Rc::clone(self),
        }
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        if self.entered.get() && self.is_gone() {
            self.clean_up();
        }
    }
}

/// Ports of a cell that are left open where it has ended. Its launcher removes all that is left of it; a port that is closed
/// in order takes the files of its service with it by their names, which may be those of the next cell by then.
#[derive(Debug)]
pub struct Held<T> {
    ports: ManuallyDrop<T>,
    cell: Rc<Observer>,
}

impl<T> Deref for Held<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.ports
    }
}

impl<T> DerefMut for Held<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.ports
    }
}

impl<T> Drop for Held<T> {
    fn drop(&mut self) {
        if !self.cell.has_ended() {
            // SAFETY: this is the only place that drops them, and nobody uses them after it.
            unsafe { ManuallyDrop::drop(&mut self.ports) }
        }
    }
}
