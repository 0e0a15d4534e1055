//! The way over zenoh: a server beside the cell, clients anywhere.
//!
//! | key expression | what | how |
//! |---|---|---|
//! | `quadrant/<cell>/snapshot` | [`Snapshot`] | published; dropped where the link is slow |
//! | `quadrant/<cell>/circle` | [`CircleReport`] | published, twice a second; dropped where the link is slow |
//! | `quadrant/<cell>/events` | [`EventReport`] | published; who misses some asks here with `?after=NUMBER` |
//! | `quadrant/<cell>/machine` | [`MachineReport`] | answer |
//! | `quadrant/<cell>/clock` | [`ClockReport`] | answer |
//!
//! Everything is bounded: messages in size, zenoh's queues by number of batches, the socket's send buffer (else the kernel would
//! keep minutes of old snapshots for a slow link), the client's queue by number, answers in length. A server takes nothing in: its
//! access rules refuse every `put`, `delete` and declaration of an answerer from outside, so that a client cannot speak for it to
//! the other clients either.

use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use zenoh::bytes::ZBytes;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::query::{Query, Queryable};
use zenoh::{Config, Session, Wait};

use crate::clock::{RoundTrip, now_us};
use crate::events::History;
use crate::wire::{
    CircleReport, ClockReport, EventHistory, EventReport, FORMAT, MESSAGE_BYTES_MAX, MachineReport,
    Refusal, Snapshot, decode, encode,
};

/// Where a server listens if nothing else is reported: this PC only.
pub const DEFAULT_LISTEN: &str = "tcp/127.0.0.1:7447";
/// Messages that wait for a client that does not look; the newest beyond are dropped and counted.
const HEARD_MAX: usize = 256;
/// Bytes that the kernel keeps for a slow link.
const SEND_BUFFER_BYTES: usize = 64 << 10;
/// A link of which nothing is heard for so long is given up and made again.
const LEASE_MS: u64 = 5000;
/// So long an answer is waited for.
const ANSWER_LIMIT: Duration = Duration::from_secs(5);

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Not a place.
    #[error("{0:?}: must be tcp/HOST:PORT, for example tcp/192.168.0.7:7447")]
    Endpoint(String),
    /// zenoh refused something.
    #[error("{what}: {why}")]
    Zenoh {
        /// What was tried.
        what: String,
        /// Why it failed.
        why: String,
    },
    /// What was to be reported would not be believed.
    #[error("not reported: {0}")]
    Refused(#[from] Refusal),
}

/// A place to listen at or to connect to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint(String);

impl Endpoint {
    /// Whether only this PC can reach it.
    pub fn is_loopback(&self) -> bool {
        let host = self.0.trim_start_matches("tcp/");
        let host = host.rsplit_once(':').map_or(host, |(host, _)| host);
        let address = host.trim_start_matches('[').trim_end_matches(']');
        let loopback = |ip: std::net::IpAddr| ip.is_loopback();
        host == "localhost" || address.parse().is_ok_and(loopback)
    }
}

impl std::fmt::Display for Endpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for Endpoint {
    type Err = LinkError;

    fn from_str(text: &str) -> Result<Self, LinkError> {
        let refuse = || LinkError::Endpoint(text.into());
        let place = text.strip_prefix("tcp/").ok_or_else(refuse)?;
        let (host, port) = place.rsplit_once(':').ok_or_else(refuse)?;
        // Nothing of zenoh's own syntax behind it: settings are made here.
        let plain = |c: char| c.is_ascii_alphanumeric() || "-.:[]_%".contains(c);
        let good = !host.is_empty() && host.chars().all(plain) && port.parse::<u16>().is_ok();
        good.then(|| Endpoint(text.into())).ok_or_else(refuse)
    }
}

pub(crate) fn failed(what: &str) -> impl Fn(zenoh::Error) -> LinkError + '_ {
    move |why| LinkError::Zenoh {
        what: what.into(),
        why: why.to_string(),
    }
}

/// Settings of both sides, for plain places.
fn config(listen: &[Endpoint], connect: &[Endpoint]) -> Result<Config, LinkError> {
    let list = |endpoints: &[Endpoint]| {
        let each = endpoints
            .iter()
            .map(|endpoint| format!("\"{endpoint}#so_sndbuf={SEND_BUFFER_BYTES}\""));
        format!("[{}]", each.collect::<Vec<_>>().join(","))
    };
    bounded(&list(listen), &list(connect))
}

/// No discovery, no links but those that are named (lists of places, as zenoh writes them), everything bounded.
pub(crate) fn bounded(listen: &str, connect: &str) -> Result<Config, LinkError> {
    let settings = [
        ("mode", "\"peer\"".to_string()),
        ("listen/endpoints", listen.into()),
        ("connect/endpoints", connect.into()),
        ("connect/timeout_ms", "-1".into()),
        ("connect/exit_on_failure", "false".into()),
        (
            "connect/retry",
            "{ period_init_ms: 250, period_max_ms: 1000, period_increase_factor: 2 }".into(),
        ),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
        ("transport/unicast/max_sessions", "16".into()),
        ("transport/link/tx/lease", LEASE_MS.to_string()),
        (
            "transport/link/rx/max_message_size",
            (2 * MESSAGE_BYTES_MAX).to_string(),
        ),
    ];
    let mut config = Config::default();
    for (name, value) in settings {
        config
            .insert_json5(name, &value)
            .map_err(failed(&format!("zenoh's setting {name} = {value}")))?;
    }
    Ok(config)
}

/// Nobody speaks to a server but by asking.
const READ_ONLY: &str = r#"{
    enabled: true,
    default_permission: "allow",
    rules: [{
        id: "nothing-comes-in",
        messages: ["put", "delete", "declare_queryable", "liveliness_token"],
        flows: ["ingress"],
        permission: "deny",
        key_exprs: ["**"],
    }],
    subjects: [{ id: "anybody" }],
    policies: [{ rules: ["nothing-comes-in"], subjects: ["anybody"] }],
}"#;

fn key(cell: &str, what: &str) -> String {
    format!("quadrant/{cell}/{what}")
}

/// What answers are made from.
#[derive(Debug)]
struct Answers {
    machine: MachineReport,
    history: History,
}

/// The server's end.
#[derive(Debug)]
pub struct Server {
    snapshots: Publisher<'static>,
    circles: Publisher<'static>,
    events: Publisher<'static>,
    _queryables: Vec<Queryable<()>>,
    answers: Arc<Mutex<Answers>>,
    /// Bytes handed to zenoh so far.
    pub bytes: u64,
    session: Session,
}

impl Server {
    /// Opens the places; answers questions about `machine` from now on.
    ///
    /// # Errors
    /// A place cannot be had.
    pub fn open(
        machine: MachineReport,
        listen: &[Endpoint],
        connect: &[Endpoint],
    ) -> Result<Server, LinkError> {
        let places: Vec<String> = listen.iter().chain(connect).map(|e| e.0.clone()).collect();
        let what = format!("opening {}", places.join(", "));
        let mut config = config(listen, connect)?;
        config
            .insert_json5("access_control", READ_ONLY)
            .map_err(failed("zenoh's access rules"))?;
        let session = zenoh::open(config).wait().map_err(failed(&what))?;
        let cell = machine.cell.clone();
        let publisher = |name: &str| {
            session
                .declare_publisher(key(&cell, name))
                .congestion_control(CongestionControl::Drop)
                .wait()
                .map_err(failed(name))
        };
        let history = History::new(machine.session);
        let answers = Arc::new(Mutex::new(Answers { machine, history }));
        let queryable = |name: &str, answer: fn(&Query, &Answers) -> Result<Vec<u8>, Refusal>| {
            let answers = Arc::clone(&answers);
            session
                .declare_queryable(key(&cell, name))
                .callback(move |query| {
                    let message = {
                        let answers = answers.lock().unwrap_or_else(PoisonError::into_inner);
                        answer(&query, &answers)
                    };
                    // Nobody else waits for a client that is slow to take it.
                    if let Ok(bytes) = message {
                        let _ = query.reply(query.key_expr(), bytes).wait();
                    }
                })
                .wait()
                .map_err(failed(name))
        };
        let queryables = vec![
            queryable("machine", |_, answers| encode(&answers.machine))?,
            queryable("clock", |_, answers| {
                encode(&ClockReport {
                    format: FORMAT,
                    session: answers.machine.session,
                    clock_us: now_us(),
                })
            })?,
            queryable("events", |query, answers| {
                let after = query.parameters().get("after").unwrap_or_default();
                encode(&answers.history.after(after.parse().unwrap_or(0)))
            })?,
        ];
        Ok(Server {
            snapshots: publisher("snapshot")?,
            circles: publisher("circle")?,
            events: publisher("events")?,
            _queryables: queryables,
            answers,
            bytes: 0,
            session,
        })
    }

    /// Another cell of the same name: numbers begin again.
    pub fn begin(&mut self, machine: MachineReport) {
        let history = History::new(machine.session);
        *self.answers() = Answers { machine, history };
    }

    fn answers(&self) -> std::sync::MutexGuard<'_, Answers> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Numbers, remembers and says an event.
    ///
    /// # Errors
    /// zenoh refuses it; it is remembered all the same.
    pub fn say_event(&mut self, scan: u64, warning: bool, text: String) -> Result<(), LinkError> {
        let event = self.answers().history.add(scan, warning, text);
        self.publish_event(&event)
    }

    /// Says an event again if its text is another by now.
    ///
    /// # Errors
    /// zenoh refuses it.
    pub fn amend_event(&mut self, number: u64, text: &str) -> Result<(), LinkError> {
        let amended = self.answers().history.amend(number, text);
        amended.map_or(Ok(()), |event| self.publish_event(&event))
    }

    /// Number of the last event.
    pub fn events_count(&self) -> u64 {
        self.answers().history.count()
    }

    fn publish_event(&mut self, event: &EventReport) -> Result<(), LinkError> {
        let bytes = encode(event)?;
        self.bytes += bytes.len() as u64;
        self.events
            .put(bytes)
            .wait()
            .map_err(failed("saying an event"))
    }

    /// Says how the cell is.
    ///
    /// # Errors
    /// It is not plausible itself, or zenoh refuses it.
    pub fn say_snapshot(&mut self, snapshot: &Snapshot) -> Result<(), LinkError> {
        let bytes = encode(snapshot)?;
        self.bytes += bytes.len() as u64;
        let put = self.snapshots.put(bytes).wait();
        put.map_err(failed("saying a snapshot"))
    }

    /// Says what the circle looks like.
    ///
    /// # Errors
    /// It is not plausible itself, or zenoh refuses it.
    pub fn say_circle(&mut self, circle: &CircleReport) -> Result<(), LinkError> {
        let bytes = encode(circle)?;
        self.bytes += bytes.len() as u64;
        let put = self.circles.put(bytes).wait();
        put.map_err(failed("saying a circle"))
    }

    /// Leaves in order.
    pub fn close(self) {
        let _ = self.session.close().wait();
    }
}

/// Something that came and is believed.
#[derive(Debug, Clone, PartialEq)]
pub enum Heard {
    /// How the cell is.
    Snapshot(Box<Snapshot>),
    /// What the circle looks like.
    Circle(Box<CircleReport>),
    /// Something happened.
    Event(EventReport),
    /// What happened before.
    History(EventHistory),
    /// Which machine it is.
    Machine(MachineReport),
    /// The server's clock, by a round trip.
    Clock(u64, RoundTrip),
}

#[derive(Debug, Clone, Copy)]
enum What {
    Snapshot,
    Circle,
    Event,
    History,
    Machine,
    /// Asked when, answered when.
    Clock(u64, u64),
}

#[derive(Debug)]
struct Raw {
    cell: String,
    what: What,
    bytes: Vec<u8>,
}

/// What a client did not take.
#[derive(Debug, Default)]
struct Counts {
    refused: AtomicU64,
    dropped: AtomicU64,
}

/// A client's queue, filled by zenoh's threads.
#[derive(Debug, Clone)]
struct Ear {
    queue: SyncSender<Raw>,
    counts: Arc<Counts>,
}

impl Ear {
    fn take(&self, what: What, key: &str, payload: &ZBytes) {
        if payload.len() > MESSAGE_BYTES_MAX {
            self.counts.refused.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let raw = Raw {
            cell: key.split('/').nth(1).unwrap_or_default().into(),
            what,
            bytes: payload.to_bytes().into_owned(),
        };
        if self.queue.try_send(raw).is_err() {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The client's end.
#[derive(Debug)]
pub struct Client {
    session: Session,
    _subscribers: Vec<Subscriber<()>>,
    heard: Receiver<Raw>,
    ear: Ear,
}

impl Client {
    /// Connects, now or as soon as it can be, and listens for the cell of this name, or for all.
    ///
    /// # Errors
    /// zenoh cannot be set up. That nobody is there is no error: it may come.
    pub fn open(to: &Endpoint, cell: Option<&str>) -> Result<Client, LinkError> {
        let config = config(&[], std::slice::from_ref(to))?;
        let what = format!("connecting to {to}");
        let session = zenoh::open(config).wait().map_err(failed(&what))?;
        let (queue, heard) = sync_channel(HEARD_MAX);
        let ear = Ear {
            queue,
            counts: Arc::default(),
        };
        let mut subscribers = Vec::new();
        let topics = [
            ("snapshot", What::Snapshot),
            ("circle", What::Circle),
            ("events", What::Event),
        ];
        for (name, what) in topics {
            let ear = ear.clone();
            let subscriber = session
                .declare_subscriber(key(cell.unwrap_or("*"), name))
                .callback(move |sample| {
                    ear.take(what, sample.key_expr().as_str(), sample.payload());
                })
                .wait()
                .map_err(failed(name))?;
            subscribers.push(subscriber);
        }
        Ok(Client {
            session,
            _subscribers: subscribers,
            heard,
            ear,
        })
    }

    fn ask(&self, cell: &str, what: &str, parameters: &str, kind: fn(u64, u64) -> What) {
        let ear = self.ear.clone();
        let asked_us = now_us();
        let selector = format!("{}{parameters}", key(cell, what));
        let asked = self
            .session
            .get(selector)
            .timeout(ANSWER_LIMIT)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    let kind = kind(asked_us, now_us());
                    ear.take(kind, sample.key_expr().as_str(), sample.payload());
                }
            });
        // Where nobody answers, it is asked again.
        let _ = asked.wait();
    }

    /// Asks for the machine.
    pub fn ask_machine(&self, cell: &str) {
        self.ask(cell, "machine", "", |_, _| What::Machine);
    }

    /// Asks for the server's clock.
    pub fn ask_clock(&self, cell: &str) {
        self.ask(cell, "clock", "", What::Clock);
    }

    /// Asks for events after a number.
    pub fn ask_events(&self, cell: &str, after: u64) {
        let parameters = format!("?after={after}");
        self.ask(cell, "events", &parameters, |_, _| What::History);
    }

    /// The next message that is believed, and its cell; none if nothing waits. Waits up to `limit` for one.
    pub fn next(&mut self, limit: Duration) -> Option<(String, Heard)> {
        loop {
            let raw = match limit.is_zero() {
                true => self.heard.try_recv().ok()?,
                false => self.heard.recv_timeout(limit).ok()?,
            };
            match understood(&raw) {
                Ok(heard) => return Some((raw.cell, heard)),
                Err(error) => {
                    tracing::debug!("a message of cell {} is refused: {error}", raw.cell);
                    self.ear.counts.refused.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    }

    /// Messages that were not believed.
    pub fn refused(&self) -> u64 {
        self.ear.counts.refused.load(Ordering::Relaxed)
    }

    /// Messages for which there was no room.
    pub fn dropped(&self) -> u64 {
        self.ear.counts.dropped.load(Ordering::Relaxed)
    }
}

fn understood(raw: &Raw) -> Result<Heard, Refusal> {
    Ok(match raw.what {
        What::Snapshot => Heard::Snapshot(Box::new(decode(&raw.bytes)?)),
        What::Circle => Heard::Circle(Box::new(decode(&raw.bytes)?)),
        What::Event => Heard::Event(decode(&raw.bytes)?),
        What::History => Heard::History(decode(&raw.bytes)?),
        What::Machine => Heard::Machine(decode(&raw.bytes)?),
        What::Clock(asked_us, answered_us) => {
            let message: ClockReport = decode(&raw.bytes)?;
            let trip = RoundTrip {
                asked_us,
                server_us: message.clock_us,
                answered_us,
            };
            Heard::Clock(message.session, trip)
        }
    })
}
