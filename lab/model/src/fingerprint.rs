//! When two states are the same: everybody will do the same from now on, whatever the scan is called.
//!
//! Scans are counted from the one that is next, incarnations from the newest of their place, windows are named by what they say. What
//! only reports (counts of misses, the digest, causes of the past) is left out. That this is all a process's future depends on is a
//! rule of the product: a servo's state is in its command, a master's in feedback, latches and `inner`, a planner's in `inner`.

use std::hash::{Hash, Hasher};

use bus::sample::{AxisCommand, Feedback, PathTag, WindowId};
use bytemuck::bytes_of;
use servo::ServoState;
use xxhash_rust::xxh3::Xxh3;

use crate::bench::PERIOD_SCANS;
use crate::cell::Cell;
use crate::members::Window;

impl Hash for Cell {
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u64(self.name);
    }
}

impl PartialEq for Cell {
    fn eq(&self, other: &Cell) -> bool {
        self.name == other.name
    }
}

impl std::fmt::Debug for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let lives = |place: crate::members::Place| format!("{:?}{}", place.life, place.incarnation);
        let servos: Vec<String> = self.servos.iter().map(|s| lives(s.place)).collect();
        write!(
            f,
            "scan {} master {} planner {} servos {}",
            self.next_scan(),
            lives(self.master_place),
            lives(self.planner.place),
            servos.join(" "),
        )?;
        if let Some(feedback) = &self.feedback {
            let mode = bus::sample::Mode::from_wire(feedback.mode).map_or("?", |m| m.word());
            let at = [0, 1].map(|axis| feedback.axes[axis].command_position);
            let window = (feedback.window.incarnation, feedback.window.sequence);
            write!(
                f,
                "; {mode} hold {} cause {} last {} window {window:?} setpoint {} rest {} at {at:?}",
                feedback.hold, feedback.cause, feedback.last, feedback.setpoint, feedback.at_rest,
            )?;
        }
        let ghost = &self.ghost;
        write!(
            f,
            "; {:.3} mm stopped {} {:?}",
            ghost.progress_mm, ghost.stopped, ghost.broken
        )
    }
}

/// A scan as seen from the next one, and no further back than anybody looks.
fn back(now: u64, scan: u64) -> u64 {
    now.saturating_sub(scan).min(4)
}

impl Cell {
    /// Takes the fingerprint: after each step.
    pub fn take_name(&mut self) {
        self.name = self.fingerprint();
    }

    /// The same for two states with the same future.
    pub fn fingerprint(&self) -> u64 {
        let mut hash = Xxh3::new();
        let now = self.next_scan();
        (now % PERIOD_SCANS).hash(&mut hash);
        self.hash_places(&mut hash);
        self.hash_master(&mut hash, now);
        self.hash_servos(&mut hash, now);
        self.hash_planner(&mut hash, now);
        self.hash_rest(&mut hash, now);
        hash.finish()
    }

    fn hash_places(&self, hash: &mut Xxh3) {
        for who in self.everybody() {
            self.place(who).life.hash(hash);
        }
        let servos = self.servos.iter().map(|servo| servo.place.incarnation);
        let newest = servos.chain([
            self.planner.place.incarnation,
            self.master_place.incarnation,
        ]);
        for (place, newest) in self.roster.participants.iter().zip(newest) {
            (place.live, newest - place.incarnation).hash(hash);
        }
    }

    /// A window by what it says.
    fn name(&self, now: u64, id: WindowId) -> u64 {
        match self.window(id) {
            Some(window) => self.content(now, window),
            None => u64::from(!id.is_none()),
        }
    }

    fn content(&self, now: u64, window: &Window) -> u64 {
        let mut hash = Xxh3::new();
        let header = &window.header;
        let feedback = self.feedback.as_ref();
        window.content.hash(&mut hash);
        // One that has come to its end stands there.
        let age = now as i64 - header.first_scan as i64;
        age.min(i64::from(header.setpoint_count)).hash(&mut hash);
        (header.visible_from > now, header.ends_program).hash(&mut hash);
        let planner = self.planner.place.incarnation;
        (header.id.incarnation == planner).hash(&mut hash);
        let in_force = feedback.map_or(WindowId::NONE, |f| f.window);
        let master = self.master.as_ref().map(|m| m.feedback());
        (header.predecessor == in_force).hash(&mut hash);
        master
            .is_some_and(|m| header.predecessor == m.window)
            .hash(&mut hash);
        let epochs = [feedback.map(|f| f.epoch), master.map(|m| m.epoch)];
        epochs.map(|e| e == Some(header.epoch)).hash(&mut hash);
        header.predecessor.is_none().hash(&mut hash);
        hash.finish()
    }

    fn hash_feedback(&self, hash: &mut Xxh3, now: u64, feedback: &Feedback) {
        for id in [feedback.window, feedback.armed, feedback.voided] {
            self.name(now, id).hash(hash);
        }
        hash_tag(hash, &feedback.tag);
        hash_tag(hash, &feedback.interrupted_at);
        feedback.program_start.hash(hash);
        let at_end = feedback.at_rest == 1;
        (if at_end { u32::MAX } else { feedback.setpoint }).hash(hash);
        (
            feedback.at_rest,
            feedback.mode,
            feedback.hold,
            feedback.last,
        )
            .hash(hash);
        (feedback.cause, feedback.program).hash(hash);
        (self.master_place.incarnation - feedback.incarnation).hash(hash);
        for (axis, shown) in feedback.axes.iter().take(2).enumerate() {
            (
                shown.motor_position,
                shown.command_position,
                bytemuck::bytes_of(&shown.hand),
            )
                .hash(hash);
            back(now, shown.command_scan).hash(hash);
            shown.velocity_mm_s.to_bits().hash(hash);
            shown.velocity_command_mm_s.to_bits().hash(hash);
            (
                shown.missed_in_a_row.min(4),
                shown.taken_role,
                shown.cause,
                shown.driver,
            )
                .hash(hash);
            self.taken(axis, shown.taken_role, shown.taken_incarnation)
                .hash(hash);
        }
    }

    /// How old the incarnation is that was taken.
    fn taken(&self, axis: usize, role: u32, incarnation: u32) -> Option<u32> {
        let mut servos = self.servos.iter();
        let servo = servos.find(|s| s.axis == axis && s.role == role as usize)?;
        (incarnation > 0).then(|| servo.place.incarnation - incarnation)
    }

    fn hash_master(&self, hash: &mut Xxh3, now: u64) {
        if let Some(feedback) = &self.feedback {
            // What the launcher and the operator see.
            (feedback.mode, feedback.hold, feedback.last).hash(hash);
            (self.master_place.incarnation - feedback.incarnation).hash(hash);
        }
        (self.page.stop, self.inbox.stop).hash(hash);
        self.inbox.go_on.map(|order| order as u32).hash(hash);
        for window in &self.inbox.windows {
            self.content(now, window).hash(hash);
        }
        let Some(master) = &self.master else {
            self.hash_saved(hash);
            return;
        };
        self.hash_feedback(hash, now, &master.feedback());
        let inner = master.inner();
        self.name(now, inner.pending).hash(hash);
        (
            inner.settled_scans,
            inner.rest_scans,
            inner.switching_on,
            inner.ends,
        )
            .hash(hash);
        inner.planner_silent_scans.hash(hash);
        for axis in &inner.axes {
            (axis.switch, axis.followed, axis.silent, axis.deviation).hash(hash);
            self.name(now, axis.pending).hash(hash);
        }
        for (position_mm, velocity_mm_s) in master.drives().axes() {
            (position_mm.to_bits(), velocity_mm_s.to_bits()).hash(hash);
        }
        // What would be left of it, should it be killed before it saves again.
        self.hash_saved(hash);
    }

    fn hash_saved(&self, hash: &mut Xxh3) {
        let Some(saved) = &self.page.saved else {
            return;
        };
        let mut drives = crate::drives::QuietDrives::default();
        let Ok(latches) = saved.restore(&mut drives) else {
            return;
        };
        for (position_mm, _) in drives.axes() {
            position_mm.to_bits().hash(hash);
        }
        hash_tag(hash, &latches.left.tag);
        (latches.program_start, latches.may_end, latches.ends).hash(hash);
        (latches.program, latches.run, latches.override_percent).hash(hash);
        // Of scans only whether the last one published was saved matters.
        (self.page.published == Some(latches.scan)).hash(hash);
    }

    fn hash_servos(&self, hash: &mut Xxh3, now: u64) {
        for servo in &self.servos {
            if !servo.place.life.lives() {
                continue;
            }
            for header in servo.servo.windows() {
                self.name(now, header.id).hash(hash);
                // One that it has only the rest of is another.
                (header.predecessor.is_none(), header.setpoint_count).hash(hash);
            }
            let mut state = servo.servo.state;
            state.scan = back(now, state.scan);
            hash.write(bytes_of(&state));
            for window in &servo.windows {
                self.content(now, window).hash(hash);
            }
            self.hash_command(hash, now, servo.peer.as_ref());
        }
    }

    fn hash_command(&self, hash: &mut Xxh3, now: u64, command: Option<&AxisCommand>) {
        let Some(command) = command else {
            false.hash(hash);
            return;
        };
        let mut state = ServoState::of(command);
        state.scan = back(now, state.scan);
        hash.write(bytes_of(&state));
        back(now, command.scan).hash(hash);
        let (axis, role) = (command.axis as usize, command.role);
        self.taken(axis, role, command.incarnation).hash(hash);
    }

    fn hash_planner(&self, hash: &mut Xxh3, now: u64) {
        if !self.planner.place.life.lives() {
            return;
        }
        let inner = self.planner.planner.inner();
        for (id, returns) in inner.windows {
            (self.name(now, id), returns).hash(hash);
        }
        (inner.expanded_from, inner.returns_from, inner.cause as u32).hash(hash);
        let boundary = now - now % PERIOD_SCANS;
        let answered = self.planner.answered;
        answered.is_some_and(|a| a >= boundary).hash(hash);
    }

    fn hash_rest(&self, hash: &mut Xxh3, now: u64) {
        let launcher = &self.launcher;
        (launcher.interrupted, launcher.ends, launcher.master_left).hash(hash);
        (launcher.exited, launcher.idle).hash(hash);
        let newest = self.master_place.incarnation;
        let asked = launcher.asked.map(|asked| {
            let answered = asked.answered.is_some();
            (
                newest - asked.incarnation,
                answered,
                self.goes_on_after_stop(&asked),
            )
        });
        asked.hash(hash);
        self.budget.hash(hash);
        let ghost = &self.ghost;
        (ghost.broken, ghost.ended, ghost.stopped, ghost.went_on).hash(hash);
        (ghost.progress_mm.to_bits(), ghost.still).hash(hash);
        self.name(now, ghost.window).hash(hash);
        for servo in &self.servos {
            let taken = ghost.taken[servo.axis * 2 + servo.role];
            self.taken(servo.axis, servo.role as u32, taken).hash(hash);
        }
    }
}

fn hash_tag(hash: &mut Xxh3, tag: &PathTag) {
    let distance = tag.distance_mm.to_bits();
    (distance, tag.element, tag.dwell_remaining_scans).hash(hash);
}
