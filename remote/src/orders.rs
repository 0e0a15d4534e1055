//! Orders from another machine: over TLS alone, where each side shows a certificate of the same authority, and only for those whose
//! names the server was given. A way of its own: whoever looks at the cell takes another one, which takes nothing in.
//!
//! | key expression | what |
//! |---|---|
//! | `quadrant/<cell>/order` | a [`Request`], answered by an [`Answer`] |
//!
//! An order that waited somewhere on its way must not move a machine later. So the client asks for a ticket first; an order counts
//! only with one that the server gave a moment ago, and once. Stop and hold have a thread of their own: no other order that the cell
//! is slow to answer is before them.

mod identity;
mod reach;
mod tickets;

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

use crate::link::{LinkError, bounded, failed};
use crate::wire::{FORMAT, plain_text};

pub use identity::Identity;
use tickets::Tickets;

/// Orders that wait, of each kind; more are refused.
const WAITING_MAX: usize = 4;
/// The largest request or answer, in bytes.
const BYTES_MAX: usize = 2048;
/// So long a session is tried for, by a client that has reached the place.
const SESSION_LIMIT: Duration = Duration::from_secs(2);
/// So long a ticket is waited for: nobody but the server itself has a part in it.
const TICKET_LIMIT: Duration = Duration::from_secs(1);
/// So long an answer is waited for.
const ANSWER_LIMIT: Duration = Duration::from_millis(2800);
/// Orders that wait for no other.
const URGENT: [&str; 4] = ["stop", "hold", "estop", "disable"];

/// Why no order can be given or taken.
#[derive(Debug, thiserror::Error)]
pub enum OrdersError {
    /// Not a place.
    #[error("{0:?}: must be tls/HOST:PORT, for example tls/controller:7448")]
    Endpoint(String),
    /// A certificate or key.
    #[error("{}: {what}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// Nobody may give an order.
    #[error("no operator is named: whose certificates count?")]
    NoOperator,
    /// No common name that a certificate has.
    #[error("{0:?}: must be the common name of a certificate: letters, digits, space, - . _ @")]
    Operator(String),
    /// No name of a cell.
    #[error("{0:?}: must be a cell's name: letters, digits, - and _")]
    Cell(String),
    /// No order: JSON has no such number.
    #[error("the value is no number")]
    Value,
    /// zenoh refused something.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No thread for the orders.
    #[error("a thread for the orders: {0}")]
    Thread(std::io::Error),
    /// No session over TLS: no order was given.
    #[error("{place}: {why}; no order was given")]
    NotReached {
        /// Where.
        place: String,
        /// Why not.
        why: String,
    },
    /// No answer.
    #[error("no answer from {0}: the order may or may not have been obeyed")]
    Silent(String),
    /// No ticket: no order was given.
    #[error(
        "{place} does not listen to {cell:?}: there is no such cell, or the name in this certificate (cert.pem) is none of its \
         operators'; no order was given"
    )]
    NoTicket {
        /// Where.
        place: String,
        /// For which cell.
        cell: String,
    },
}

/// A place that is reached over TLS.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsPlace(String);

impl TlsPlace {
    fn host_and_port(&self) -> (&str, u16) {
        let place = self.0.strip_prefix("tls/").unwrap_or(&self.0);
        let (host, port) = place.rsplit_once(':').unwrap_or((place, ""));
        let host = host.strip_prefix('[').unwrap_or(host);
        (
            host.strip_suffix(']').unwrap_or(host),
            port.parse().unwrap_or(0),
        )
    }
}

impl fmt::Display for TlsPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for TlsPlace {
    type Err = OrdersError;

    fn from_str(text: &str) -> Result<Self, OrdersError> {
        let refuse = || OrdersError::Endpoint(text.into());
        let place = text.strip_prefix("tls/").ok_or_else(refuse)?;
        let (host, port) = place.rsplit_once(':').ok_or_else(refuse)?;
        // Nothing of zenoh's own syntax behind it: no setting of the link comes in with a place.
        let plain = |c: char| c.is_ascii_alphanumeric() || "-.:[]_%".contains(c);
        let good = !host.is_empty() && host.chars().all(plain) && port.parse::<u16>().is_ok();
        good.then(|| TlsPlace(text.into())).ok_or_else(refuse)
    }
}

/// What travels to the server: with ticket 0, the wish for one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    format: u32,
    ticket: u64,
    order: String,
    value: f64,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    format: u32,
    ticket: u64,
    obeyed: bool,
    text: String,
}

fn read<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Option<T> {
    (bytes.len() <= BYTES_MAX).then_some(())?;
    serde_json::from_slice(bytes).ok()
}

/// Where the orders of a cell are given. The name goes into access rules and key expressions, so it has nothing of their syntax.
fn key(cell: &str) -> Result<String, OrdersError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    let good = !cell.is_empty() && cell.chars().all(plain);
    good.then(|| format!("quadrant/{cell}/order"))
        .ok_or_else(|| OrdersError::Cell(cell.into()))
}

/// Rules of the server: an operator's orders and their answers, and nothing else of anybody.
fn rules(key: &str, operators: &[String]) -> String {
    let names: Vec<String> = operators.iter().map(|name| format!("\"{name}\"")).collect();
    format!(
        r#"{{
    enabled: true,
    default_permission: "deny",
    rules: [
        {{ id: "in", messages: ["query"], flows: ["ingress"], permission: "allow", key_exprs: ["{key}"] }},
        {{ id: "out", messages: ["reply", "declare_queryable"], flows: ["egress"], permission: "allow", key_exprs: ["{key}"] }},
    ],
    subjects: [{{ id: "operators", cert_common_names: [{}], link_protocols: ["tls"] }}],
    policies: [{{ rules: ["in", "out"], subjects: ["operators"] }}],
}}"#,
        names.join(",")
    )
}

/// Takes orders for one cell.
#[derive(Debug)]
pub struct OrderServer {
    _queryable: Queryable<()>,
    session: Session,
}

impl OrderServer {
    /// Listens at a place for the orders of those whose certificates have these common names; `obey` gives an order to the cell
    /// and says what came of it, in threads of its own: one for stop and hold, one for the others.
    ///
    /// # Errors
    /// The place cannot be had, or the certificates are not usable.
    pub fn open(
        cell: &str,
        place: &TlsPlace,
        identity: &Identity,
        operators: &[String],
        obey: impl Fn(&str, f64) -> Result<String, String> + Send + Sync + 'static,
    ) -> Result<OrderServer, OrdersError> {
        if operators.is_empty() {
            return Err(OrdersError::NoOperator);
        }
        let plain = |c: char| c.is_ascii_alphanumeric() || " -._@".contains(c);
        for name in operators {
            if name.trim().is_empty() || !name.chars().all(plain) {
                return Err(OrdersError::Operator(name.clone()));
            }
        }
        let key = key(cell)?;
        let mut config = bounded(&format!("[\"{place}\"]"), "[]")?;
        identity.put_into(&mut config)?;
        config
            .insert_json5("access_control", &rules(&key, operators))
            .map_err(failed("zenoh's access rules"))?;
        let opening = format!("opening {place}");
        let session = zenoh::open(config).wait().map_err(failed(&opening))?;
        let desk = Desk::with_threads(obey)?;
        let queryable = session
            .declare_queryable(key)
            .callback(move |query| desk.take(query))
            .wait()
            .map_err(failed("orders"))?;
        Ok(OrderServer {
            _queryable: queryable,
            session,
        })
    }

    /// Leaves in order.
    pub fn close(self) {
        let _ = self.session.close().wait();
    }
}

type Waiting = SyncSender<(Query, Request)>;

/// Where orders come in.
struct Desk {
    tickets: Arc<Mutex<Tickets>>,
    urgent: Waiting,
    others: Waiting,
}

impl Desk {
    fn with_threads(
        obey: impl Fn(&str, f64) -> Result<String, String> + Send + Sync + 'static,
    ) -> Result<Desk, OrdersError> {
        let (tickets, obey) = (Arc::new(Mutex::new(Tickets::default())), Arc::new(obey));
        let thread = |name: &str| {
            let (waiting, orders) = sync_channel(WAITING_MAX);
            let (tickets, obey) = (Arc::clone(&tickets), Arc::clone(&obey));
            std::thread::Builder::new()
                .name(name.into())
                .spawn(move || work(&orders, &tickets, &*obey))
                .map(|_| waiting)
                .map_err(OrdersError::Thread)
        };
        Ok(Desk {
            urgent: thread("urgent orders")?,
            others: thread("orders")?,
            tickets: Arc::clone(&tickets),
        })
    }

    /// Never waits: zenoh's threads have others to serve.
    fn take(&self, query: Query) {
        let bytes = query
            .payload()
            .map(|payload| payload.to_bytes().into_owned());
        let request = bytes.as_deref().and_then(read::<Request>);
        let Some(request) = request.filter(|request| request.format == FORMAT) else {
            answer(
                &query,
                &said(
                    false,
                    "not understood: both sides must be of the same version",
                ),
            );
            return;
        };
        if request.ticket == 0 {
            let mut tickets = self.tickets.lock().unwrap_or_else(PoisonError::into_inner);
            let ticket = tickets.give(Instant::now());
            drop(tickets);
            answer(
                &query,
                &Answer {
                    ticket,
                    ..said(false, "")
                },
            );
            return;
        }
        let waiting = match URGENT.contains(&request.order.as_str()) {
            true => &self.urgent,
            false => &self.others,
        };
        if let Err(TrySendError::Full((query, _))) = waiting.try_send((query, request)) {
            answer(&query, &said(false, "not obeyed: too many orders at once"));
        }
    }
}

/// Obeys one order after the other. Whether one is too old is judged when its turn comes.
fn work(
    orders: &Receiver<(Query, Request)>,
    tickets: &Mutex<Tickets>,
    obey: &impl Fn(&str, f64) -> Result<String, String>,
) {
    while let Ok((query, request)) = orders.recv() {
        let mut known = tickets.lock().unwrap_or_else(PoisonError::into_inner);
        let counts = known.take(request.ticket, Instant::now());
        drop(known);
        let done = match counts {
            true => obey(&request.order, request.value),
            false => Err("not obeyed: the order has come too late, or twice".into()),
        };
        match done {
            Ok(text) => answer(&query, &said(true, &text)),
            Err(text) => answer(&query, &said(false, &text)),
        }
    }
}

fn said(obeyed: bool, text: &str) -> Answer {
    Answer {
        format: FORMAT,
        ticket: 0,
        obeyed,
        text: plain_text(text),
    }
}

fn answer(query: &Query, answer: &Answer) {
    if let Ok(bytes) = serde_json::to_vec(answer) {
        let _ = query.reply(query.key_expr(), bytes).wait();
    }
}

/// Gives an order to a cell on another machine: what came of it, in words; the machine's refusal is the inner error.
///
/// # Errors
/// The server is not reached, knows no such operator, or does not answer.
pub fn give(
    cell: &str,
    place: &TlsPlace,
    identity: &Identity,
    order: &str,
    value: f64,
) -> Result<Result<String, String>, OrdersError> {
    if !value.is_finite() {
        return Err(OrdersError::Value);
    }
    let key = key(cell)?;
    reach::reach(place, identity)?;
    let session = connect(place, identity)?;
    let given = ask_twice(&session, &key, order, value);
    let _ = session.close().wait();
    let answer = match given? {
        Asked::NoTicket => {
            return Err(OrdersError::NoTicket {
                place: place.to_string(),
                cell: cell.into(),
            });
        }
        Asked::Silent => return Err(OrdersError::Silent(place.to_string())),
        Asked::Answered(answer) => answer,
    };
    let text = plain_text(&answer.text);
    Ok(if answer.obeyed { Ok(text) } else { Err(text) })
}

fn connect(place: &TlsPlace, identity: &Identity) -> Result<Session, LinkError> {
    let mut config = bounded("[]", &format!("[\"{place}\"]"))?;
    identity.put_into(&mut config)?;
    for (name, value) in [
        ("mode", "\"client\"".to_string()),
        ("connect/timeout_ms", SESSION_LIMIT.as_millis().to_string()),
        ("connect/exit_on_failure", "true".into()),
    ] {
        let set = config.insert_json5(name, &value);
        set.map_err(failed("zenoh's settings"))?;
    }
    let connecting = format!("connecting to {place}");
    zenoh::open(config).wait().map_err(failed(&connecting))
}

/// What came back.
enum Asked {
    NoTicket,
    Silent,
    Answered(Answer),
}

fn ask_twice(session: &Session, key: &str, order: &str, value: f64) -> Result<Asked, LinkError> {
    let ask = |ticket: u64, limit: Duration| {
        let request = Request {
            format: FORMAT,
            ticket,
            order: order.into(),
            value,
        };
        let bytes = serde_json::to_vec(&request).unwrap_or_default();
        let replies = session
            .get(key)
            .payload(bytes)
            .timeout(limit)
            .wait()
            .map_err(failed("asking"))?;
        let reply = replies.recv_timeout(limit).ok().flatten();
        let sample = reply.and_then(|reply| reply.into_result().ok());
        let bytes = sample.map(|sample| sample.payload().to_bytes().into_owned());
        let answer = bytes.as_deref().and_then(read::<Answer>);
        Ok::<_, LinkError>(answer.filter(|answer| answer.format == FORMAT))
    };
    let Some(first) = ask(0, TICKET_LIMIT)? else {
        return Ok(Asked::NoTicket);
    };
    // A server that does not understand says why at once.
    if first.ticket == 0 {
        return Ok(Asked::Answered(first));
    }
    let answer = ask(first.ticket, ANSWER_LIMIT)?;
    Ok(answer.map_or(Asked::Silent, Asked::Answered))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_names_hold_nothing_of_zenohs_syntax() {
        for bad in [
            "tcp/a:1",
            "tls/a",
            "tls/:1",
            "tls/a:x",
            "tls/a:1;x=2",
            "tls/a:1#b",
        ] {
            assert!(bad.parse::<TlsPlace>().is_err(), "{bad}");
        }
        let place: TlsPlace = "tls/[::1]:7448".parse().expect("a place");
        assert_eq!(place.host_and_port(), ("::1", 7448));
        for bad in ["", "a/b", "**", "a\"", "a b"] {
            assert!(key(bad).is_err(), "{bad}");
        }
    }
}
