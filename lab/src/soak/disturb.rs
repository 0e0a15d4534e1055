//! What a soak does beside killing and stopping members of its cell: clients that die or stall, orders, a frozen cell, processors that
//! are busy with other things.

use std::process::{Child, ExitStatus};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bus::process::watch;
use bus::sample::Mode;
use plant_sim::script::rng::Rng;
use rustix::process::{Signal, pidfd_send_signal};

use super::Soak;
use super::cell::Cell;
use super::tally::Came;

/// Every command has returned so long after its cause.
pub const RETURN_LIMIT: Duration = Duration::from_secs(3);
/// Clients at once, at most: more than have places in a cell.
const CLIENTS_MAX: u64 = 14;
/// How long clients live before they are killed or stopped, in µs: until before and after their answer.
const CLIENT_LIFE_US: u64 = 80_000;
/// How long they stall, a cell is frozen and processors are busy, in µs.
const STALL_US: (u64, u64) = (50_000, 1_000_000);
/// A machine is in hold so long at most, in µs.
const HOLD_US: u64 = 300_000;
/// Busy threads for each processor.
const BUSY_PER_PROCESSOR: usize = 2;

/// What clients are started as.
const CLIENTS: [&[&str]; 6] = [
    &["status"],
    &["override", "100%"],
    &["hold"],
    &["resume"],
    &["monitor", "--json"],
    &["enable"],
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Disturbance {
    KillClients,
    StallClients,
    Hold,
    Freeze,
    FreezeGroup,
    Starve,
    FillMemory,
    FillDisk,
}

const DISTURBANCES: [Disturbance; 8] = [
    Disturbance::KillClients,
    Disturbance::StallClients,
    Disturbance::Hold,
    Disturbance::Freeze,
    Disturbance::FreezeGroup,
    Disturbance::Starve,
    Disturbance::FillMemory,
    Disturbance::FillDisk,
];

impl Disturbance {
    fn words(self) -> &'static str {
        match self {
            Disturbance::KillClients => "kill 1-14 clients",
            Disturbance::StallClients => "stop 1-14 clients 50-1000 ms",
            Disturbance::Hold => "hold and resume",
            Disturbance::Freeze => "stop cell and launcher 50-1000 ms",
            Disturbance::FreezeGroup => "freeze the cgroup 50-1000 ms",
            Disturbance::Starve => "busy processors 50-1000 ms",
            Disturbance::FillMemory => "full /dev/shm 50-1000 ms",
            Disturbance::FillDisk => "full disk 50-1000 ms",
        }
    }
}

fn some_time(rng: &mut Rng) -> Duration {
    let (low, high) = STALL_US;
    Duration::from_micros(low + rng.below(high - low))
}

impl Soak<'_> {
    /// Disturbs the cell and waits until it is whole again; false if there is nothing more to hit in this run.
    pub(super) fn disturb(&mut self, cell: &mut Cell) -> bool {
        let all = DISTURBANCES;
        let can =
            |what: &&Disturbance| **what != Disturbance::FreezeGroup || self.freezer.is_some();
        let possible: Vec<Disturbance> = all.iter().filter(can).copied().collect();
        let Some(what) = self.rng.pick(&possible).copied() else {
            return true;
        };
        cell.look();
        cell.judge.reactions();
        let scan = cell.scan();
        let freezes = [
            Disturbance::Freeze,
            Disturbance::FreezeGroup,
            Disturbance::Starve,
        ];
        cell.judge.drives_are_left &= self.early;
        cell.judge.drives_are_left |= freezes.contains(&what);
        self.faults += 1;
        match what {
            Disturbance::KillClients => self.kill_clients(cell),
            Disturbance::StallClients => self.stall_clients(cell),
            Disturbance::Hold => self.hold_and_resume(cell),
            Disturbance::Freeze => self.freeze(cell),
            Disturbance::FreezeGroup => self.freeze_group(cell),
            Disturbance::Starve => self.starve(cell),
            Disturbance::FillMemory | Disturbance::FillDisk => self.fill(cell, what),
        }
        // What was frozen shows what it makes of it once it has been asked again.
        let goes_on = cell.look_until(Instant::now() + Duration::from_millis(20));
        let whole = goes_on && self.await_whole(cell);
        let kind = if std::mem::take(&mut self.early) {
            "any, before the one before was over"
        } else {
            what.words()
        };
        let reactions = cell.judge.reactions();
        let ended = cell.status.is_some() || cell.mode() == Some(Mode::Finished);
        self.overrun_scans += u64::from(reactions.overrun_scans);
        self.tally.add(&Came {
            kind,
            reaction: reactions.words(false, ended),
            restart: None,
            whole_scans: (whole && !ended).then(|| cell.scan().saturating_sub(scan) as f64),
        });
        whole
    }

    /// Waits for the end of a command, `RETURN_LIMIT` from its cause at most.
    pub(super) fn await_return(
        &mut self,
        cell: &mut Cell,
        what: &'static str,
        mut child: Child,
        cause: Instant,
    ) -> Option<ExitStatus> {
        loop {
            cell.look();
            if let Ok(Some(status)) = child.try_wait() {
                let ms = cause.elapsed().as_secs_f64() * 1e3;
                self.tally.returned(what, ms);
                return Some(status);
            }
            if cause.elapsed() > RETURN_LIMIT {
                self.violated(format!(
                    "{what} has not returned after {} s, scan {}",
                    RETURN_LIMIT.as_secs(),
                    cell.scan()
                ));
                cell.kill_client(child);
                return None;
            }
            std::thread::sleep(Duration::from_micros(500));
        }
    }

    /// Gives an order that must be obeyed unless the machine trips or the run ends meanwhile.
    fn must_obey(&mut self, cell: &mut Cell, what: &'static str, words: &[&str]) {
        let cause = Instant::now();
        let Some(child) = cell.client(words) else {
            return;
        };
        let status = self.await_return(cell, what, child, cause);
        let refused = status.is_some_and(|status| !status.success());
        let goes_on = cell.look() && cell.mode() == Some(Mode::Enabled);
        // On a busy PC a machine can be stalled at any time, and trips.
        let reactions = cell.judge.reactions;
        if refused && goes_on && !reactions.tripped && !reactions.disabled {
            let mode = cell.mode().map_or("without a mode", Mode::word);
            self.violated(format!(
                "{what} is refused: {mode}, scan {}: {status:?}",
                cell.scan()
            ));
        }
    }

    fn clients(&mut self, cell: &mut Cell) -> Vec<(Child, &'static [&'static str])> {
        let count = 1 + self.rng.below(CLIENTS_MAX);
        let mut clients = Vec::new();
        for _ in 0..count {
            let words = self.rng.pick(&CLIENTS).copied().unwrap_or(&["status"]);
            clients.extend(cell.client(words).map(|child| (child, words)));
            cell.look();
        }
        self.clients += clients.len() as u64;
        let life = Duration::from_micros(self.rng.below(CLIENT_LIFE_US));
        cell.look_until(Instant::now() + life);
        clients
    }

    fn kill_clients(&mut self, cell: &mut Cell) {
        for (client, _) in self.clients(cell) {
            cell.kill_client(client);
        }
        // Their places are free again.
        self.must_obey(cell, "order after killed clients", &["override", "100%"]);
    }

    fn stall_clients(&mut self, cell: &mut Cell) {
        let clients = self.clients(cell);
        for (client, _) in &clients {
            signal(client, Signal::STOP);
        }
        self.must_obey(cell, "hold beside stalled clients", &["hold"]);
        let stall = some_time(&mut self.rng);
        cell.look_until(Instant::now() + stall);
        for (client, words) in clients {
            signal(&client, Signal::CONT);
            if words.contains(&"monitor") {
                signal(&client, Signal::INT);
            }
            self.await_return(cell, "client after its stall", client, Instant::now());
        }
    }

    fn hold_and_resume(&mut self, cell: &mut Cell) {
        self.must_obey(cell, "hold", &["hold"]);
        let pause = Duration::from_micros(self.rng.below(HOLD_US));
        if cell.look_until(Instant::now() + pause) {
            self.must_obey(cell, "resume", &["resume"]);
        }
    }

    fn freeze(&mut self, cell: &mut Cell) {
        let frozen = some_time(&mut self.rng);
        let processes = cell.processes();
        cell.signal_launcher(Signal::STOP);
        processes.iter().for_each(|p| p.signal(Signal::STOP));
        cell.look_until(Instant::now() + frozen);
        processes.iter().for_each(|p| p.signal(Signal::CONT));
        cell.signal_launcher(Signal::CONT);
    }

    fn freeze_group(&mut self, cell: &mut Cell) {
        let frozen = some_time(&mut self.rng);
        let members = cell.processes().into_iter().map(|p| p.pid);
        let pids: Vec<i32> = members.chain([cell.launcher]).collect();
        let Some(freezer) = &self.freezer else { return };
        let done = freezer.freeze(&pids);
        if done.is_ok() {
            cell.look_until(Instant::now() + frozen);
        }
        if let Err(error) = freezer.thaw().and(done) {
            self.violated(format!("the soak cannot freeze its cell: {error}"));
        }
    }

    fn starve(&mut self, cell: &mut Cell) {
        let time = some_time(&mut self.rng);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..threads * BUSY_PER_PROCESSOR {
                scope.spawn(|| {
                    while !is_over.load(Ordering::Relaxed) {
                        std::hint::spin_loop();
                    }
                });
            }
            cell.look_until(Instant::now() + time);
            is_over.store(true, Ordering::Relaxed);
        });
    }
}

impl Soak<'_> {
    /// Nobody gets any room for a while: a client may be refused, and is told so soon.
    fn fill(&mut self, cell: &mut Cell, what: Disturbance) {
        let time = some_time(&mut self.rng);
        let Some(places) = &self.places else { return };
        let filler = match what {
            Disturbance::FillMemory => places.fill_memory(),
            _ => places.fill_disk(),
        };
        if let Err(error) = &filler {
            self.violated(format!("the soak cannot fill its own places: {error}"));
        }
        let asked = Instant::now();
        let client = cell.client(&["status"]);
        cell.look_until(asked + time);
        drop(filler);
        if let Some(client) = client {
            self.await_return(cell, "status without room", client, asked);
        }
    }
}

fn signal(child: &Child, signal: Signal) {
    if let Ok(handle) = watch(child.id()) {
        let _ = pidfd_send_signal(&handle, signal);
    }
}
