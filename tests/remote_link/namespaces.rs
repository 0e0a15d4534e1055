//! Two hosts on one: two network namespaces with nothing but a tunnel between them, each of whose packets comes 50 ms later and
//! every twentieth of which is lost.
//!
//! What `tc netem` does is done here, packet by packet between two TUN devices: not every kernel has netem.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use plant_sim::script::rng::Rng;

use super::bad_link::{DELAY, Link, loses};
use super::view::Place;
use crate::support::LiveCell;

/// `TUNSETIFF`.
const TUN_SET_INTERFACE: libc::c_ulong = 0x4004_54ca;
/// `IFF_TUN | IFF_NO_PI`: bare packets.
const TUN_FLAGS: u16 = 0x1001;
/// The device's name in both.
const DEVICE: &str = "qd0";
const HERE: &str = "10.99.0.1";
const THERE: &str = "10.99.0.2";
const PORT: u16 = 7447;

/// One namespace, removed with its owner.
struct Namespace {
    name: String,
}

impl Namespace {
    fn make(which: &str) -> Result<Namespace, String> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("quadrant-{}-{number}-{which}", std::process::id());
        ip(&["netns", "add", &name])?;
        Ok(Namespace { name })
    }

    /// Does something in it, on a thread of its own: what is started there stays there.
    fn inside<T: Send>(&self, what: impl FnOnce() -> T + Send) -> T {
        let file = File::open(format!("/run/netns/{}", self.name)).expect("the namespace");
        std::thread::scope(|scope| {
            let thread = scope.spawn(move || {
                // SAFETY: a plain system call; it concerns this thread alone, which ends soon.
                let entered = unsafe { libc::setns(file.as_raw_fd(), libc::CLONE_NEWNET) };
                assert_eq!(entered, 0, "entering the namespace");
                what()
            });
            thread.join().expect("a thread")
        })
    }

    fn tunnel(&self, address: &str) -> Result<File, String> {
        let tunnel = self.inside(|| {
            let tunnel = OpenOptions::new()
                .read(true)
                .write(true)
                .custom_flags(libc::O_NONBLOCK)
                .open("/dev/net/tun")?;
            let mut request = [0u8; 40];
            request[..DEVICE.len()].copy_from_slice(DEVICE.as_bytes());
            request[16..18].copy_from_slice(&TUN_FLAGS.to_ne_bytes());
            // SAFETY: the request is as large as `struct ifreq`.
            let made =
                unsafe { libc::ioctl(tunnel.as_raw_fd(), TUN_SET_INTERFACE, request.as_mut_ptr()) };
            match made {
                0 => Ok(tunnel),
                _ => Err(std::io::Error::last_os_error()),
            }
        });
        let tunnel = tunnel.map_err(|error| format!("/dev/net/tun: {error}"))?;
        self.ip(&["addr", "add", &format!("{address}/24"), "dev", DEVICE])?;
        self.ip(&["link", "set", DEVICE, "up"])?;
        self.ip(&["link", "set", "lo", "up"])?;
        Ok(tunnel)
    }

    fn ip(&self, words: &[&str]) -> Result<(), String> {
        let mut all = vec!["-n", &self.name];
        all.extend(words);
        ip(&all)
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        let _ = ip(&["netns", "del", &self.name]);
    }
}

fn ip(words: &[&str]) -> Result<(), String> {
    let output = Command::new("ip").args(words).output();
    let output = output.map_err(|error| format!("the command ip (Debian: iproute2): {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!(
            "ip {}: {}",
            words.join(" "),
            String::from_utf8_lossy(&output.stderr).trim()
        )),
    }
}

/// Two namespaces and what lies between them.
pub struct Pair {
    here: Namespace,
    there: Namespace,
    ended: Arc<AtomicBool>,
    carriers: Vec<std::thread::JoinHandle<()>>,
}

impl Pair {
    /// # Errors
    /// It is not permitted here, in words.
    pub fn set_up() -> Result<Pair, String> {
        let here = Namespace::make("here")?;
        let there = Namespace::make("there")?;
        let ends = [here.tunnel(HERE)?, there.tunnel(THERE)?];
        let ended = Arc::new(AtomicBool::new(false));
        let clone = |file: &File| file.try_clone().map_err(|error| error.to_string());
        let ways = [
            (clone(&ends[0])?, clone(&ends[1])?, 7),
            (clone(&ends[1])?, clone(&ends[0])?, 11),
        ];
        let carriers = ways.into_iter().map(|(from, to, seed)| {
            let ended = Arc::clone(&ended);
            std::thread::spawn(move || carry(from, to, Rng::new(seed), &ended))
        });
        Ok(Pair {
            carriers: carriers.collect(),
            here,
            there,
            ended,
        })
    }

    pub fn here(&self) -> Host<'_> {
        Host(&self.here)
    }

    pub fn there(&self) -> Host<'_> {
        Host(&self.there)
    }
}

impl Drop for Pair {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        for carrier in self.carriers.drain(..) {
            let _ = carrier.join();
        }
    }
}

/// Carries packets one way: late, and some not at all.
fn carry(mut from: File, mut to: File, mut rng: Rng, ended: &AtomicBool) {
    let mut underway: VecDeque<(Instant, Vec<u8>)> = VecDeque::new();
    let mut buffer = vec![0; 65536];
    while !ended.load(Ordering::Relaxed) {
        // A device that is down gives errors: no packets.
        while let Ok(count) = from.read(&mut buffer) {
            if !loses(&mut rng) {
                let packet = buffer.get(..count).unwrap_or_default().to_vec();
                underway.push_back((Instant::now() + DELAY, packet));
            }
        }
        let now = Instant::now();
        while underway.front().is_some_and(|(due, _)| *due <= now)
            && let Some((_, packet)) = underway.pop_front()
        {
            let _ = to.write(&packet);
        }
        let next = underway
            .front()
            .map(|(due, _)| due.saturating_duration_since(now));
        let wait = next.unwrap_or(Duration::from_millis(20)).as_millis() as i32;
        let mut poll = libc::pollfd {
            fd: from.as_raw_fd(),
            events: libc::POLLIN,
            revents: 0,
        };
        // SAFETY: a plain system call on one descriptor.
        unsafe {
            libc::poll(&mut poll, 1, wait + 1);
        }
        if poll.revents & libc::POLLERR != 0 {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Link for Pair {
    fn name(&self) -> &'static str {
        "between two network namespaces"
    }

    fn listen(&self) -> String {
        format!("tcp/{HERE}:{PORT}")
    }

    fn endpoint(&self) -> String {
        format!("tcp/{HERE}:{PORT}")
    }

    fn cut(&self) {
        self.there
            .ip(&["link", "set", DEVICE, "down"])
            .expect("cutting the link");
    }

    fn mend(&self) {
        self.there
            .ip(&["link", "set", DEVICE, "up"])
            .expect("mending the link");
    }
}

/// One of the two hosts.
pub struct Host<'a>(&'a Namespace);

impl Place for Host<'_> {
    fn spawn(&self, command: &mut Command) -> Child {
        self.0
            .inside(|| command.spawn().expect("starting quadrant"))
    }

    fn cell(&self, machine: &Path, program: &Path) -> LiveCell {
        self.0
            .inside(|| LiveCell::start(machine, program, "realtime"))
    }
}
