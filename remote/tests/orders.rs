//! Orders over TLS: of operators alone, and of nobody who has no certificate, that of another authority, or another name.

mod certificates;

use std::fs;
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use certificates::{Authority, Wish, operator};
use remote::orders::{Identity, OrderServer, OrdersError, TlsPlace, give};
use zenoh::{Config, Wait};

fn of(folder: &Path) -> Identity {
    Identity::of(folder).expect("an identity")
}

fn place() -> TlsPlace {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("its number").port();
    format!("tls/127.0.0.1:{port}").parse().expect("a place")
}

type Obeyed = Arc<Mutex<Vec<(String, f64)>>>;

/// A server that takes the orders of `alice` for cell `a`; `enable` lasts.
fn server(place: &TlsPlace, identity: &Identity) -> (OrderServer, Obeyed) {
    let obeyed = Obeyed::default();
    let orders = Arc::clone(&obeyed);
    let obey = move |order: &str, value: f64| {
        orders.lock().expect("orders").push((order.into(), value));
        match order {
            "resume" => Err("resume refused: the machine is disabled".into()),
            "enable" => {
                std::thread::sleep(Duration::from_secs(4));
                Ok("drives on".into())
            }
            order => Ok(format!("{order}: done")),
        }
    };
    let operators = ["alice".to_string()];
    let server = OrderServer::open("a", place, identity, &operators, obey);
    (server.expect("a server"), obeyed)
}

#[test]
fn an_operator_with_the_right_certificate_is_obeyed_and_nobody_else() {
    if !certificates::can_be_made() {
        return;
    }
    let (ours, theirs) = (Authority::new("ours"), Authority::new("theirs"));
    let place = place();
    let (server, obeyed) = server(&place, &of(&ours.identity(certificates::server(), &ours)));
    let alice = of(&ours.identity(operator("alice"), &ours));
    let done = give("a", &place, &alice, "override", 40.0).expect("an answer");
    assert_eq!(done, Ok("override: done".into()));
    let refused = give("a", &place, &alice, "resume", 0.0).expect("an answer");
    assert_eq!(
        refused,
        Err("resume refused: the machine is disabled".into())
    );
    let so_far = obeyed.lock().expect("orders").clone();
    assert_eq!(so_far, [("override".into(), 40.0), ("resume".into(), 0.0)]);

    let refused = |cell: &str, identity: &Identity| {
        let begun = Instant::now();
        let error = give(cell, &place, identity, "hold", 0.0).expect_err("no answer");
        eprintln!("after {:?}: {error}", begun.elapsed());
        error.to_string()
    };
    let has = |words: String, part: &str| {
        assert!(words.contains(part), "{words}");
        assert!(words.contains("no order was given"), "{words}");
    };
    // Of the right authority, and not an operator.
    let mallory = of(&ours.identity(operator("mallory"), &ours));
    has(refused("a", &mallory), "none of its operators");
    // The operator's name, of another authority.
    let forged = of(&theirs.identity(operator("alice"), &ours));
    has(refused("a", &forged), "does not believe this certificate");
    let old = Wish {
        days: -1,
        ..operator("alice")
    };
    let old = of(&ours.identity(old, &ours));
    has(refused("a", &old), "Expired");
    // The server's kind of certificate gives no orders, whatever its name.
    let wrong_kind = Wish {
        name: "alice",
        ..certificates::server()
    };
    let wrong_kind = of(&ours.identity(wrong_kind, &ours));
    has(
        refused("a", &wrong_kind),
        "does not believe this certificate",
    );
    // An operator who is shown a server of another authority says nothing to it.
    let careful = of(&ours.identity(operator("alice"), &theirs));
    has(
        refused("a", &careful),
        "its certificate is not believed here",
    );
    has(refused("b", &alice), "no such cell");
    assert_eq!(obeyed.lock().expect("orders").clone(), so_far);
    server.close();
}

/// A server that shows an operator's certificate, or one for another host, is none.
#[test]
fn an_operator_says_nothing_to_another_operator_who_plays_the_server() {
    if !certificates::can_be_made() {
        return;
    }
    let ours = Authority::new("ours");
    let place = place();
    let (server, obeyed) = server(&place, &of(&ours.identity(operator("mallory"), &ours)));
    let alice = of(&ours.identity(operator("alice"), &ours));
    let error = give("a", &place, &alice, "hold", 0.0).expect_err("no link");
    assert!(error.to_string().contains("not believed here"), "{error}");
    assert!(obeyed.lock().expect("orders").is_empty());
    server.close();
}

/// Whoever has a session of zenoh's own, beside this crate's client: nothing comes through without the certificate, over TLS, over
/// TCP, by finding the server, or by publishing and declaring instead of asking.
#[test]
fn who_has_no_certificate_reaches_nobody() {
    if !certificates::can_be_made() {
        return;
    }
    let (ours, theirs) = (Authority::new("ours"), Authority::new("theirs"));
    let place = place();
    let controller = ours.identity(certificates::server(), &ours);
    let (server, obeyed) = server(&place, &of(&controller));
    let tcp = place.to_string().replace("tls/", "tcp/");
    let tls = place.to_string();
    let forged = theirs.identity(operator("alice"), &ours);
    let right = ours.identity(operator("mallory"), &ours);
    let tries: [(&str, &Path, bool); 4] = [
        (&tcp, &controller, false),
        (&tls, &controller, false),
        (&tls, &forged, true),
        (&tls, &right, true),
    ];
    for (to, folder, shows) in tries {
        let session = zenoh::open(settings(to, folder, shows)).wait();
        assert_eq!(
            session.is_ok(),
            folder == right,
            "{to} {}",
            folder.display()
        );
        let Ok(session) = session else { continue };
        let key = "quadrant/a/order";
        let request = r#"{"format":FORMAT,"ticket":0,"order":"hold","value":0.0}"#;
        let request = request.replace("FORMAT", &remote::wire::FORMAT.to_string());
        let asked = session
            .get(key)
            .payload(request.clone())
            .timeout(Duration::from_secs(1));
        let answer = asked.wait().expect("asked").recv();
        assert!(answer.is_err(), "{to}: {answer:?}");
        session.put(key, request).wait().expect("put");
        let wide = session.get("**").timeout(Duration::from_secs(1)).wait();
        assert!(wide.expect("asked").recv().is_err(), "{to}");
        session.close().wait().expect("closed");
    }
    assert!(obeyed.lock().expect("orders").is_empty());
    // Nobody listens for those who look for zenoh in the network.
    assert_eq!(udp_sockets(), 0);
    server.close();
}

/// UDP sockets of this process.
fn udp_sockets() -> usize {
    let open = fs::read_dir("/proc/self/fd")
        .expect("descriptors")
        .flatten();
    let ours: Vec<String> = open
        .filter_map(|entry| fs::read_link(entry.path()).ok())
        .filter_map(|to| {
            let inode = to.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?;
            Some(inode.to_string())
        })
        .collect();
    let tables = ["udp", "udp6"].map(|name| {
        let table = fs::read_to_string(format!("/proc/self/net/{name}")).unwrap_or_default();
        let inode = |line: &str| line.split_whitespace().nth(9).map(String::from);
        let of_ours = |line: &&str| inode(line).is_some_and(|i| ours.contains(&i));
        table.lines().filter(of_ours).count()
    });
    tables.iter().sum()
}

/// Settings of a stranger's session.
fn settings(to: &str, folder: &Path, shows: bool) -> Config {
    let mut config = Config::default();
    let mut set = |name: &str, value: String| {
        config.insert_json5(name, &value).expect("a setting");
    };
    set("mode", "\"client\"".into());
    set("connect/endpoints", format!("[\"{to}\"]"));
    set("connect/timeout_ms", "1500".into());
    set("connect/exit_on_failure", "true".into());
    set("scouting/multicast/enabled", "false".into());
    let file = |name: &str| format!("\"{}\"", folder.join(name).display());
    set("transport/link/tls/root_ca_certificate", file("ca.pem"));
    if shows {
        set("transport/link/tls/enable_mtls", "true".into());
        set("transport/link/tls/connect_certificate", file("cert.pem"));
        set("transport/link/tls/connect_private_key", file("key.pem"));
    }
    config
}

/// Stop and hold wait for no other order; an answer that does not come is said within 3 s; strangers who hang on hinder nobody.
#[test]
fn a_stop_comes_through_beside_a_slow_order_and_silent_strangers() {
    if !certificates::can_be_made() {
        return;
    }
    let ours = Authority::new("ours");
    let place = place();
    let (server, obeyed) = server(&place, &of(&ours.identity(certificates::server(), &ours)));
    let alice = of(&ours.identity(operator("alice"), &ours));
    let address = place.to_string().replace("tls/", "");
    let strangers: Vec<TcpStream> = (0..50)
        .map(|_| {
            let mut stream = TcpStream::connect(&address).expect("a connection");
            stream.write_all(&[0x16, 3, 1]).expect("bytes");
            stream
        })
        .collect();
    std::thread::scope(|scope| {
        let slow = scope.spawn(|| {
            let begun = Instant::now();
            (give("a", &place, &alice, "enable", 0.0), begun.elapsed())
        });
        while obeyed.lock().expect("orders").is_empty() {
            std::thread::sleep(Duration::from_millis(10));
        }
        let stop = give("a", &place, &alice, "stop", 0.0).expect("an answer");
        assert_eq!(stop, Ok("stop: done".into()));
        assert!(!slow.is_finished(), "the stop came after the slow order");
        let (answer, lasted) = slow.join().expect("a thread");
        eprintln!("after {lasted:?}: {answer:?}");
        assert!(matches!(answer, Err(OrdersError::Silent(_))), "{answer:?}");
    });
    drop(strangers);
    server.close();
}

#[test]
fn certificates_that_are_missing_or_open_to_others_are_refused_by_name() {
    if !certificates::can_be_made() {
        return;
    }
    let ours = Authority::new("ours");
    let folder = ours.identity(operator("alice"), &ours);
    let key = folder.join("key.pem");
    let words = || Identity::of(&folder).expect_err("a refusal").to_string();
    fs::set_permissions(&key, fs::Permissions::from_mode(0o640)).expect("its mode");
    assert!(
        words().contains("key.pem: others may read it: chmod 600"),
        "{}",
        words()
    );
    fs::remove_file(&key).expect("removed");
    assert!(words().contains("key.pem: No such file"), "{}", words());
    fs::write(&key, "nothing").expect("a file");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).expect("its mode");
    assert!(
        words().contains("key.pem: holds no private key"),
        "{}",
        words()
    );
    fs::write(folder.join("ca.pem"), "nothing").expect("a file");
    assert!(
        words().contains("ca.pem: holds no certificate"),
        "{}",
        words()
    );

    let whole = of(&ours.identity(certificates::server(), &ours));
    let open = |cell: &str, names: &[&str]| {
        let names: Vec<String> = names.iter().map(ToString::to_string).collect();
        OrderServer::open(cell, &place(), &whole, &names, |_, _| Ok(String::new()))
    };
    assert!(matches!(open("a", &[]), Err(OrdersError::NoOperator)));
    for name in ["", " ", "a\"b", "*", "a,b"] {
        assert!(
            matches!(open("a", &[name]), Err(OrdersError::Operator(_))),
            "{name:?}"
        );
    }
    assert!(matches!(open("**", &["alice"]), Err(OrdersError::Cell(_))));
    // A key of another certificate opens nothing.
    let mixed = ours.identity(certificates::server(), &ours);
    let other = ours.identity(certificates::server(), &ours);
    fs::copy(other.join("key.pem"), mixed.join("key.pem")).expect("a key");
    let names = ["alice".to_string()];
    let opened = OrderServer::open("a", &place(), &of(&mixed), &names, |_, _| Ok(String::new()));
    assert!(opened.is_err());
}

/// zenoh's client would trust the authorities of the web for the server's certificate.
#[test]
fn no_public_authority_is_built_in() {
    let lock = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.lock");
    let lock = fs::read_to_string(lock).expect("the lock file");
    let roots: Vec<&str> = lock
        .split("[[package]]")
        .filter(|package| package.contains("name = \"webpki-root"))
        .collect();
    assert_eq!(roots.len(), 1, "{roots:?}");
    assert!(!roots[0].contains("source ="), "{roots:?}");
}
