//! `quadrant remote serve`: an observer beside the cell that tells other machines what it sees.
//!
//! To the cell it is a monitor like any other: it reads copies from queues that overwrite their oldest, and nobody waits for it. To
//! those who listen it owes nothing either: what the link does not take is dropped. Orders take a way of their own
//! ([`remote_orders`]), if that was asked for.

use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use remote::clock::now_us;
use remote::link::{DEFAULT_LISTEN, Endpoint, Server};
use remote::wire::{FORMAT, MachineReport, plain_text};

use super::events::Weight;
use super::feed::Feed;
use super::source::Source;
use super::{picture, remote_orders};
use crate::options::ServeOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::{joined, say};
use console::signals::Signals;

/// Time between two pictures of the circle.
const CIRCLE_EVERY: Duration = Duration::from_millis(500);
/// Time between two looks for events whose text has changed.
const AMEND_EVERY: Duration = Duration::from_secs(1);
/// Time between two looks for the next cell.
const NEXT_CELL_EVERY: Duration = Duration::from_millis(250);
/// Of a look, this share is spent at the signal of the scan, for the timing.
const LISTEN_SHARE: u32 = 5;
/// Behind whatever controls the machine, where priorities are ordinary.
const NICE: i32 = 10;

/// `quadrant remote serve`.
pub fn serve(options: &ServeOptions) -> Outcome {
    let parse = |places: &[String]| -> Result<Vec<Endpoint>, Failure> {
        let each = places.iter().map(|place| place.parse());
        each.collect::<Result<_, _>>().input()
    };
    let connect = parse(&options.connect)?;
    let mut listen = parse(&options.listen)?;
    if listen.is_empty() && connect.is_empty() {
        listen = parse(&[DEFAULT_LISTEN.to_string()])?;
    }
    let feed = Feed::attach(options.cell.as_deref())?;
    let signals = Signals::catch().environment()?;
    // Whoever may not be nice is served all the same.
    let _ = rustix::process::nice(NICE);
    let machine = machine_of(&feed)?;
    let server = Server::open(machine.clone(), &listen, &connect).environment()?;
    let orders = remote_orders::serve(options, &machine.cell)?;
    let places = joined(listen.iter().chain(&connect), ", ");
    say(&format!(
        "cell {} can be seen at {}, read only, {} times a second; Ctrl-C ends it",
        machine.cell, places, options.rate
    ));
    if !listen.iter().all(Endpoint::is_loopback) {
        say(
            "anybody who reaches this place sees the machine: there is no password (docs/howto/remote.md)",
        );
    }
    let injector = Desk {
        feed,
        server,
        session: machine.session,
        sequence: 0,
        reported_event: 0,
    };
    let done = injector.run(
        Duration::from_secs(1) / u32::try_from(options.rate).unwrap_or(20),
        &signals,
    );
    if let Some(orders) = orders {
        orders.close();
    }
    done
}

/// A number that no other server has: when, and who.
fn new_session() -> u64 {
    (now_us() << 10) | u64::from(std::process::id() & 1023)
}

fn machine_of(feed: &Feed) -> Result<MachineReport, Failure> {
    let text = feed.machine_text().context("the cell's machine file");
    let machine_toml = text.map_err(|error| match feed.is_gone() {
        true => Failure::Stopped(anyhow!("cell {:?} has just ended", feed.model.cell)),
        false => Failure::Environment(error),
    })?;
    Ok(MachineReport {
        format: FORMAT,
        session: new_session(),
        cell: feed.model.cell.clone(),
        machine_toml,
    })
}

struct Desk {
    feed: Feed,
    server: Server,
    session: u64,
    sequence: u64,
    /// Events of the model that were reported.
    reported_event: u64,
}

impl Desk {
    fn run(mut self, period: Duration, signals: &Signals) -> Outcome {
        let mut due = Instant::now();
        let mut circle_due = due;
        let mut amend_due = due;
        let mut next_cell_due = due;
        while signals.count() == 0 {
            self.feed.look();
            self.say_events();
            if self.feed.is_gone() && Instant::now() >= next_cell_due {
                next_cell_due = Instant::now() + NEXT_CELL_EVERY;
                self.next_cell();
            }
            if Instant::now() >= amend_due {
                amend_due = Instant::now() + AMEND_EVERY;
                self.amend_events();
            }
            self.say_snapshot();
            if Instant::now() >= circle_due {
                circle_due = Instant::now() + CIRCLE_EVERY;
                if let Some(circle) = picture::circle(&self.feed.model, self.session) {
                    reported(self.server.say_circle(&circle));
                }
            }
            self.feed.watch_periods(period / LISTEN_SHARE);
            due = (due + period).max(Instant::now());
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        self.server.close();
        Ok(())
    }

    /// The run is over: the next cell of that name is served as soon as there is one.
    fn next_cell(&mut self) {
        self.feed.follow();
        if self.feed.is_gone() {
            return;
        }
        // It may be over before its machine file is read: then the one after it.
        let Ok(machine) = machine_of(&self.feed) else {
            return;
        };
        self.session = machine.session;
        self.sequence = 0;
        self.reported_event = 0;
        self.server.begin(machine);
    }

    fn say_events(&mut self) {
        let events = &self.feed.model.events;
        let before = self.reported_event;
        let new = events.last.iter().filter(|e| e.number > before);
        for event in new {
            // More than the list holds in one look: numbers stay the same on both sides all the same.
            while self.reported_event + 1 < event.number {
                self.reported_event += 1;
                let text = "an event that was not kept".into();
                reported(self.server.say_event(event.scan, false, text));
            }
            self.reported_event = event.number;
            let warning = event.weight == Weight::Warning;
            reported(
                self.server
                    .say_event(event.scan, warning, plain_text(&event.text)),
            );
        }
    }

    /// What comes often is one event, whose count grows.
    fn amend_events(&mut self) {
        for event in &self.feed.model.events.last {
            reported(
                self.server
                    .amend_event(event.number, &plain_text(&event.text)),
            );
        }
    }

    fn say_snapshot(&mut self) {
        self.sequence += 1;
        let mut snapshot = picture::snapshot(&self.feed.model, self.session);
        snapshot.sequence = self.sequence;
        snapshot.events_count = self.server.events_count();
        let age_us = (self.feed.model.feedback_age_s * 1e6) as u64;
        snapshot.heard_us = now_us().saturating_sub(age_us);
        reported(self.server.say_snapshot(&snapshot));
    }
}

/// What cannot be reported is missing to those who listen, who count it; the cell is not concerned.
fn reported(message: Result<(), remote::link::LinkError>) {
    if let Err(error) = message {
        tracing::debug!("{error}");
    }
}
