//! Takes what a server says of a cell on another machine into a model.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use machine::Machine;
use remote::clock::{Clocks, now_us};
use remote::events::{Follower, Reported};
use remote::link::{Client, Endpoint, Heard};
use remote::state::LinkState;
use remote::wire::Snapshot;

use super::events::Weight;
use super::model::Model;
use super::picture;
use super::source::Source;
use super::state::{round, rounded};
use console::exit::{Failure, Kind};

/// Nobody who is there is silent for so long.
const PATIENCE: Duration = Duration::from_secs(10);
/// So long the names of cells are gathered where none is named.
const GATHER: Duration = Duration::from_millis(400);
/// A link of which nothing was heard for so long counts as lost.
const LOST: Duration = Duration::from_secs(1);
/// Time between two questions for the server's clock.
const CLOCK_EVERY: Duration = Duration::from_millis(500);
/// Time between two questions for the same thing.
const ASK_EVERY: Duration = Duration::from_millis(300);
/// Messages that one look takes at most.
const LOOK_MAX: usize = 512;

/// An ear at a server, and the model it fills.
pub struct RemoteFeed {
    model: Model,
    link: LinkState,
    client: Client,
    cell: String,
    session: u64,
    clocks: Clocks,
    follower: Follower,
    /// The last snapshot: its number, and when its feedback came.
    sequence: u64,
    heard_us: u64,
    /// When it came.
    heard: Instant,
    asked_clock: Option<Instant>,
    asked: Option<Instant>,
    /// Another server speaks for this cell now: its number.
    next_session: Option<u64>,
}

impl RemoteFeed {
    /// Listens to the server at this place, for the cell of this name or the only one it has.
    ///
    /// # Errors
    /// Not a place; nobody there within 10 s; several cells.
    pub fn attach(server: &str, cell: Option<&str>) -> Result<RemoteFeed, Failure> {
        let to: Endpoint = server.parse().input()?;
        if let Some(cell) = cell {
            bus::cell::CellPaths::new(cell).input()?;
        }
        let mut client = Client::open(&to, cell).environment()?;
        let (cell, session) = first_heard(&mut client, &to, cell)?;
        let machine = machine_of(&mut client, &to, &cell, session)?;
        Ok(RemoteFeed {
            model: Model::new(&cell, machine),
            link: LinkState {
                server: to.to_string(),
                ..LinkState::default()
            },
            client,
            cell,
            session,
            clocks: Clocks::default(),
            follower: Follower::default(),
            sequence: 0,
            heard_us: 0,
            heard: Instant::now(),
            asked_clock: None,
            asked: None,
            next_session: None,
        })
    }

    fn take(&mut self, heard: Heard) {
        let session = match &heard {
            Heard::Snapshot(message) => message.session,
            Heard::Circle(message) => message.session,
            Heard::Event(message) => message.session,
            Heard::History(message) => message.session,
            Heard::Machine(message) => message.session,
            Heard::Clock(session, _) => *session,
        };
        if session != self.session {
            self.another_server(session, &heard);
            return;
        }
        let mut reported = Vec::new();
        match heard {
            Heard::Snapshot(message) => {
                // The server that was thought lost speaks again.
                self.next_session = None;
                self.snapshot(*message);
            }
            Heard::Circle(message) => self.model.shown.circle = Some(message.circle),
            Heard::Event(event) => self.follower.take(event, &mut reported),
            Heard::History(history) => self.follower.history(history, &mut reported),
            Heard::Machine(_) => {}
            Heard::Clock(_, trip) => self.clocks.take(trip),
        }
        for reported in reported {
            self.event(reported);
        }
    }

    /// What another server says counts once this one is silent: the cell was restarted, or its server was.
    fn another_server(&mut self, session: u64, heard: &Heard) {
        if self.heard.elapsed() < LOST && !self.model.ended {
            return;
        }
        match heard {
            Heard::Machine(message) if self.next_session == Some(session) => {
                let Ok(machine) = Machine::parse("machine.toml", &message.machine_toml) else {
                    return;
                };
                self.model = Model::new(&self.cell, machine);
                self.session = session;
                self.next_session = None;
                self.clocks.clear();
                self.follower = Follower::default();
                self.sequence = 0;
                self.asked_clock = None;
                self.heard = Instant::now();
            }
            Heard::Snapshot(_) => self.next_session = Some(session),
            _ => {}
        }
    }

    fn snapshot(&mut self, message: Snapshot) {
        let (sequence, events_count) = (message.sequence, message.events_count);
        let heard_us = message.heard_us;
        if sequence <= self.sequence || !picture::fill(&mut self.model, message) {
            return;
        }
        if self.sequence > 0 {
            let lost = sequence - self.sequence - 1;
            self.link.snapshots_lost = self.link.snapshots_lost.saturating_add(lost);
        }
        self.link.snapshots += 1;
        self.sequence = sequence;
        self.heard_us = heard_us;
        self.heard = Instant::now();
        self.follower.there_are(events_count);
        picture::from_afar(&mut self.model.shown.state);
    }

    /// What is known of the link, beside the cell's state.
    fn tell_link(&mut self) {
        let age = self.clocks.age(self.heard_us, now_us());
        let age = age.filter(|_| self.sequence > 0);
        let link = &mut self.link;
        link.data_age_s_max = round(age.map(|age| age.max_s), 4);
        link.data_age_s_min = round(age.map(|age| age.min_s), 4);
        link.round_trip_s = round(self.clocks.round_trip_s(), 4);
        link.silent_s = rounded(self.heard.elapsed().as_secs_f64(), 3);
        link.link_lost = self.heard.elapsed() >= LOST;
        link.messages_refused = self.client.refused();
        link.messages_dropped = self.client.dropped();
        link.events = self.model.events.count;
        picture::tell_link(&mut self.model.shown.state, link);
    }

    fn event(&mut self, reported: Reported) {
        let weight = |warning: bool| {
            if warning {
                Weight::Warning
            } else {
                Weight::Note
            }
        };
        let events = &mut self.model.events;
        match reported {
            Reported::New(event) => {
                let weight = weight(event.warning);
                events.note_as(event.number, event.scan, weight, event.text);
            }
            Reported::Amended(event) => events.amend(event.number, event.text),
            Reported::Lost(count) => {
                self.link.events_lost = self.link.events_lost.saturating_add(count);
            }
        }
    }

    /// Asks for whatever is due.
    fn ask(&mut self) {
        let due = |asked: Option<Instant>, every: Duration| {
            asked.is_none_or(|asked| asked.elapsed() >= every)
        };
        if due(self.asked_clock, CLOCK_EVERY) {
            self.asked_clock = Some(Instant::now());
            self.client.ask_clock(&self.cell);
        }
        if !due(self.asked, ASK_EVERY) {
            return;
        }
        if self.next_session.is_some() {
            self.asked = Some(Instant::now());
            self.client.ask_machine(&self.cell);
        } else if let Some(after) = self.follower.ask_after() {
            self.asked = Some(Instant::now());
            self.client.ask_events(&self.cell, after);
        }
    }
}

impl Source for RemoteFeed {
    fn model(&self) -> &Model {
        &self.model
    }

    fn look(&mut self) {
        for _ in 0..LOOK_MAX {
            let Some((cell, heard)) = self.client.next(Duration::ZERO) else {
                break;
            };
            if cell == self.cell {
                self.take(heard);
            }
        }
        self.ask();
        self.tell_link();
        self.model.end_of_look();
    }

    fn is_whole(&self) -> bool {
        let state = &self.model.shown.state;
        let axes = &state.axes;
        let errors = axes.iter().all(|axis| axis.following_error_um.is_some());
        let events = self.follower.ask_after().is_none();
        self.link.data_age_s_max.is_some() && state.scan.is_some() && errors && events
    }

    /// A server that is gone may come back; the end of a run is reported.
    fn has_ended(&self) -> bool {
        self.model.ended
    }

    fn watch_periods(&mut self, budget: Duration) {
        std::thread::sleep(budget);
    }

    /// The server does.
    fn follow(&mut self) {}

    fn takes_orders(&self) -> bool {
        false
    }
}

/// Name and session of the cell that is heard there.
fn first_heard(
    client: &mut Client,
    to: &Endpoint,
    cell: Option<&str>,
) -> Result<(String, u64), Failure> {
    let started = Instant::now();
    let mut found: Vec<(String, u64)> = Vec::new();
    let mut limit = PATIENCE;
    while started.elapsed() < limit {
        let Some((name, Heard::Snapshot(message))) = client.next(Duration::from_millis(50)) else {
            continue;
        };
        if bus::cell::CellPaths::new(&name).is_err() {
            continue;
        }
        if found.is_empty() && cell.is_none() {
            limit = limit.min(started.elapsed() + GATHER);
        }
        found.retain(|(known, _)| *known != name);
        found.push((name, message.session));
        if cell.is_some() {
            break;
        }
    }
    let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
    match names.len() {
        1 => Ok(found.remove(0)),
        0 => {
            let whom = cell.map_or("any cell".to_string(), |cell| format!("cell {cell:?}"));
            let refused = match client.refused() {
                0 => String::new(),
                count => {
                    format!(" ({count} messages were refused: is it another version of quadrant?)")
                }
            };
            Err(Failure::Stopped(anyhow!(
                "nothing was heard of {whom} from {to} within {} s{refused}: does `quadrant remote serve` run there?",
                PATIENCE.as_secs()
            )))
        }
        _ => Err(Failure::Input(anyhow!(
            "{to} has several cells: name one with --cell: {}",
            names.join(", ")
        ))),
    }
}

fn machine_of(
    client: &mut Client,
    to: &Endpoint,
    cell: &str,
    session: u64,
) -> Result<Machine, Failure> {
    let started = Instant::now();
    let mut asked: Option<Instant> = None;
    while started.elapsed() < PATIENCE {
        if asked.is_none_or(|asked| asked.elapsed() > Duration::from_secs(1)) {
            asked = Some(Instant::now());
            client.ask_machine(cell);
        }
        if let Some((name, Heard::Machine(message))) = client.next(Duration::from_millis(50))
            && name == cell
            && message.session == session
        {
            let parsed = Machine::parse("machine.toml", &message.machine_toml);
            return parsed.map_err(|error| {
                Failure::Stopped(anyhow!(
                    "{to} sends a machine file this program does not take: {error}"
                ))
            });
        }
    }
    Err(Failure::Stopped(anyhow!(
        "{to} speaks of cell {cell:?} but does not say what machine it is"
    )))
}
