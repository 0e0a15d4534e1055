//! A control group of the soak's own, whose processes the kernel can freeze all at once.

use std::fs;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

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
/// Its standard input ends when the soak has ended, however that ended: then it lets the group go on, and removes it once it is empty.
const KEEPER: &str =
    "cat; echo \"$2\" > \"$1\"; for look in $(seq 100); do rmdir \"$3\" && break; sleep 0.01; done";

/// The group. Dropping it removes it.
#[derive(Debug)]
pub struct Freezer {
    folder: PathBuf,
    switch: PathBuf,
    words: [&'static str; 2],
    keeper: Child,
}

impl Freezer {
    /// Makes one, where the system permits it.
    pub fn make(name: &str) -> Option<Freezer> {
        PLACES.iter().find_map(|(place, file, words)| {
            let folder = Path::new(place).join(name);
            fs::create_dir(&folder).ok()?;
            let switch = folder.join(file);
            if !switch.exists() {
                // Not a control group.
                let _ = fs::remove_dir(&folder);
                return None;
            }
            let keeper = Command::new("sh")
                .args(["-c", KEEPER, "sh"])
                .args([switch.as_os_str(), words[1].as_ref(), folder.as_os_str()])
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                // Ctrl-C goes to the soak alone.
                .process_group(0)
                .spawn();
            Some(Freezer {
                switch,
                folder,
                words: *words,
                keeper: keeper.ok()?,
            })
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
        drop(self.keeper.stdin.take());
        let _ = self.keeper.wait();
    }
}
