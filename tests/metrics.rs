//! Metrics of running cells: scraped as Prometheus does, and by Prometheus itself.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::support::{
    Bench, LiveCell, circle_program, long_alone, long_program, quadrant, root, run_with, send,
    text, traces_of, unique_cell,
};
use crate::tools::{says, tool};
use monitor::quantities::OF_AXIS;

/// Nothing here takes longer.
const PATIENCE: Duration = Duration::from_secs(60);

/// One answer: its head and its body.
fn get(address: &str, path: &str, accept: &str) -> std::io::Result<(String, String)> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nAccept: {accept}\r\n\r\n"
    );
    stream.write_all(request.as_bytes())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    Ok((head.to_string(), body.to_string()))
}

fn scrape(address: &str) -> Scrape {
    let accept = "application/openmetrics-text;version=1.0.0,text/plain;q=0.5";
    // A PC that is busy with other tests may let one go; a scraper asks again.
    let mut answers = (0..3).map(|_| get(address, "/metrics", accept));
    let (head, body) = answers
        .find_map(Result::ok)
        .expect("one of three scrapes is answered");
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    assert!(
        head.contains("Content-Type: application/openmetrics-text; version=1.0.0"),
        "{head}"
    );
    Scrape::parse(&body)
}

/// A scrape, read by the rules of OpenMetrics 1.0; whatever breaks one of them fails the test.
#[derive(Debug)]
struct Scrape {
    samples: BTreeMap<String, f64>,
    families: BTreeMap<String, String>,
}

impl Scrape {
    fn parse(text: &str) -> Scrape {
        let mut samples = BTreeMap::new();
        let mut families: BTreeMap<String, String> = BTreeMap::new();
        let mut current = String::new();
        let mut help = String::new();
        let body = text.strip_suffix("# EOF\n").expect("the end is printed");
        assert!(!body.contains("# EOF"), "the end is printed once");
        for line in body.lines() {
            if let Some(rest) = line.strip_prefix("# ") {
                let mut words = rest.splitn(3, ' ');
                let (what, name) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
                let value = words.next().unwrap_or("");
                match what {
                    "HELP" => help = name.into(),
                    "TYPE" => {
                        let known = ["counter", "gauge", "histogram", "info"];
                        assert!(known.contains(&value), "{line}");
                        let before = families.insert(name.into(), value.into());
                        assert_eq!(before, None, "{name} is described once");
                        assert_eq!(help, name, "{line}");
                        current = name.into();
                    }
                    "UNIT" => {
                        assert_eq!(current, name, "{line}");
                        assert!(name.ends_with(&format!("_{value}")), "{line}");
                    }
                    _ => panic!("{line}"),
                }
                continue;
            }
            let (series, value) = line.rsplit_once(' ').expect(line);
            let name = series.split('{').next().unwrap_or_default();
            let suffix = name
                .strip_prefix(&current)
                .unwrap_or_else(|| panic!("{line}"));
            let allowed: &[&str] = match families[&current].as_str() {
                "counter" => &["_total"],
                "info" => &["_info"],
                "histogram" => &["_bucket", "_sum", "_count"],
                _ => &[""],
            };
            assert!(allowed.contains(&suffix), "{line}");
            assert!(name.starts_with("quadrant_"), "{line}");
            assert!(series.contains("{cell=\""), "{line}");
            let value: f64 = value.parse().unwrap_or_else(|e| panic!("{line}: {e}"));
            assert!(suffix.is_empty() || value >= 0.0, "{line}");
            let before = samples.insert(series.to_string(), value);
            assert_eq!(before, None, "{series} stands once");
        }
        let scrape = Scrape { samples, families };
        scrape.check_histograms();
        scrape
    }

    fn check_histograms(&self) {
        let counts = self.samples.iter().filter(|(series, _)| {
            let name = series.split('{').next().unwrap_or_default();
            let family = name.strip_suffix("_count").unwrap_or_default();
            self.families
                .get(family)
                .is_some_and(|kind| kind == "histogram")
        });
        for (series, count) in counts {
            let (name, labels) = series.split_once('{').expect(series);
            let family = name.trim_end_matches("_count");
            let axis = labels.split(',').find(|label| label.contains("axis="));
            let axis = axis.unwrap_or_default().trim_end_matches('}');
            let mut buckets: Vec<(f64, f64)> = self
                .samples
                .iter()
                .filter(|(s, _)| s.starts_with(&format!("{family}_bucket")) && s.contains(axis))
                .map(|(s, count)| {
                    let (_, end) = s.split_once("le=\"").expect(s);
                    let end = end.split('"').next().unwrap_or_default();
                    (end.replace("+Inf", "inf").parse().expect(end), *count)
                })
                .collect();
            buckets.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert!(buckets.windows(2).all(|w| w[0].1 <= w[1].1), "{buckets:?}");
            assert_eq!(buckets.last().map(|b| b.1), Some(*count), "{series}");
        }
    }

    /// The value of the series of this family that has all these labels.
    fn value(&self, name: &str, labels: &[&str]) -> f64 {
        self.find(name, labels)
            .unwrap_or_else(|| panic!("no {name} {labels:?} in {:#?}", self.samples))
    }

    fn find(&self, name: &str, labels: &[&str]) -> Option<f64> {
        let found = self.samples.iter().find(|(series, _)| {
            series.split('{').next() == Some(name) && labels.iter().all(|l| series.contains(l))
        });
        found.map(|(_, value)| *value)
    }

    /// Names of all families, as their samples have them.
    fn names(&self) -> BTreeSet<String> {
        let families = self.families.iter();
        families
            .map(|(name, kind)| match kind.as_str() {
                "counter" => format!("{name}_total"),
                "info" => format!("{name}_info"),
                _ => name.clone(),
            })
            .collect()
    }
}

/// A cell that serves metrics, and where.
fn serving(bench: &Bench, program: &str, pace: &str, more: &[&str]) -> (LiveCell, String) {
    let program = bench.file("program.ngc", program);
    let options = [&["--metrics=0"], more].concat();
    let mut cell = LiveCell::start_with(bench.path(), &program, pace, &options);
    let address = address_of(&mut cell);
    (cell, address)
}

/// Where a cell says that it serves metrics.
fn address_of(cell: &mut LiveCell) -> String {
    let stderr = cell.child.stderr.take().expect("standard error");
    let mut lines = BufReader::new(stderr).lines();
    let address = loop {
        let line = lines.next().expect("an address").expect("a line");
        if let Some((_, rest)) = line.split_once("http://") {
            let (address, _) = rest.split_once('/').expect("a path");
            break address.to_string();
        }
    };
    // Nobody is to be held up by a pipe that is full.
    std::thread::spawn(move || lines.count());
    address
}

/// Ends a cell in order.
fn end(cell: LiveCell) {
    cell.signal_launcher(libc::SIGTERM);
    assert_eq!(cell.finish().status(), 130);
}

/// Scrapes until `reached`.
fn scrape_until(address: &str, reached: impl Fn(&Scrape) -> bool) -> Scrape {
    let started = Instant::now();
    loop {
        let scrape = scrape(address);
        if reached(&scrape) {
            return scrape;
        }
        assert!(
            started.elapsed() < PATIENCE,
            "it never came to that: {scrape:#?}"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_scrape_of_a_running_cell_says_what_it_does_in_the_words_of_openmetrics() {
    let bench = Bench::patient("xy", &[]);
    let (mut cell, address) = serving(&bench, &long_program(), "realtime", &[]);
    let reversed = |scrape: &Scrape| {
        let axes = ["axis=\"X\"", "axis=\"Y\""];
        axes.iter().all(|axis| {
            scrape
                .find("quadrant_axis_reversal_protrusion_meters", &[axis])
                .is_some()
        })
    };
    let first = scrape_until(&address, reversed);
    assert_eq!(first.value("quadrant_scan_period_seconds", &[]), 0.001);
    assert_eq!(first.value("quadrant_mode", &["mode=\"enabled\""]), 1.0);
    assert_eq!(first.value("quadrant_mode", &["mode=\"tripped\""]), 0.0);
    assert_eq!(first.value("quadrant_hold", &[]), 0.0);
    assert_eq!(first.value("quadrant_override_ratio", &[]), 1.0);
    let intervals = first.value("quadrant_scan_interval_seconds_count", &[]);
    assert!(intervals > 0.0);
    let mean_s = first.value("quadrant_scan_interval_seconds_sum", &[]) / intervals;
    assert!((0.0005..0.01).contains(&mean_s), "{mean_s} s");
    for process in ["plant-sim", "planner", "servo-X", "servo-Y", "monitor"] {
        let label = format!("process=\"{process}\"");
        assert_eq!(first.value("quadrant_process_up", &[&label]), 1.0);
        assert_eq!(first.value("quadrant_process_starts_total", &[&label]), 1.0);
    }
    for axis in ["axis=\"X\"", "axis=\"Y\""] {
        // Within the travel; the circle has 25 mm; a reversal leaves some µm; nobody has been heated by a second of it.
        assert!(first.value("quadrant_axis_position_meters", &[axis]).abs() < 0.026);
        let peak = first.value("quadrant_axis_following_error_peak_meters", &[axis]);
        assert!((1e-7..5e-4).contains(&peak), "{peak}");
        let height = first.value("quadrant_axis_reversal_protrusion_meters", &[axis]);
        assert!((-1e-5..3e-5).contains(&height), "{height}");
        assert!(first.value("quadrant_axis_winding_rise_kelvin", &[axis]) < 5.0);
        let scans = first.value(
            "quadrant_axis_following_error_magnitude_meters_count",
            &[axis],
        );
        assert!(scans > 100.0, "{scans}");
    }
    let now = cell.wait_for_scan(1);
    let second = scrape_until(&address, |s| {
        s.value("quadrant_scans_total", &[]) > now.scan as f64
    });
    let bytes = |scrape: &Scrape| scrape.value("quadrant_log_bytes_total", &[]);
    assert!(bytes(&second) >= bytes(&first) && bytes(&first) > 0.0);
    // What is named here and what is described in the manual is the same.
    let manual =
        fs::read_to_string(root().join("docs/howto/metrics.md")).expect("docs/howto/metrics.md");
    let rows = manual
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split('`').next());
    let rows = rows.filter(|name| name.starts_with("quadrant_"));
    let mut described: BTreeSet<String> = rows.map(str::to_string).collect();
    // The others say in one place what they are.
    described.extend(OF_AXIS.map(|one| format!("quadrant_axis_{}_{}", one.metric.0, one.metric.1)));
    assert_eq!(first.names(), described);
    // Hold and override are seen, and a recorder that replaces a lost one.
    let order = |words: &[&str]| says(quadrant().args(words).args(["--cell", &cell.cell]));
    order(&["hold"]);
    order(&["override", "40"]);
    let held = |scrape: &Scrape| {
        let share = scrape.value("quadrant_override_ratio", &[]);
        scrape.value("quadrant_hold", &[]) == 1.0 && (share - 0.4).abs() < 1e-12
    };
    scrape_until(&address, held);
    send(cell.pid_of("recorder"), libc::SIGKILL);
    let again = scrape_until(&address, |scrape| {
        scrape.find("quadrant_process_starts_total", &["process=\"monitor\""]) == Some(2.0)
    });
    assert!(again.value("quadrant_scans_total", &[]) > second.value("quadrant_scans_total", &[]));
    if let Some(promtool) = tool("promtool") {
        let (head, older) = get(&address, "/metrics", "*/*").expect("an answer");
        assert!(
            head.contains("Content-Type: text/plain; version=0.0.4"),
            "{head}"
        );
        let mut check = Command::new(promtool);
        check
            .args(["check", "metrics"])
            .stdin(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = check.spawn().expect("promtool");
        let mut stdin = child.stdin.take().expect("its input");
        stdin.write_all(older.as_bytes()).expect("metrics");
        drop(stdin);
        let printed = child.wait_with_output().expect("promtool");
        let words = String::from_utf8_lossy(&printed.stderr);
        assert!(printed.status.success() && words.is_empty(), "{words}");
    }
    end(cell);
}

#[test]
fn a_cell_that_stays_up_tells_which_program_it_has_and_how_far_it_is() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    // A service manager that is not there stops nobody.
    let nobody = bench.path().join("nobody");
    let mut cell = LiveCell::up_told(&unique_cell(), bench.path(), &nobody, &["--metrics=0"]);
    let address = address_of(&mut cell);
    let state = |scrape: &Scrape, word: &str| {
        let label = format!("state=\"{word}\"");
        scrape.find("quadrant_program_state", &[&label]) == Some(1.0)
    };
    let empty = scrape_until(&address, |scrape| state(scrape, "none"));
    assert_eq!(empty.value("quadrant_mode", &["mode=\"disabled\""]), 1.0);
    assert_eq!(empty.value("quadrant_runs_total", &[]), 0.0);
    assert_eq!(empty.value("quadrant_cell_info", &["program=\"\""]), 1.0);
    assert_eq!(empty.value("quadrant_log_bytes_total", &[]), 0.0);
    let order = |words: &[&str]| says(quadrant().args(words).args(["--cell", &cell.cell]));
    order(&["enable"]);
    order(&["load", &program.display().to_string()]);
    let loaded = scrape_until(&address, |scrape| state(scrape, "loaded"));
    assert_eq!(loaded.value("quadrant_mode", &["mode=\"ready\""]), 1.0);
    assert_eq!(
        loaded.value("quadrant_cell_info", &["program=\"circle.ngc\""]),
        1.0
    );
    order(&["start"]);
    let reversed = |scrape: &Scrape| {
        // Known on arcs only: the program was found where it lies in the cell.
        let name = "quadrant_axis_reversal_protrusion_meters";
        scrape.find(name, &[]).is_some() && state(scrape, "running")
    };
    let started = scrape_until(&address, reversed);
    assert_eq!(started.value("quadrant_runs_total", &[]), 1.0);
    scrape_until(&address, |s| s.value("quadrant_log_bytes_total", &[]) > 0.0);
    order(&["down"]);
    assert_eq!(cell.finish().status(), 0);
}

#[test]
fn scrapes_in_a_tight_loop_and_a_client_that_reads_nothing_change_no_bit() {
    let bench = Bench::of("xyz-mill", &[]);
    let turns = circle_program(25.0, 3000.0, (0.0, 0.0), 0.0);
    let once = turns
        .lines()
        .find(|line| line.starts_with("G3"))
        .expect("a turn");
    let program = turns.replace("M2\n", &format!("{}M2\n", format!("{once}\n").repeat(2)));
    let file = bench.file("program.ngc", &program);
    let alone = run_with(bench.path(), &file, &[]).good_report();
    let (cell, address) = serving(&bench, &program, "lockstep", &[]);
    let mut silent = TcpStream::connect(&address).expect("a connection");
    silent
        .write_all(b"GET /metrics HTTP/1.1\r\n\r\n")
        .expect("a request");
    let mut hanging = TcpStream::connect(&address).expect("a connection");
    hanging.write_all(b"GET /met").expect("half a request");
    let (ended, scrapes) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicU64::new(0)),
    );
    let scraper = {
        let (ended, scrapes, address) = (Arc::clone(&ended), Arc::clone(&scrapes), address.clone());
        std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                if let Ok((_, body)) = get(&address, "/metrics", "application/openmetrics-text")
                    && body.ends_with("# EOF\n")
                {
                    scrapes.fetch_add(1, Ordering::Relaxed);
                }
            }
        })
    };
    let scraped = cell.finish().good_report();
    ended.store(true, Ordering::Relaxed);
    scraper.join().expect("the scraper");
    drop((silent, hanging));
    assert!(scrapes.load(Ordering::Relaxed) > 10, "{scrapes:?} scrapes");
    for digest in ["/motion_digest", "/digest"] {
        assert_eq!(text(&alone, digest), text(&scraped, digest), "{digest}");
    }
}

/// In lockstep: the process that serves is killed in the middle of the run.
#[test]
fn the_death_of_the_process_that_serves_metrics_changes_no_bit() {
    let bench = Bench::of("xy", &[]);
    let (cell, address) = serving(&bench, &long_program(), "lockstep", &[]);
    scrape(&address);
    send(cell.pid_of(" metrics "), libc::SIGKILL);
    let run = cell.finish().good_report();
    for digest in ["/motion_digest", "/digest"] {
        assert_eq!(text(long_alone(), digest), text(&run, digest), "{digest}");
    }
}

#[test]
fn a_process_that_serves_metrics_and_was_killed_is_there_again_at_the_same_address() {
    let bench = Bench::patient("xy", &[]);
    let (mut cell, address) = serving(&bench, &long_program(), "realtime", &[]);
    let before = cell.wait_for_scan(1).scan as f64;
    scrape(&address);
    send(cell.pid_of(" metrics "), libc::SIGKILL);
    // Whoever connects meanwhile waits in the socket's queue.
    let monitor = ["process=\"monitor\""];
    let again = scrape_until(&address, |s| {
        let goes_on = s.value("quadrant_scans_total", &[]) > before;
        goes_on && s.find("quadrant_process_up", &monitor).is_some()
    });
    assert_eq!(again.value("quadrant_process_up", &monitor), 1.0);
    assert_eq!(again.value("quadrant_process_starts_total", &monitor), 1.0);
    end(cell);
}

#[test]
fn a_port_that_is_taken_is_refused_before_anything_starts() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a socket");
    let address = taken.local_addr().expect("its address").to_string();
    let bench = Bench::of("xy", &[]);
    let program = bench.file(
        "program.ngc",
        &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0),
    );
    let run = run_with(bench.path(), &program, &[&format!("--metrics={address}")]);
    assert_eq!(run.status(), 3, "{}", run.stderr());
    let printed = run.stderr();
    assert!(
        printed.contains(&address) && printed.contains("cannot listen there"),
        "{printed}"
    );
    assert!(!run.out.exists());
    assert_eq!(traces_of(&run.cell), Vec::<String>::new());
}

#[test]
fn an_address_that_is_none_is_bad_usage_and_one_for_everybody_is_warned_of() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("program.ngc", "G0 X1\nM2\n");
    let run = run_with(bench.path(), &program, &["--metrics=localhost"]);
    assert_eq!(run.status(), 2, "{}", run.stderr());
    assert!(run.stderr().contains("127.0.0.1:7823"), "{}", run.stderr());
    let run = run_with(bench.path(), &program, &["--metrics=0.0.0.0:0"]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert!(
        run.stderr().contains("CAN BE REACHED FROM OTHER MACHINES"),
        "{}",
        run.stderr()
    );
}

#[test]
fn without_the_option_nobody_listens() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("program.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1);
    let listening: Vec<String> = ["tcp", "tcp6"]
        .iter()
        .flat_map(|table| {
            let table = fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default();
            let lines = table
                .lines()
                .skip(1)
                .map(str::to_string)
                .collect::<Vec<_>>();
            lines.into_iter().filter_map(|line| {
                let mut words = line.split_whitespace().skip(3);
                // State 0A is LISTEN; the inode is the seventh word behind it.
                (words.next() == Some("0A")).then(|| words.nth(5).unwrap_or("").to_string())
            })
        })
        .collect();
    let own = [cell.child.id() as i32].into_iter();
    for pid in own.chain(cell.children().into_iter().map(|(pid, _)| pid)) {
        let files = fs::read_dir(format!("/proc/{pid}/fd")).expect("its files");
        for file in files.flatten() {
            let target = fs::read_link(file.path()).unwrap_or_default();
            let target = target.to_string_lossy();
            let inode = target
                .strip_prefix("socket:[")
                .and_then(|i| i.strip_suffix(']'));
            let listens = inode.is_some_and(|inode| listening.iter().any(|i| i == inode));
            assert!(!listens, "process {pid} listens at {target}");
        }
    }
    end(cell);
}

/// A child that is ended when the test is.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn prometheus_itself_scrapes_a_cell_and_answers_questions_about_it() {
    let Some(prometheus) = tool("prometheus") else {
        return;
    };
    let bench = Bench::patient("xy", &[]);
    let (cell, address) = serving(&bench, &long_program(), "realtime", &[]);
    let rules = root().join("packaging/prometheus/quadrant.rules.yml");
    let config = format!(
        "global: {{scrape_interval: 250ms, evaluation_interval: 250ms}}\nrule_files: [{}]\nscrape_configs:\n  - job_name: quadrant\n    static_configs:\n      - targets: ['{address}']\n",
        rules.display()
    );
    let config = bench.file("prometheus.yml", &config);
    let mut server = Command::new(prometheus);
    server
        .arg(format!("--config.file={}", config.display()))
        .arg(format!(
            "--storage.tsdb.path={}",
            bench.path().join("tsdb").display()
        ))
        .args(["--web.listen-address=127.0.0.1:0"])
        .current_dir(bench.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut server = Ended(server.spawn().expect("prometheus"));
    let mut lines = BufReader::new(server.0.stderr.take().expect("its words")).lines();
    let at = loop {
        let line = lines.next().expect("prometheus goes on").expect("a line");
        if let Some((_, rest)) = line.split_once("Listening on\" address=") {
            break rest.trim().to_string();
        }
    };
    std::thread::spawn(move || lines.count());
    let ask = |query: &str| -> Option<serde_json::Value> {
        let (_, body) = get(&at, &format!("/api/v1/query?query={query}"), "*/*").ok()?;
        // Not ready yet: 503. Its answers are one line, in chunks or not.
        let json = body.lines().find(|line| line.starts_with('{'))?;
        serde_json::from_str(json).ok()
    };
    let started = Instant::now();
    let value = loop {
        let answer = ask("quadrant_scans_total").unwrap_or_default();
        let result = answer.pointer("/data/result/0").cloned();
        if let Some(result) = result {
            break result;
        }
        assert!(
            started.elapsed() < PATIENCE,
            "nothing was scraped: {answer}"
        );
        std::thread::sleep(Duration::from_millis(100));
    };
    assert_eq!(value["metric"]["job"], "quadrant");
    let unit = get(&at, "/api/v1/targets", "*/*").expect("targets").1;
    assert!(unit.contains("\"health\":\"up\""), "{unit}");
    let meta = get(
        &at,
        "/api/v1/targets/metadata?metric=quadrant_axis_winding_rise_kelvin",
        "*/*",
    );
    let meta = meta.expect("metadata").1;
    assert!(meta.contains("\"unit\":\"kelvin\""), "{meta}");
    let ends = ask("histogram_quantile(0.5,quadrant_axis_following_error_magnitude_meters_bucket)");
    let ends = ends.unwrap_or_default();
    assert!(ends.pointer("/data/result/1/value").is_some(), "{ends}");
    end(cell);
}
