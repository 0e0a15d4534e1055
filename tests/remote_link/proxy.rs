//! A bad link without any permission: a proxy between the server and those who look on.
//!
//! Bytes of a connection cannot be lost, only late: each portion comes 50 ms later, and one of twenty another 250 ms, as after a
//! packet that was lost and sent again; what is behind it waits. Cut, nothing goes through; connections stay, as over a dead cable.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use plant_sim::script::rng::Rng;

use super::bad_link::{DELAY, Link, loses};

/// What a lost packet costs until it is sent again.
const AGAIN: Duration = Duration::from_millis(250);
const LOOK: Duration = Duration::from_millis(5);

/// A port that nobody has.
pub fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    listener.local_addr().expect("its number").port()
}

#[derive(Default)]
struct State {
    cut: AtomicBool,
    ended: AtomicBool,
}

pub struct Proxy {
    port: u16,
    server_port: u16,
    state: Arc<State>,
}

impl Proxy {
    pub fn start() -> Proxy {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        listener.set_nonblocking(true).expect("a socket");
        let port = listener.local_addr().expect("its number").port();
        let server_port = free_port();
        let state = Arc::new(State::default());
        let shared = Arc::clone(&state);
        std::thread::spawn(move || {
            let mut seed = 1;
            while !shared.ended.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((from, _)) => {
                        if let Ok(to) = TcpStream::connect(("127.0.0.1", server_port)) {
                            seed += 2;
                            both_ways(from, to, seed, &shared);
                        }
                    }
                    Err(_) => std::thread::sleep(LOOK),
                }
            }
        });
        Proxy {
            port,
            server_port,
            state,
        }
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.state.ended.store(true, Ordering::Relaxed);
    }
}

impl Link for Proxy {
    fn name(&self) -> &'static str {
        "through a proxy"
    }

    fn listen(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.server_port)
    }

    fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.port)
    }

    fn cut(&self) {
        self.state.cut.store(true, Ordering::Relaxed);
    }

    fn mend(&self) {
        self.state.cut.store(false, Ordering::Relaxed);
    }
}

fn both_ways(a: TcpStream, b: TcpStream, seed: u64, state: &Arc<State>) {
    let pairs = [
        (
            a.try_clone().expect("a socket"),
            b.try_clone().expect("a socket"),
        ),
        (b, a),
    ];
    for (index, (from, to)) in pairs.into_iter().enumerate() {
        from.set_read_timeout(Some(LOOK)).expect("a socket");
        let _ = to.set_nodelay(true);
        let (sender, receiver) = channel();
        let (reads, writes) = (Arc::clone(state), Arc::clone(state));
        std::thread::spawn(move || read(from, &sender, &reads, Rng::new(seed + index as u64)));
        std::thread::spawn(move || write(to, &receiver, &writes));
    }
}

type Portion = (Instant, Vec<u8>);

fn read(mut from: TcpStream, sender: &Sender<Portion>, state: &State, mut rng: Rng) {
    let mut buffer = vec![0; 1400];
    let mut due = Instant::now();
    while !state.ended.load(Ordering::Relaxed) {
        if state.cut.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
            continue;
        }
        match from.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => {
                let late = if loses(&mut rng) {
                    AGAIN
                } else {
                    Duration::ZERO
                };
                due = due.max(Instant::now() + DELAY + late);
                let bytes = buffer.get(..count).unwrap_or_default().to_vec();
                if sender.send((due, bytes)).is_err() {
                    return;
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
    }
}

fn write(mut to: TcpStream, receiver: &Receiver<Portion>, state: &State) {
    while let Ok((due, bytes)) = receiver.recv() {
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        while state.cut.load(Ordering::Relaxed) && !state.ended.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
        }
        if to.write_all(&bytes).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
}
