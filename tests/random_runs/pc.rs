//! Times in which the PC itself stood: its disk wrote nothing, or it ran nobody. What is late by them is late by no process of a cell.

use std::fs::File;
use std::io::Write;
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

/// Between two looks.
const LOOK: Duration = Duration::from_millis(20);
/// A few bytes written and synced, on a PC that does nothing else, take a hundredth of it.
const STANDS: Duration = Duration::from_millis(300);

#[derive(Debug)]
struct Looks {
    /// When the look in progress began.
    since: Instant,
    stood: Vec<(Instant, Instant)>,
}

fn looks() -> &'static Mutex<Looks> {
    static LOOKS: OnceLock<Mutex<Looks>> = OnceLock::new();
    LOOKS.get_or_init(|| {
        std::thread::spawn(look_for_ever);
        Mutex::new(Looks {
            since: Instant::now(),
            stood: Vec::new(),
        })
    })
}

fn look_for_ever() {
    let folder = tempfile::tempdir().expect("a folder");
    loop {
        std::thread::sleep(LOOK);
        let mut file = File::create(folder.path().join("look")).expect("a file");
        file.write_all(b"written").expect("room");
        file.sync_all().expect("a disk");
        let now = Instant::now();
        let mut looks = looks().lock().expect("the looks");
        let since = std::mem::replace(&mut looks.since, now);
        if now - since > STANDS {
            looks.stood.push((since, now));
        }
    }
}

/// Begins to look.
pub fn watch() {
    drop(looks().lock());
}

/// For how long the PC has stood since then.
pub fn stood_since(since: Instant) -> Duration {
    let looks = looks().lock().expect("the looks");
    let now = Instant::now();
    let current = (looks.since, now);
    let current = Some(current).filter(|(from, to)| *to - *from > STANDS);
    let all = looks.stood.iter().copied().chain(current);
    all.map(|(from, to)| to.saturating_duration_since(from.max(since)))
        .sum()
}
