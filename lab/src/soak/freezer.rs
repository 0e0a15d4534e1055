//! A control group of the soak's own, whose processes the kernel can freeze all at once.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Where freezers may be made: the first version of control groups, mixed, the second; with the file that freezes and its words.
const PLACES: [(&str, &str, [&str; 2]); 3] = [
    (
        "/sys/fs/cgroup/freezer",
        "freezer.state",
        ["FROZEN", "THAWED"],
    ),
    ("/sys/fs/cgroup/unified", "cgroup.freeze", ["1", "0"]),
    ("/sys/fs/cgroup", "cgroup.freeze", ["1", "0"]),
];
/// Processes have left a group by then.
const LEAVE_LIMIT: Duration = Duration::from_secs(1);

/// The group. Dropping it removes it.
#[derive(Debug)]
pub struct Freezer {
    folder: PathBuf,
    switch: PathBuf,
    words: [&'static str; 2],
}

impl Freezer {
    /// Makes one, where the system permits it.
    pub fn make(name: &str) -> Option<Freezer> {
        PLACES.iter().find_map(|(place, file, words)| {
            let folder = Path::new(place).join(name);
            fs::create_dir(&folder).ok()?;
            let freezer = Freezer {
                switch: folder.join(file),
                folder,
                words: *words,
            };
            freezer.switch.exists().then_some(freezer)
        })
    }

    /// Takes these processes in and freezes them; whoever has ended meanwhile is left out.
    pub fn freeze(&self, pids: &[i32]) -> io::Result<()> {
        for pid in pids {
            let entered = fs::write(self.folder.join("cgroup.procs"), pid.to_string());
            if let Err(error) = entered
                && Path::new(&format!("/proc/{pid}")).exists()
            {
                return Err(error);
            }
        }
        fs::write(&self.switch, self.words[0])
    }

    /// Lets them go on.
    pub fn thaw(&self) -> io::Result<()> {
        fs::write(&self.switch, self.words[1])
    }
}

impl Drop for Freezer {
    fn drop(&mut self) {
        let _ = self.thaw();
        let since = Instant::now();
        while fs::remove_dir(&self.folder).is_err() && since.elapsed() < LEAVE_LIMIT {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
