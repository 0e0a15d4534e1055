//! The page in the browser: what it shows, who may order through it, and that no browser changes a bit of the motion.

mod browser;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use bus::sample::{Feedback, Mode, ProgramState};
use serde_json::Value;

use crate::size;
use crate::support::{
    Bench, LiveCell, circle_program, long_program, quadrant, run_with, send, text,
};
use crate::up::{down, is, obeyed, up};

/// Nothing here takes longer.
const PATIENCE: Duration = Duration::from_secs(60);

/// Where a page is, and its token.
#[derive(Debug, Clone)]
pub(crate) struct Page {
    address: String,
    token: String,
}

impl Page {
    /// As it is printed; what is printed later is read by nobody, who must hold up no one.
    fn printed(stdout: impl Read + Send + 'static) -> Page {
        let mut lines = BufReader::new(stdout).lines();
        let page = loop {
            let line = lines.next().expect("an address").expect("a line");
            if let Some((before, token)) = line.split_once("/#token=") {
                let (_, address) = before.split_once("http://").expect("an address");
                break Page {
                    address: address.into(),
                    token: token.trim().into(),
                };
            }
        };
        std::thread::spawn(move || lines.count());
        page
    }

    /// That of a cell which was started with `--web=0`.
    pub(crate) fn of(cell: &mut LiveCell) -> Page {
        Page::printed(cell.child.stdout.take().expect("standard output"))
    }

    /// Head and body of the answer to a request with these lines in its head.
    fn ask(&self, first: &str, more: &[&str], body: &str) -> (String, String) {
        self.send(first, more, body).head_and_body()
    }

    fn send(&self, first: &str, more: &[&str], body: &str) -> Asked {
        let lines: String = more.iter().map(|line| format!("{line}\r\n")).collect();
        let host = if more.iter().any(|line| line.starts_with("Host:")) {
            String::new()
        } else {
            format!("Host: {}\r\n", self.address)
        };
        let request = format!(
            "{first} HTTP/1.1\r\n{host}{lines}Content-Length: {}\r\n\r\n{body}",
            body.len()
        );
        let mut stream = TcpStream::connect(&self.address).expect("a connection");
        stream.set_read_timeout(Some(PATIENCE)).expect("a limit");
        // Who is refused early may be so while it still writes.
        let _ = stream.write_all(request.as_bytes());
        Asked(stream)
    }

    fn get(&self, path: &str) -> (String, String) {
        self.ask(&format!("GET {path}"), &[], "")
    }

    /// Status and words of the answer to an order with these lines in the head.
    fn order_with(&self, order: &str, more: &[&str]) -> (u32, String) {
        let lines = [&["Content-Type: application/json"], more].concat();
        self.send("POST /order", &lines, order).answer()
    }

    pub(crate) fn order(&self, order: &str) -> (u32, String) {
        self.send_order(order).answer()
    }

    /// Gives an order with the token; its answer is read later.
    pub(crate) fn send_order(&self, order: &str) -> Asked {
        let lines = ["Content-Type: application/json", &self.bearer()];
        self.send("POST /order", &lines, order)
    }

    pub(crate) fn frames(&self) -> Frames {
        self.frames_with(&[])
    }

    fn frames_with(&self, more: &[&str]) -> Frames {
        let Asked(stream) = self.send("GET /frames", more, "");
        Frames(BufReader::new(stream).lines())
    }

    /// The line of a head that has the token.
    fn bearer(&self) -> String {
        format!("Authorization: Bearer {}", self.token)
    }
}

/// A request that was sent.
pub(crate) struct Asked(TcpStream);

impl Asked {
    fn head_and_body(mut self) -> (String, String) {
        let mut answer = Vec::new();
        let _ = self.0.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
        (head.to_string(), body.to_string())
    }

    /// Status and words.
    fn answer(self) -> (u32, String) {
        let (head, body) = self.head_and_body();
        let status = head.split(' ').nth(1).and_then(|word| word.parse().ok());
        (status.unwrap_or(0), body)
    }
}

/// The frames that a browser gets.
pub(crate) struct Frames(std::io::Lines<BufReader<TcpStream>>);

impl Iterator for Frames {
    type Item = Value;

    fn next(&mut self) -> Option<Value> {
        loop {
            let line = self.0.next()?.ok()?;
            if let Some(data) = line.strip_prefix("data: ") {
                return Some(serde_json::from_str(data).expect("JSON"));
            }
        }
    }
}

impl Frames {
    /// The first frame that is as it is asked for.
    fn until(&mut self, reached: impl Fn(&Value) -> bool) -> Value {
        let started = Instant::now();
        let found = self.find(|frame| reached(frame) || started.elapsed() > PATIENCE);
        let frame = found.expect("frames");
        assert!(reached(&frame), "it never came to that: {frame}");
        frame
    }
}

/// A page that was started by hand; dropping it ends it.
struct ByHand {
    child: Child,
    page: Page,
}

impl ByHand {
    fn start(cell: &LiveCell, more: &[&str]) -> ByHand {
        let mut child = quadrant()
            .args(["web", "0", "--cell", &cell.cell])
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the page");
        let page = Page::printed(child.stdout.take().expect("standard output"));
        ByHand { child, page }
    }
}

impl Drop for ByHand {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn event_with<'a>(frame: &'a Value, words: &str) -> Option<&'a Value> {
    let events = frame["events"].as_array().expect("events");
    let mut all = events.iter();
    all.find(|event| event["event"].as_str().is_some_and(|e| e.contains(words)))
}

#[test]
fn the_page_and_all_it_needs_come_from_the_cell() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start_with(bench.path(), &program, "realtime", &["--web=0"]);
    let page = Page::of(&mut cell);
    let (head, html) = page.get("/");
    assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
    let policy = "content-security-policy: default-src 'none'; script-src 'self'";
    assert!(head.to_lowercase().contains(policy), "{head}");
    for file in ["page.css", "page.js", "icon.svg"] {
        assert!(html.contains(&format!("\"{file}\"")), "{file}");
    }
    let (_, script) = page.get("/page.js");
    for file in [
        "pictures.js",
        "orders.js",
        "runs.js",
        "signals.js",
        "stream.js",
    ] {
        assert!(script.contains(&format!("\"./{file}\"")), "{file}");
        let (head, _) = page.get(&format!("/{file}"));
        assert!(head.starts_with("HTTP/1.1 200 OK"), "{file}: {head}");
    }
    for text in [&html, &script] {
        assert!(
            !text.contains("//cdn") && !text.contains("https:"),
            "from here alone"
        );
    }
    assert!(page.get("/etc/passwd").0.starts_with("HTTP/1.1 404"));
    cell.signal_launcher(libc::SIGTERM);
    assert_eq!(cell.finish().status(), 130);
}

#[test]
fn frames_follow_each_other_to_the_end_and_have_what_is_drawn() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start_with(bench.path(), &program, "realtime", &["--web=0"]);
    let page = Page::of(&mut cell);
    let mut frames = page.frames();
    let first = frames.until(|frame| frame["circle"]["running"] == true);
    let others: Vec<Value> = frames.by_ref().take(20).collect();
    let number = |frame: &Value| frame["frame"].as_u64().expect("a number");
    let all: Vec<&Value> = std::iter::once(&first).chain(&others).collect();
    assert!(all.windows(2).all(|w| number(w[1]) > number(w[0])));
    assert!(
        all.windows(2)
            .all(|w| w[1]["status"]["scan"].as_u64() >= w[0]["status"]["scan"].as_u64())
    );
    assert_eq!(first["status"]["program"]["name"], "circle.ngc");
    assert_eq!(first["status"]["says"]["state"], "RUNS");
    assert_eq!(
        first["circle"]["deviation_um"].as_array().map(Vec::len),
        Some(360)
    );
    let moved = frames.until(|frame| frame["points"].as_array().is_some_and(|p| !p.is_empty()));
    let point = &moved["points"][0];
    let radius_mm = point[0]
        .as_f64()
        .expect("X")
        .hypot(point[1].as_f64().expect("Y"));
    assert!(
        (radius_mm - 25.0).abs() < 1.0 && point[3].is_f64(),
        "{point}"
    );
    let json = |path: &str| -> Value { serde_json::from_str(&page.get(path).1).expect(path) };
    assert_eq!(json("/machine")["axes"][1]["axis"], "Y");
    let stretches = json("/path")["stretches"]
        .as_array()
        .cloned()
        .expect("stretches");
    assert!(
        stretches.iter().any(|s| s["rapid"] == true),
        "{stretches:?}"
    );
    let arc = stretches
        .iter()
        .find(|s| s["rapid"] == false)
        .expect("a circle");
    assert!(
        arc["places_mm"]
            .as_array()
            .is_some_and(|places| places.len() > 3 * 80)
    );
    assert!(
        json("/trail")["points"]
            .as_array()
            .is_some_and(|points| !points.is_empty())
    );
    cell.signal_launcher(libc::SIGTERM);
    let last = frames.last().expect("frames to the end");
    assert_eq!(last["ended"], true, "{last}");
    assert_eq!(cell.finish().status(), 130);
}

#[test]
fn the_page_lists_the_runs_of_its_cell_the_newest_first() {
    let (_bench, cell, short, _) = up("lockstep");
    let by_hand = ByHand::start(&cell, &[]);
    let listed = || -> Vec<Value> {
        let (head, runs) = by_hand.page.get("/runs");
        assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
        serde_json::from_str(&runs).expect("runs")
    };
    assert_eq!(listed(), Vec::<Value>::new());
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &short]);
    for run in 1..=2 {
        obeyed(&cell, &["start", "--wait"]);
        let began = Instant::now();
        let newest = loop {
            let runs = listed();
            assert_eq!(runs.len(), run, "{runs:?}");
            // Its numbers are those of the report, which is made behind its end.
            if runs[0]["program"] == "short.ngc" {
                break runs[0].clone();
            }
            assert!(began.elapsed() < PATIENCE, "{runs:?}");
            std::thread::sleep(Duration::from_millis(20));
        };
        assert_eq!(newest["outcome"], "completed");
        let place = newest["run"].as_str().unwrap_or_default();
        assert!(place.ends_with(&format!("00{run}-short")), "{place}");
    }
    down(cell);
}

#[test]
fn clicks_on_the_page_count_once_each_and_what_is_not_taken_is_said() {
    let (_bench, mut cell, ..) = up("realtime");
    let by_hand = ByHand::start(&cell, &[]);
    let page = &by_hand.page;
    obeyed(&cell, &["enable"]);
    let ready = |now: &Feedback| is(now, Mode::Ready, ProgramState::None);
    let from = cell.wait_for(ready);
    let click = |number: u64, distance: f64, seen: u64| {
        page.order(&format!(
            r#"{{"order":"jog","axis":"X","distance":{distance},"session":7,"click":{number},"seen":{seen}}}"#
        ))
    };
    // However slow this PC is, these are not old.
    let seen = from.scan + 1_000_000;
    for (number, distance, words) in [
        (1, 0.01, "X by 0.01 mm"),
        (2, -0.05, "X by -0.05 mm"),
        (2, -0.05, "X by"),
        (1, 0.01, "X by"),
        (3, 0.02, "X by 0.02 mm"),
    ] {
        let (status, said) = click(number, distance, seen);
        assert_eq!(status, 200, "{number}: {said}");
        assert!(said.contains(words), "{number}: {said}");
    }
    cell.wait_for_scan(1_000);
    let old = click(4, 5.0, 1);
    assert_eq!(old.0, 409, "{old:?}");
    assert!(old.1.starts_with("not taken: X"), "{old:?}");
    let at = cell.wait_for(ready);
    let way = at.axes[0].command_position - from.axes[0].command_position;
    assert_eq!(way, -20_000);
    // What would run on is not taken; what goes beyond the travel is cut.
    assert_eq!(page.order(r#"{"order":"jog-override","percent":0}"#).0, 200);
    assert_eq!(click(5, 3.0, seen).0, 200);
    let more = click(6, 3.0, seen);
    assert!(
        more.0 == 409 && more.1.starts_with("not taken: X still moves"),
        "{more:?}"
    );
    obeyed(&cell, &["hold"]);
    cell.wait_for(|now| now.hold == 1 && now.mode == Mode::Ready as u32);
    obeyed(&cell, &["resume"]);
    let cut = click(7, 9000.0, seen);
    assert_eq!(cut.0, 200, "{cut:?}");
    assert!(cut.1.contains("to the end of its travel"), "{cut:?}");
    obeyed(&cell, &["hold"]);
    let half = page.order(r#"{"order":"jog","axis":"X","distance":1,"session":7,"click":8}"#);
    assert_eq!(half.0, 400, "{half:?}");
    assert!(half.1.contains("`seen`"), "{half:?}");
    let offered: Value = serde_json::from_str(&page.get("/machine").1).expect("JSON");
    assert_eq!(offered["axes"][0]["increments"][0]["way"], 0.001);
    obeyed(&cell, &["down"]);
}

#[test]
fn an_order_needs_the_token_and_comes_from_this_page_alone() {
    let (_bench, cell, _, long) = up("realtime");
    let by_hand = ByHand::start(&cell, &[]);
    let page = &by_hand.page;
    let enable = r#"{"order":"enable"}"#;
    let token = format!("Authorization: Bearer {}", page.token);
    let (status, words) = page.order_with(enable, &[]);
    assert_eq!(status, 401, "{words}");
    assert!(words.contains("Authorization: Bearer TOKEN"), "{words}");
    for wrong in ["Authorization: Bearer 0", &format!("{token}0")] {
        let (status, words) = page.order_with(enable, &[wrong]);
        assert_eq!(status, 403, "{wrong}: {words}");
        assert!(words.contains("not the token of this page"), "{words}");
    }
    let elsewhere = page.order_with(enable, &[&token, "Origin: http://evil.example"]);
    assert_eq!(elsewhere.0, 403, "{elsewhere:?}");
    let rebound = page.order_with(enable, &[&token, "Host: evil.example:8640"]);
    assert_eq!(rebound.0, 403, "{rebound:?}");
    assert!(rebound.1.contains("no name of this PC"), "{rebound:?}");
    let (head, _) = page.ask("POST /order", &[&token, "Content-Type: text/plain"], enable);
    assert!(head.starts_with("HTTP/1.1 415"), "{head}");
    let (head, _) = page.ask("GET /order", &[&token], "");
    assert!(head.starts_with("HTTP/1.1 405"), "{head}");
    let (status, words) = page.order(r#"{"order":"down"}"#);
    assert_eq!(status, 400, "{words}");
    assert!(words.contains(r#"{"order":"hold"}"#), "{words}");
    let (status, _) = page.order(&format!(r#"{{"order":"{}"}}"#, "x".repeat(8000)));
    assert_eq!(status, 413);
    let mut frames = page.frames();
    let untouched = frames.next().expect("a frame");
    assert_eq!(untouched["status"]["mode"], "disabled", "{untouched}");
    // And with the token it is obeyed.
    let refused = page.order(r#"{"order":"jog","axis":"X","distance":1}"#);
    assert_eq!(refused.0, 409, "{refused:?}");
    assert!(refused.1.contains("jog refused: "), "{refused:?}");
    let same = format!("Origin: http://{}", page.address);
    let (status, words) = page.order_with(enable, &[&token, &same]);
    assert_eq!(
        (status, words.contains("drives on")),
        (200, true),
        "{words}"
    );
    frames.until(|frame| frame["status"]["mode"] == "ready");
    obeyed(&cell, &["load", &long]);
    for (order, mode) in [
        (r#"{"order":"start"}"#, "enabled"),
        (r#"{"order":"override","percent":50}"#, "enabled"),
        (r#"{"order":"hold"}"#, "enabled"),
        (r#"{"order":"stop"}"#, "stopped"),
    ] {
        let (status, words) = page.order(order);
        assert_eq!(status, 200, "{order}: {words}");
        frames.until(|frame| frame["status"]["mode"] == mode);
    }
    let last = frames.until(|frame| frame["status"]["override_percent"] == 50);
    assert!(
        event_with(&last, "override 100 % → 50 %").is_some(),
        "{last}"
    );
    drop(by_hand);
    down(cell);
}

/// Connections that take room and say little: every third nothing, every third half a request, every third a byte now and then.
fn silent_connections(address: &str, count: usize) -> Vec<TcpStream> {
    let each = (0..count).map(|number| {
        let mut stream = TcpStream::connect(address).expect("a connection");
        let said: &[u8] = match number % 3 {
            0 => b"",
            1 => b"POST /order HTTP/1.1\r\nHost: ",
            _ => b"P",
        };
        // One that is gone already says nothing.
        let _ = stream.write_all(said);
        stream
    });
    each.collect()
}

/// The master stands still, so that no order has an answer: what is given then is given although others wait.
#[test]
fn an_urgent_order_comes_through_however_many_connections_are_silent_and_orders_wait() {
    const SILENT: usize = 1000;
    const OVERRIDE: &str = r#"{"order":"override","percent":50}"#;
    let (_bench, cell, _, _) = up("realtime");
    obeyed(&cell, &["enable"]);
    let by_hand = ByHand::start(&cell, &[]);
    let page = &by_hand.page;
    let urgent = [
        ("hold", "hold: latched"),
        ("stop", "at rest"),
        ("disable", "drives off"),
        ("estop", "emergency stop: the drives are off"),
    ];
    for (order, says) in size::one_in(2, urgent) {
        let mut silent = silent_connections(&page.address, SILENT);
        let master = cell.pid_of(" plant-sim ");
        send(master, libc::SIGSTOP);
        std::thread::scope(|scope| {
            let (told, refusals) = std::sync::mpsc::channel();
            for _ in 0..5 {
                let told = told.clone();
                scope.spawn(move || {
                    let (status, words) = page.order(OVERRIDE);
                    if status == 503 {
                        let _ = told.send(words);
                    }
                });
            }
            let words = refusals.recv().expect("four wait, and one is refused");
            assert!(words.contains("not given"), "{words}");
            for stream in silent.iter_mut().skip(2).step_by(3) {
                let _ = stream.write_all(b"O");
            }
            let since = Instant::now();
            let urgent = page.send_order(&format!(r#"{{"order":"{order}"}}"#));
            // It is given by the time that one behind it is refused.
            let (status, words) = page.order(OVERRIDE);
            println!("{order} and one behind it: {:?}", since.elapsed());
            assert_eq!(status, 503, "{order}: {words}");
            send(master, libc::SIGCONT);
            let (status, words) = urgent.answer();
            assert_eq!(status, 200, "{order}: {words}");
            assert!(words.contains(says), "{order}: {words}");
        });
        let open = silent.iter().filter(|stream| {
            let _ = stream.set_nonblocking(true);
            let mut stream: &TcpStream = stream;
            let read = stream.read(&mut [0; 512]);
            read.is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock)
        });
        let open = open.count();
        assert!(open <= 64, "{open} of {SILENT} are still open");
    }
    down(cell);
}

/// Twelve without the token look and do not leave, and others connect again and again, as fast as they can.
#[test]
fn a_browser_with_the_token_looks_and_orders_however_many_others_look_and_connect() {
    const HOSTILE: usize = 1000;
    let (_bench, cell, _, _) = up("realtime");
    obeyed(&cell, &["enable"]);
    let by_hand = ByHand::start(&cell, &[]);
    let page = &by_hand.page;
    let mut looking: Vec<Frames> = (0..12).map(|_| page.frames()).collect();
    for frames in &mut looking {
        frames.next().expect("a frame");
    }
    for more in [&[][..], &["Authorization: Bearer 0123456789abcdef"]] {
        let (head, words) = page.ask("GET /frames", more, "");
        assert!(head.starts_with("HTTP/1.1 503"), "{head}");
        assert!(words.contains("with the token"), "{words}");
    }
    let ends = std::sync::atomic::AtomicBool::new(false);
    let ends = &ends;
    std::thread::scope(|scope| {
        let (full, is_full) = std::sync::mpsc::channel();
        scope.spawn(move || {
            let mut open = std::collections::VecDeque::new();
            while !ends.load(std::sync::atomic::Ordering::Relaxed) {
                open.extend(silent_connections(&page.address, 1));
                if open.len() == HOSTILE {
                    let _ = full.send(());
                    open.pop_front();
                }
            }
        });
        is_full.recv().expect("that many");
        let with_token = page.bearer();
        let mut frames = page.frames_with(&[&with_token]);
        let first = frames.next().is_some();
        let since = Instant::now();
        let (status, words) = page.order(r#"{"order":"estop"}"#);
        println!(
            "estop under {HOSTILE} that connect anew: {:?}",
            since.elapsed()
        );
        ends.store(true, std::sync::atomic::Ordering::Relaxed);
        assert!(first, "who has the token sees nothing");
        assert_eq!(status, 200, "{words}");
    });
    drop(by_hand);
    down(cell);
}

/// On a PC of several users, each of whom reaches what is served to this PC.
#[test]
fn looking_needs_the_token_too_where_that_is_asked_for() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let more = ["--web=0", "--token-to-look"];
    let mut cell = LiveCell::start_with(bench.path(), &program, "realtime", &more);
    let of_run = Page::of(&mut cell);
    let by_hand = ByHand::start(&cell, &["--token-to-look"]);
    for page in [&of_run, &by_hand.page] {
        for path in ["/frames", "/machine", "/path", "/trail", "/runs"] {
            assert!(page.get(path).0.starts_with("HTTP/1.1 401"), "{path}");
        }
        let frame = page.frames_with(&[&page.bearer()]).next();
        assert!(frame.is_some(), "with the token one looks");
    }
    let (status, words) = of_run.order(r#"{"order":"stop"}"#);
    assert_eq!(status, 200, "{words}");
    drop(by_hand);
    assert_eq!(cell.finish().status(), 1);
}

#[test]
fn the_token_of_a_file_is_printed_nowhere_and_one_that_others_can_read_is_refused() {
    let (_bench, cell, _, _) = up("realtime");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("token").display().to_string();
    let by_hand = ByHand::start(&cell, &["--token", &file]);
    let token = std::fs::read_to_string(&file).expect("the file");
    assert!(
        by_hand.page.token.starts_with("TOKEN"),
        "{:?}",
        by_hand.page
    );
    let page = Page {
        token: token.trim().into(),
        ..by_hand.page.clone()
    };
    assert_eq!(page.order(r#"{"order":"enable"}"#).0, 200);
    drop(by_hand);
    let open = std::os::unix::fs::PermissionsExt::from_mode(0o644);
    std::fs::set_permissions(&file, open).expect("its mode");
    let refused = quadrant()
        .args(["web", "0", "--cell", &cell.cell, "--token", &file])
        .output()
        .expect("the command");
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{words}");
    assert!(words.contains("chmod 600"), "{words}");
    down(cell);
}

/// Where other machines could look, looking needs the token too, and everybody is warned.
#[test]
fn at_an_address_that_others_reach_even_looking_needs_the_token() {
    let (_bench, cell, _, _) = up("realtime");
    let mut child = quadrant()
        .args(["web", "0.0.0.0:0", "--cell", &cell.cell])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the page");
    let printed = Page::printed(child.stdout.take().expect("standard output"));
    let (_, port) = printed.address.rsplit_once(':').expect("a port");
    let page = Page {
        address: format!("127.0.0.1:{port}"),
        ..printed.clone()
    };
    assert!(page.get("/").0.starts_with("HTTP/1.1 200"));
    for path in ["/frames", "/machine", "/path", "/trail", "/runs"] {
        assert!(page.get(path).0.starts_with("HTTP/1.1 401"), "{path}");
    }
    let (head, _) = page.ask("GET /machine", &[&page.bearer()], "");
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    send(child.id() as i32, libc::SIGTERM);
    let ended = child.wait_with_output().expect("its end");
    let words = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(
        words.contains("CAN BE REACHED FROM OTHER MACHINES"),
        "{words}"
    );
    assert_eq!(ended.status.code(), Some(0), "{words}");
    down(cell);
}

#[test]
fn a_port_that_is_taken_is_refused_before_anything_starts() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a socket");
    let address = taken.local_addr().expect("its address").to_string();
    let bench = Bench::of("xy", &[]);
    let program = circle_program(25.0, 3000.0, (0.0, 0.0), 0.0);
    let program = bench.file("program.ngc", &program);
    let run = run_with(bench.path(), &program, &[&format!("--web={address}")]);
    assert_eq!(run.status(), 3, "{}", run.stderr());
    let words = format!("the page cannot be served at {address}");
    assert!(run.stderr().contains(&words), "{}", run.stderr());
    assert!(!run.out.exists(), "nothing was started");
}

/// A page with browsers that look, take nothing and are cut off, and whose process is killed in the middle.
#[test]
fn no_browser_and_no_dead_page_changes_a_bit_of_the_motion() {
    let bench = Bench::of("xy", &[]);
    let turns = long_program();
    let half: Vec<&str> = turns.lines().take(turns.lines().count() / 2).collect();
    let program = bench.file("circle.ngc", &format!("{}\nM2\n", half.join("\n")));
    let alone = run_with(bench.path(), &program, &[]).good_report();
    let mut cell = LiveCell::start_with(bench.path(), &program, "lockstep", &["--web=0"]);
    let page = Page::of(&mut cell);
    let mut looks = page.frames();
    assert_eq!(looks.by_ref().take(3).count(), 3, "frames");
    let takes_nothing = page.frames();
    let mut cut_off = page.frames();
    cut_off.next().expect("a frame");
    drop(cut_off);
    page.order_with(r#"{"order":"stop"}"#, &[]);
    let process = cell.pid_of(" web ");
    send(process, libc::SIGKILL);
    // They come to an end.
    looks.count();
    let run = cell.finish();
    drop(takes_nothing);
    for digest in ["/motion_digest", "/digest"] {
        assert_eq!(
            text(&alone, digest),
            text(&run.good_report(), digest),
            "{digest}"
        );
    }
    assert!(
        run.stderr()
            .contains("the page in the browser was killed by signal 9"),
        "{}",
        run.stderr()
    );
}

#[test]
fn a_page_that_was_killed_is_there_again_with_the_same_address_and_token() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start_with(bench.path(), &program, "realtime", &["--web=0"]);
    let page = Page::of(&mut cell);
    page.frames().next().expect("a frame");
    send(cell.pid_of(" web "), libc::SIGKILL);
    let scan = |frame: &Value| frame["status"]["scan"].as_u64();
    // Whoever connects meanwhile waits in the socket's queue.
    let again = page.frames().find(|frame| scan(frame).is_some());
    assert!(again.is_some(), "the page is there again");
    let (status, words) = page.order(r#"{"order":"stop"}"#);
    assert_eq!(status, 200, "{words}");
    assert_eq!(cell.finish().status(), 1);
}

/// By the rule of all processes; who is given up is named, and nobody waits at its socket for an answer.
#[test]
fn a_page_that_dies_too_often_is_given_up_with_words_and_its_socket_is_closed() {
    let once = ("[scan]\n", "[restart]\nrestarts_max = 1\n\n[scan]\n");
    let bench = Bench::patient("xy", &[once]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start_with(bench.path(), &program, "realtime", &["--web=0"]);
    let page = Page::of(&mut cell);
    for _ in 0..2 {
        page.frames().next().expect("a frame");
        send(cell.pid_of(" web "), libc::SIGKILL);
    }
    let since = Instant::now();
    while TcpStream::connect(&page.address).is_ok() {
        assert!(since.elapsed() < PATIENCE, "the socket is still open");
        std::thread::sleep(Duration::from_millis(10));
    }
    obeyed(&cell, &["stop"]);
    let run = cell.finish();
    let words = "the page in the browser was restarted 1 times within 60 s: not again";
    assert!(run.stderr().contains(words), "{}", run.stderr());
    assert_eq!(run.status(), 1);
}

/// Who dies shows with its death, and who replaces it with its start.
#[test]
fn a_killed_servo_shows_in_a_frame_with_its_death() {
    let (_bench, mut cell, _, long) = up("realtime");
    let by_hand = ByHand::start(&cell, &[]);
    let mut frames = by_hand.page.frames();
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| is(f, Mode::Enabled, ProgramState::Running));
    send(cell.pid_of(" servo "), libc::SIGKILL);
    let death = |frame: &Value| {
        let all = frame["status"]["processes"].as_array().cloned();
        all.unwrap_or_default()
            .iter()
            .any(|process| process["last_death"]["signal"] == 9)
    };
    let shown = frames.until(death);
    assert!(event_with(&shown, "servo").is_some(), "{shown}");
    drop(by_hand);
    down(cell);
}
