//! The way over zenoh, with somebody hostile at either end.

use std::net::TcpListener;
use std::time::{Duration, Instant};

use remote::events::{Follower, REMEMBERED, Reported};
use remote::link::{Client, Endpoint, Heard, Server};
use remote::wire::{FORMAT, MESSAGE_BYTES_MAX, MachineReport, Snapshot};
use zenoh::Wait;

const PATIENCE: Duration = Duration::from_secs(30);

fn place() -> Endpoint {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("its number").port();
    format!("tcp/127.0.0.1:{port}").parse().expect("a place")
}

fn machine(cell: &str) -> MachineReport {
    MachineReport {
        format: FORMAT,
        session: 42,
        cell: cell.into(),
        machine_toml: "[scan]\n".into(),
    }
}

fn snapshot(sequence: u64) -> Snapshot {
    Snapshot {
        format: FORMAT,
        session: 42,
        sequence,
        heard_us: 1,
        ..Snapshot::default()
    }
}

/// A peer that obeys no rule of ours.
fn stranger(listen: Option<&Endpoint>, connect: Option<&Endpoint>) -> zenoh::Session {
    let list = |endpoint: Option<&Endpoint>| {
        let each = endpoint.map(|endpoint| format!("\"{endpoint}\""));
        format!("[{}]", each.unwrap_or_default())
    };
    let mut config = zenoh::Config::default();
    for (name, value) in [
        ("listen/endpoints", list(listen)),
        ("connect/endpoints", list(connect)),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
    ] {
        config.insert_json5(name, &value).expect("a setting");
    }
    zenoh::open(config).wait().expect("a peer")
}

/// Lets the server speak until the client has heard so many snapshots; everything it heard.
fn hear(server: &mut Server, client: &mut Client, snapshots: usize) -> Vec<Heard> {
    let started = Instant::now();
    let mut heard = Vec::new();
    let mut sequence = 0;
    let count = |heard: &[Heard]| {
        let snapshots = heard.iter().filter(|h| matches!(h, Heard::Snapshot(_)));
        snapshots.count()
    };
    while count(&heard) < snapshots {
        assert!(started.elapsed() < PATIENCE, "only {heard:?}");
        sequence += 1;
        server.say_snapshot(&snapshot(sequence)).expect("message");
        while let Some((_, one)) = client.next(Duration::from_millis(10)) {
            heard.push(one);
        }
    }
    heard
}

#[test]
fn snapshots_come_and_questions_are_answered() {
    let place = place();
    let mut server =
        Server::open(machine("a"), std::slice::from_ref(&place), &[]).expect("a server");
    let mut client = Client::open(&place, Some("a")).expect("a client");
    for number in 0..3 {
        let text = format!("event {number}");
        server.say_event(number, false, text).expect("message");
    }
    hear(&mut server, &mut client, 3);
    client.ask_machine("a");
    client.ask_clock("a");
    client.ask_events("a", 1);
    let started = Instant::now();
    let (mut machine, mut clock, mut history) = (None, None, None);
    while machine.is_none() || clock.is_none() || history.is_none() {
        assert!(
            started.elapsed() < PATIENCE,
            "{machine:?} {clock:?} {history:?}"
        );
        match client.next(Duration::from_millis(50)) {
            Some((_, Heard::Machine(message))) => machine = Some(message),
            Some((_, Heard::Clock(session, trip))) => clock = Some((session, trip)),
            Some((_, Heard::History(message))) => history = Some(message),
            _ => {}
        }
    }
    assert_eq!(machine.expect("one").machine_toml, "[scan]\n");
    let (session, trip) = clock.expect("one");
    assert_eq!(session, 42);
    // Both ends are on one host here: one clock.
    assert!(
        trip.asked_us <= trip.server_us && trip.server_us <= trip.answered_us,
        "{trip:?}"
    );
    let numbers: Vec<u64> = history
        .expect("one")
        .events
        .iter()
        .map(|e| e.number)
        .collect();
    assert_eq!(numbers, [2, 3]);
}

/// Who came late, and who lost most of what was published: in order, each once.
#[test]
fn a_client_that_comes_late_asks_for_all_events_that_are_remembered() {
    let place = place();
    let mut server =
        Server::open(machine("a"), std::slice::from_ref(&place), &[]).expect("a server");
    let all = REMEMBERED as u64 + 100;
    for number in 1..=all {
        server
            .say_event(number, false, format!("event {number}"))
            .expect("message");
    }
    let mut client = Client::open(&place, Some("a")).expect("a client");
    hear(&mut server, &mut client, 1);
    let mut follower = Follower::default();
    follower.there_are(all);
    let mut reported = Vec::new();
    let started = Instant::now();
    while let Some(after) = follower.ask_after() {
        assert!(started.elapsed() < PATIENCE, "{} reported", reported.len());
        client.ask_events("a", after);
        while let Some((_, heard)) = client.next(Duration::from_millis(200)) {
            if let Heard::History(history) = heard {
                follower.history(history, &mut reported);
                break;
            }
        }
    }
    assert_eq!(reported.first(), Some(&Reported::Lost(100)));
    assert_eq!(reported.len(), REMEMBERED + 1);
}

#[test]
fn what_a_hostile_server_sends_is_refused_and_counted() {
    let place = place();
    let hostile = stranger(Some(&place), None);
    let mut client = Client::open(&place, None).expect("a client");
    let garbage: [(&str, Vec<u8>); 5] = [
        ("quadrant/a/snapshot", b"no JSON".to_vec()),
        ("quadrant/a/snapshot", b"{\"format\":1}".to_vec()),
        ("quadrant/a/events", vec![0xff; 100]),
        ("quadrant/a/circle", vec![b' '; MESSAGE_BYTES_MAX + 1]),
        ("quadrant/a/events", b"{\"format\":99}".to_vec()),
    ];
    let started = Instant::now();
    while client.refused() < 10 {
        assert!(started.elapsed() < PATIENCE, "{} refused", client.refused());
        for (key, bytes) in &garbage {
            hostile.put(*key, bytes.clone()).wait().expect("put");
        }
        assert_eq!(client.next(Duration::from_millis(50)), None);
    }
    // Too much for the client's queue costs the server's messages, not the client's memory.
    for _ in 0..5000 {
        hostile
            .put("quadrant/a/snapshot", vec![b'x'; 1000])
            .wait()
            .expect("put");
    }
    while client.dropped() == 0 {
        assert!(started.elapsed() < PATIENCE, "nothing was dropped");
        hostile
            .put("quadrant/a/snapshot", vec![b'x'; 1000])
            .wait()
            .expect("put");
    }
}

/// Read only is not a promise of clients: what a stranger says through a server reaches nobody.
#[test]
fn a_stranger_cannot_speak_to_other_clients_through_a_server() {
    let place = place();
    let mut server =
        Server::open(machine("a"), std::slice::from_ref(&place), &[]).expect("a server");
    let mut client = Client::open(&place, Some("a")).expect("a client");
    let mut as_client = zenoh::Config::default();
    let connect = format!("[\"{place}\"]");
    for (name, value) in [
        ("mode", "\"client\""),
        ("connect/endpoints", connect.as_str()),
        ("scouting/multicast/enabled", "false"),
    ] {
        as_client.insert_json5(name, value).expect("a setting");
    }
    let strangers = [
        stranger(None, Some(&place)),
        zenoh::open(as_client).wait().expect("a client"),
    ];
    let forged = remote::wire::encode(&snapshot(1_000_000)).expect("plausible");
    let liar = forged.clone();
    let _queryables: Vec<_> = strangers
        .iter()
        .map(|stranger| {
            let liar = liar.clone();
            stranger
                .declare_queryable("quadrant/a/*")
                .callback(move |query| {
                    let _ = query.reply(query.key_expr(), liar.clone()).wait();
                })
                .wait()
                .expect("declared")
        })
        .collect();
    for round in 0..20 {
        for stranger in &strangers {
            stranger
                .put("quadrant/a/snapshot", forged.clone())
                .wait()
                .expect("put");
        }
        client.ask_clock("a");
        for heard in hear(&mut server, &mut client, 1) {
            if let Heard::Snapshot(message) = heard {
                assert!(
                    message.sequence < 1_000_000,
                    "round {round}: a forged snapshot came through"
                );
            }
        }
    }
    assert_eq!(client.refused(), 0, "a forged answer came through");
}

#[test]
fn places_are_checked_and_loopback_is_known() {
    for (text, loopback) in [
        ("tcp/127.0.0.1:7447", true),
        ("tcp/[::1]:7447", true),
        ("tcp/localhost:1", true),
        ("tcp/0.0.0.0:7447", false),
        ("tcp/[::]:7447", false),
        ("tcp/controller.lan:7447", false),
    ] {
        let place: Endpoint = text.parse().expect(text);
        assert_eq!(place.is_loopback(), loopback, "{text}");
    }
    for bad in [
        "",
        "tcp/",
        "tcp/:1",
        "tcp/h",
        "tcp/h:",
        "tcp/h:70000",
        "udp/h:1",
        "tcp/h:1#iface=eth0",
        "tcp/\"h:1",
    ] {
        assert!(bad.parse::<Endpoint>().is_err(), "{bad}");
    }
}
