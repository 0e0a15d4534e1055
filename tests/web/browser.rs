//! The page in a real browser: headless Chromium (Debian's package `chromium`), spoken to over a pipe by its DevTools protocol.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use bus::sample::{Mode, ProgramState};
use rustix::pipe::{PipeFlags, pipe_with};
use serde_json::{Value, json};

use super::{ByHand, PATIENCE, Page};
use crate::support::{LiveCell, send};
use crate::tools::tool;
use crate::up::{down, is, obeyed, up_on};

/// Higher than whatever Chromium wants for its ends of the pipe: 3 and 4.
const FREE: i32 = 20;

/// A headless browser with one page.
struct Browser {
    child: Child,
    to: File,
    from: BufReader<File>,
    session: Option<String>,
    id: u64,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Opens the page, with its token; none where there is no Chromium.
    fn open(page: &Page) -> Option<Browser> {
        let program = tool("chromium").or_else(|| {
            eprintln!("`apt-get install chromium` gets it");
            None
        })?;
        let profile = tempfile::tempdir().expect("a folder");
        let (its_in, to) = pipe_with(PipeFlags::CLOEXEC).expect("a pipe");
        let (from, its_out) = pipe_with(PipeFlags::CLOEXEC).expect("a pipe");
        let mut command = Command::new(program);
        command
            .args(
                "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking \
                 --disable-component-update --disable-sync --hide-scrollbars --window-size=1600,1000 --remote-debugging-pipe"
                    .split_whitespace(),
            )
            .arg(format!("--user-data-dir={}", profile.path().display()))
            // What a browser that is killed leaves behind goes with its profile.
            .env("TMPDIR", profile.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0);
        let ends: [(OwnedFd, i32); 2] = [(its_in, 3), (its_out, 4)];
        // SAFETY: between fork and exec there are system calls alone.
        unsafe {
            command.pre_exec(move || {
                // Moved out of each other's way first.
                let high = ends.each_ref().map(|(end, at)| {
                    (
                        libc::fcntl(end.as_raw_fd(), libc::F_DUPFD_CLOEXEC, FREE),
                        *at,
                    )
                });
                for (end, at) in high {
                    if libc::dup2(end, at) < 0 {
                        return Err(std::io::Error::last_os_error());
                    }
                }
                Ok(())
            });
        }
        let child = command.spawn().expect("chromium");
        drop(command);
        let mut browser = Browser {
            child,
            to: to.into(),
            from: BufReader::new(from.into()),
            session: None,
            id: 0,
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let target = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = browser.call("Target.attachToTarget", target);
        browser.session = attached["sessionId"].as_str().map(str::to_string);
        let url = format!("http://{}/#token={}", page.address, page.token);
        browser.call("Page.navigate", json!({ "url": url }));
        Some(browser)
    }

    /// What the browser answers.
    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.id += 1;
        let mut message = json!({ "id": self.id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        let sent = self.to.write_all(format!("{message}\0").as_bytes());
        sent.expect("the browser listens");
        loop {
            let mut bytes = Vec::new();
            let read = self.from.read_until(0, &mut bytes).expect("an answer");
            assert!(read > 0, "the browser has ended");
            bytes.pop();
            let answer: Value = serde_json::from_slice(&bytes).expect("JSON");
            if answer["id"] == self.id {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Value of an expression on the page.
    fn value(&mut self, expression: &str) -> Value {
        let what = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", what);
        answer["result"]["value"].clone()
    }

    /// Waits until the expression is true.
    fn until(&mut self, expression: &str) {
        let started = Instant::now();
        while self.value(expression) != true {
            if started.elapsed() > PATIENCE {
                let shown = self.value("document.body.innerText");
                panic!("never {expression}: {shown}");
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }

    fn kill(&self) {
        send(-(self.child.id() as i32), libc::SIGKILL);
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

const FRAMES: &str = "window.quadrant.frames";

#[test]
fn the_page_shows_the_machine_obeys_its_buttons_and_shows_who_is_killed() {
    let bench = crate::support::Bench::patient("xy", &[]);
    let (_bench, mut cell, _, long) = up_on(bench, "realtime");
    let by_hand = ByHand::start(&cell, &[]);
    let Some(mut browser) = Browser::open(&by_hand.page) else {
        return down_after(by_hand, cell);
    };
    browser.until(&format!("{FRAMES} > 5"));
    assert_eq!(
        browser.value("location.hash"),
        "",
        "the token is to be seen nowhere"
    );
    let word =
        |word: &str| format!("document.getElementById('state-word').textContent === '{word}'");
    browser.until(&word("DRIVES OFF"));
    browser.value("document.querySelector('[data-order=enable]').click()");
    browser.until(&word("READY"));
    // On a PC that is late a click may be too old: the page says so, and it is given again.
    let answer = "document.getElementById('answer').textContent";
    browser.until(&format!("{answer}.includes('drives on')"));
    let mut said = json!("not taken");
    while said.as_str().is_some_and(|said| said.contains("not taken")) {
        browser.value("document.querySelector('[aria-label=\"Jog X plus\"]').click()");
        browser.until(&format!("!{answer}.endsWith('…')"));
        said = browser.value(answer);
    }
    assert!(
        said.as_str().is_some_and(|said| said.contains("X by 1 mm")),
        "{said}"
    );
    browser.until("Math.abs(parseFloat(document.querySelector('[data-axis=X] .position').textContent) - 1) < 0.02");
    browser.until(&word("READY"));
    obeyed(&cell, &["load", &long]);
    browser.until("document.getElementById('program-name').textContent === 'long.ngc'");
    browser.value("document.querySelector('[data-order=start]').click()");
    browser.until("document.getElementById('confirm').open");
    browser.value("document.getElementById('confirm-yes').click()");
    cell.wait_for(|f| is(f, Mode::Enabled, ProgramState::Running));
    browser.until(&word("RUNS"));
    browser.until("document.getElementById('circle-title').textContent.startsWith('XY, R 25 mm')");
    let key = "document.dispatchEvent(new KeyboardEvent('keydown', { key: 'h', bubbles: true }))";
    browser.value(key);
    cell.wait_for(|f| f.hold == 1);
    send(cell.pid_of(" servo "), libc::SIGKILL);
    browser.until("[...document.querySelectorAll('#process-list em')].some(e => e.textContent.includes('signal 9'))");
    browser.until("[...document.querySelectorAll('#event-list li')].some(e => e.textContent.includes('servo'))");
    let problems = browser.value("document.querySelectorAll('[data-axis]').length");
    assert_eq!(problems, 2);
    // A browser that dies is nothing to the page's process.
    browser.kill();
    let scan = by_hand.page.frames().next().expect("a frame")["status"]["scan"].as_u64();
    assert!(scan.is_some());
    drop(browser);
    down_after(by_hand, cell);
}

fn down_after(by_hand: ByHand, cell: LiveCell) {
    drop(by_hand);
    down(cell);
}

fn now_ms() -> f64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.expect("after 1970").as_secs_f64() * 1e3
}

/// For docs/developers/measurements.md: frames a second, and the time from a `kill -9` of a servo to its death on the screen.
#[test]
#[ignore = "a measurement"]
fn measure_frames_and_deaths_on_the_page() {
    let bench = crate::support::Bench::of("xyz-mill", &[]);
    let (_bench, mut cell, _, _) = up_on(bench, "realtime");
    let by_hand = ByHand::start(&cell, &[]);
    let mut browser = Browser::open(&by_hand.page).expect("chromium");
    browser.until(&format!("{FRAMES} > 20"));
    let look = |browser: &mut Browser| {
        let seen = browser.value("window.quadrant");
        let number = |key: &str| seen[key].as_f64().expect("a number");
        (
            number("frames"),
            number("last_scan"),
            number("last_ms"),
            number("missed"),
        )
    };
    let first = look(&mut browser);
    std::thread::sleep(std::time::Duration::from_secs(10));
    let last = look(&mut browser);
    let scan_s = cell.wait_for(|_| true).scan as f64;
    assert!(scan_s > 0.0);
    println!(
        "frames {:.0} in {:.2} s by the page's clock, {:.0} scans: {:.1} a second; not shown: {:.0}",
        last.0 - first.0,
        (last.2 - first.2) / 1e3,
        last.1 - first.1,
        (last.0 - first.0) / (last.2 - first.2) * 1e3,
        last.3,
    );
    obeyed(&cell, &["enable"]);
    let mut delays_ms = Vec::new();
    for _ in 0..5 {
        let counted = "Object.values(window.quadrant.deaths).flatMap(Object.values).map(seen => seen.shown_ms)";
        let before = browser.value(counted).as_array().map_or(0, Vec::len);
        // Who dies often is restarted only after a while.
        let started = Instant::now();
        let pid = loop {
            let standby = cell
                .children()
                .into_iter()
                .find(|(_, line)| line.contains(" servo ") && line.contains("--axis Y --role b"));
            if let Some((pid, _)) = standby {
                break pid;
            }
            assert!(
                started.elapsed() < PATIENCE,
                "the standby does not come back"
            );
            std::thread::sleep(std::time::Duration::from_millis(50));
        };
        let killed_ms = now_ms();
        send(pid, libc::SIGKILL);
        browser.until(&format!("{counted}.length > {before}"));
        let shown = browser.value(&format!("Math.max(...{counted})"));
        delays_ms.push(shown.as_f64().expect("a time") - killed_ms);
        std::thread::sleep(std::time::Duration::from_millis(1500));
    }
    delays_ms.sort_by(f64::total_cmp);
    println!("from kill -9 to the page, ms: {delays_ms:.0?}");
    down_after(by_hand, cell);
}
