//! Restarts: a process in the place of one that was lost, and what a fault script asks for.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bus::sample::Job;
use machine::Process;
use rustix::process::{Signal, pidfd_send_signal};

use super::{Death, Group, Member, READY_LIMIT, READY_LOOK};

impl Group {
    /// The slot of a process.
    pub fn place_of(&self, process: Process) -> Option<usize> {
        self.members.iter().position(|m| m.role.process == process)
    }

    /// How many places there are.
    pub fn places(&self) -> usize {
        self.members.len()
    }

    /// Job, axis and role of a place.
    pub fn role_of(&self, place: usize) -> Option<&super::Role> {
        self.members.get(place).map(|m| &m.role)
    }

    /// Whether another process that does the same, a servo of the same axis or a fieldbus process, lives and takes part.
    pub fn is_covered(&self, process: Process) -> bool {
        let other = |role: &super::Role| {
            let is = role.process;
            is.job == process.job && is.axis == process.axis && is.role != process.role
        };
        let covers = |m: &Member| other(&m.role) && m.takes_part();
        let doubled = matches!(process.job, Job::Servo | Job::Fieldbus);
        doubled && self.members.iter().any(covers)
    }

    /// Whether the process of this place lives and takes part.
    pub fn takes_part(&self, place: usize) -> bool {
        self.members.get(place).is_some_and(Member::takes_part)
    }

    /// Starts a process in the place of one that has ended; it takes part once [`Group::admit_ready`] has admitted it.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn respawn(&mut self, place: usize, after_scan: Option<u64>) -> anyhow::Result<()> {
        let member = self.members.get(place).context("no such place")?;
        let (role, incarnation) = (member.role.clone(), member.incarnation + 1);
        self.cell.give_spare_room();
        let member = self.spawn(place, role, incarnation, after_scan)?;
        if let Some(slot) = self.members.get_mut(place) {
            *slot = member;
        }
        Ok(())
    }

    /// Admits who has got ready meanwhile and tells the cell; their names, with their process ids.
    pub fn admit_ready(&mut self) -> Vec<(String, u32)> {
        let mut admitted = Vec::new();
        for (place, member) in self.members.iter_mut().enumerate() {
            let ready = self.page.ready_incarnation(place) == member.incarnation;
            if member.joining.is_none() || member.status.is_some() || !ready {
                continue;
            }
            member.joining = None;
            self.register.admit(place, member.incarnation);
            admitted.push((member.role.name.clone(), member.child.id()));
        }
        if !admitted.is_empty() {
            self.register.publish(&self.page);
        }
        admitted
    }

    /// Whether somebody is on its way into the roster.
    pub fn somebody_joins(&self) -> bool {
        self.members
            .iter()
            .any(|m| m.joining.is_some() && m.status.is_none())
    }

    /// Ends whoever has not got ready in time; [`Group::reap`] finds it.
    pub fn end_unready(&self) {
        for member in &self.members {
            let joining = member.joining.filter(|_| member.status.is_none());
            if joining.is_some_and(|since| since.elapsed() > READY_LIMIT) {
                tracing::error!("{} does not get ready: ended", member.role.name);
                let _ = pidfd_send_signal(&member.ended, Signal::KILL);
            }
        }
    }

    /// Sends a signal to the process of a place.
    pub fn signal(&self, place: usize, signal: Signal) {
        if let Some(member) = self.members.get(place).filter(|m| m.status.is_none()) {
            let _ = pidfd_send_signal(&member.ended, signal);
        }
    }

    /// Kills the process of a place at `scan`, reaps it, cleans up behind it and tells the cell. None if it does not live.
    pub fn kill_one(&mut self, place: usize, scan: u64) -> Option<Death> {
        let member = self.members.get_mut(place)?;
        if member.status.is_some() {
            return None;
        }
        let _ = pidfd_send_signal(&member.ended, Signal::KILL);
        let status = member.child.wait().ok()?;
        member.status = Some(status);
        member.last_words();
        let death = Death::of(member, place, status);
        self.register.see(scan);
        self.register.note_death(place, status);
        self.free_bus(std::slice::from_ref(&death));
        self.bus.clean_dead();
        self.register.publish(&self.page);
        Some(death)
    }

    /// Starts a process in the place of one that was lost and waits until it takes part from `scan` on.
    ///
    /// # Errors
    /// It cannot be started, or does not get ready.
    pub fn replace(&mut self, place: usize, scan: u64) -> anyhow::Result<()> {
        self.respawn(place, scan.checked_sub(1))?;
        self.register.see(scan);
        let started = Instant::now();
        loop {
            let seen = self.page.launcher_signal().count();
            if !self.admit_ready().is_empty() {
                return Ok(());
            }
            let member = self.members.get_mut(place);
            if let Some(status) = member.and_then(|m| m.child.try_wait().ok().flatten()) {
                bail!("a process ended before it was ready ({status})");
            }
            if started.elapsed() > READY_LIMIT {
                bail!("not ready after {} s", READY_LIMIT.as_secs());
            }
            self.page.launcher_signal().wait(seen, READY_LOOK);
        }
    }

    /// Stops the process of a place (SIGSTOP), or lets the cell wait for it again from `scan` on; the roster reports it.
    pub fn set_stalled(&mut self, place: usize, stalled: bool, scan: u64) {
        if stalled {
            self.signal(place, Signal::STOP);
            self.await_stopped(place);
        }
        self.register.note_stalled(place, stalled);
        self.register.see(scan);
        self.register.publish(&self.page);
    }

    /// A signal takes a moment: waits until every thread of the process stands.
    fn await_stopped(&self, place: usize) {
        let Some(member) = self.members.get(place) else {
            return;
        };
        let stat = format!("/proc/{}/stat", member.child.id());
        let started = Instant::now();
        while started.elapsed() < Duration::from_secs(1) {
            let state = std::fs::read_to_string(&stat).unwrap_or_default();
            let state = state.rsplit_once(')').map(|(_, rest)| rest.trim_start());
            if state.is_none_or(|s| s.starts_with(['T', 'Z', 'X'])) {
                return;
            }
            std::thread::sleep(Duration::from_micros(100));
        }
    }
}
