//! `quadrant-lab bench`: every bench, and that none of them, and no tool that starts cells, leaves anything behind.

use std::fs;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use crate::size;
use crate::support::{Bench, PATIENCE, children_of, quadrant, root, send, wait_until_gone};

#[test]
fn a_small_grid_gives_a_table_a_csv_and_a_plot() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    let done = quadrant()
        .args(["bench", "circles", "machines/xy", "--radii", "12"])
        .args([
            "--feeds",
            "4000",
            "--methods",
            "none,backlash,pulse-decaying",
        ])
        .args(["--centre", "-5,3", "--start-deg", "-30", "--out"])
        .arg(&out)
        .output()
        .expect("quadrant");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let table = String::from_utf8_lossy(&done.stdout);
    assert!(
        table.contains("R12     F4000") && table.contains("never worse than backlash"),
        "{table}"
    );

    let csv = fs::read_to_string(out.join("circles.csv")).expect("circles.csv");
    let mut lines = csv.lines();
    let names: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let column = |name: &str| {
        let place = names.iter().position(|n| *n == name);
        place.unwrap_or_else(|| panic!("no column {name} in {names:?}"))
    };
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 3);
    let worst: Vec<f64> = rows
        .iter()
        .map(|row| {
            assert_eq!(row.len(), names.len());
            assert_eq!(
                (
                    row[column("machine")],
                    row[column("radius_mm")],
                    row[column("feed_mm_min")]
                ),
                ("xy", "12", "4000")
            );
            let number = |name: &str| row[column(name)].parse::<f64>().expect("a number");
            let per_axis = ["x", "y"].map(|axis| {
                number(&format!("{axis}_protrusion_um"))
                    .max(-number(&format!("{axis}_undercut_um")))
            });
            let worst_um = number("worst_um");
            assert_eq!(worst_um, per_axis[0].max(per_axis[1]));
            worst_um
        })
        .collect();
    let methods: Vec<&str> = rows.iter().map(|row| row[column("method")]).collect();
    assert_eq!(methods, ["none", "backlash", "pulse-decaying"]);
    assert!(
        worst[0] > worst[1] && worst[1] > 2.0 * worst[2],
        "{worst:?}"
    );
    let plot = fs::read_to_string(out.join("circles.svg")).expect("circles.svg");
    assert!(plot.starts_with("<svg") && plot.contains("pulse-decaying"));
}

#[test]
fn a_grid_the_machine_cannot_run_is_refused_before_anything_starts() {
    for (arguments, printed) in [
        (["--radii", "400", "--feeds", "3000"], "R400 F3000"),
        (
            ["--radii", "5", "--feeds", "12000"],
            "R5 F12000: v²/R = 8000 mm/s²: axis X accelerates with at most 5000 mm/s²",
        ),
        (
            ["--radii", "100", "--feeds", "20000"],
            "axis X goes at most 250 mm/s",
        ),
        (["--radii", "0", "--feeds", "1000"], "must be above 0"),
        (["--methods", "luck", "--feeds", "1000"], "pulse-decaying"),
        (["--centre", "1", "--feeds", "1000"], "must be X,Y"),
    ] {
        let done = quadrant()
            .args(["bench", "circles", "machines/xy"])
            .args(arguments)
            .output()
            .expect("quadrant");
        let stderr = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {stderr}");
        assert!(stderr.contains(printed), "{arguments:?}: {stderr}");
    }
}

/// A bench: words of its figures after its shortest form, and a form that goes on for minutes with what it starts meanwhile.
struct Known {
    name: &'static str,
    short: Option<&'static str>,
    long: &'static [&'static str],
    roles: &'static [&'static str],
}

const RUN: &[&str] = &["quadrant run", "quadrant servo"];
/// All of them. Those without words have tests of their own below; a cell of the one of the fieldbus needs drives on a bus:
/// tests/ethercat/observed.rs.
const BENCHES: [Known; 14] = [
    Known {
        name: "all",
        short: None,
        long: &[],
        roles: &[],
    },
    Known {
        name: "lockstep",
        short: Some("hand-overs by bare rings of"),
        long: &["--rounds", "1000"],
        roles: &["quadrant bench-pong"],
    },
    Known {
        name: "circles",
        short: None,
        long: &["--radii", "100", "--feeds", "1000", "--jobs", "2"],
        roles: RUN,
    },
    Known {
        name: "faults",
        short: Some("scans judged"),
        long: &["--seeds", "1000000"],
        roles: &[],
    },
    Known {
        name: "fieldbus",
        short: None,
        long: &[],
        roles: &[],
    },
    Known {
        name: "ipc",
        short: Some("floor: bare iceoryx2"),
        long: &["--axes", "2", "--rounds", "1000"],
        roles: &["quadrant bench-pong"],
    },
    Known {
        name: "planning",
        short: Some("planned/s"),
        long: &["machines/xy"],
        roles: &[],
    },
    Known {
        name: "plants",
        short: None,
        long: &["--random", "1000"],
        roles: &[],
    },
    Known {
        name: "procedures",
        short: Some("cells of the table"),
        long: &["--seeds", "1000000"],
        roles: &[],
    },
    Known {
        name: "report",
        short: None,
        long: &["--minutes", "60"],
        roles: RUN,
    },
    Known {
        name: "scan",
        short: Some("a window of the planner"),
        long: &[],
        roles: &[],
    },
    Known {
        name: "simulation",
        short: Some("scans/s"),
        long: &["--rounds", "1000"],
        roles: &[],
    },
    Known {
        name: "wakeup",
        short: Some("cell over bare loop"),
        long: &["--seconds", "3"],
        roles: RUN,
    },
    Known {
        name: "merge",
        short: None,
        long: &[],
        roles: &[],
    },
];

#[test]
fn every_bench_of_the_command_line_stands_in_the_table_of_this_test() {
    let help = quadrant().args(["bench", "--help"]).output().expect("help");
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    let (_, commands) = help.split_once("Commands:\n").expect("commands");
    let (commands, _) = commands.split_once("\n\n").expect("options behind them");
    let names = commands
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help");
    let names: Vec<&str> = names.collect();
    assert_eq!(names, BENCHES.map(|bench| bench.name));
}

/// A bench or a tool that was started, with all that it starts.
struct Started {
    child: Child,
    name: String,
    temporary: TempDir,
    begun: Instant,
}

impl Started {
    fn new(words: &[&str]) -> Started {
        let temporary = tempfile::tempdir().expect("a temporary folder");
        let mut command = quadrant();
        command
            .args(words)
            .env("TMPDIR", temporary.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let hears_interrupts = || {
            // SAFETY: it is given a known signal, and async-signal-safe (POSIX).
            unsafe { libc::signal(libc::SIGINT, libc::SIG_DFL) };
            Ok(())
        };
        // SAFETY: between fork and exec it calls that function alone. A suite in the background of a shell ignores the signal.
        unsafe { command.pre_exec(hears_interrupts) };
        let child = command.spawn().expect("quadrant");
        Started {
            child,
            name: words.join(" "),
            temporary,
            begun: Instant::now(),
        }
    }

    /// Waits a moment for something that must come.
    fn wait(&self, what: &str) {
        assert!(self.begun.elapsed() < PATIENCE, "{}: {what}", self.name);
        std::thread::sleep(Duration::from_millis(5));
    }

    /// Its children and theirs.
    fn descendants(&self) -> Vec<(i32, String)> {
        let mut found = children_of(self.child.id());
        let mut next = 0;
        while let Some((pid, _)) = found.get(next) {
            found.extend(children_of(*pid as u32));
            next += 1;
        }
        found
    }

    /// Sends it a signal while all these words are in command lines of its descendants: nothing of it stays. How it ended.
    fn ends_with_all(mut self, signal: i32, roles: &[&str]) -> (ExitStatus, TempDir) {
        let descendants = loop {
            let all = self.descendants();
            let lines = |role: &&str| all.iter().any(|(_, line)| line.contains(*role));
            if roles.iter().all(lines) {
                break all;
            }
            self.wait("it never came to that");
            assert!(
                self.child.try_wait().expect("it").is_none(),
                "{}",
                self.name
            );
        };
        send(self.child.id() as i32, signal);
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("it") {
                break status;
            }
            self.wait("it does not end");
        };
        wait_until_gone(&descendants);
        // What it has started since then is named by its cell.
        let mark = format!("-{}", self.child.id());
        while processes_with("--cell ")
            .iter()
            .any(|line| is_of(line, &mark))
        {
            self.wait("something of it lives on");
        }
        let shared = fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
        let shared: Vec<String> = shared
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .filter(|name| is_of(name, &mark))
            .collect();
        assert!(shared.is_empty(), "{}: {shared:?}", self.name);
        let nowhere = tempfile::tempdir().expect("a temporary folder");
        (status, std::mem::replace(&mut self.temporary, nowhere))
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Whether a command line or a file is of a cell that is named by this process id.
fn is_of(text: &str, mark: &str) -> bool {
    let mut behind = text
        .match_indices(mark)
        .map(|(at, _)| &text[at + mark.len()..]);
    behind.any(|rest| !rest.starts_with(|c: char| c.is_ascii_digit()))
}

/// With the roles that are there when it is ended.
fn ended_in_the_middle(words: &[&str], roles: &[&str]) {
    Started::new(words).ends_with_all(libc::SIGKILL, roles);
    let (status, temporary) = Started::new(words).ends_with_all(libc::SIGINT, roles);
    // One that has neither processes nor files is ended by the signal itself.
    let by_signal = roles.is_empty() && status.signal() == Some(libc::SIGINT);
    assert!(
        status.code() == Some(130) || by_signal,
        "{words:?}: {status}"
    );
    let left = fs::read_dir(temporary.path())
        .expect("the folder")
        .flatten();
    let left: Vec<_> = left.map(|entry| entry.path()).collect();
    assert!(by_signal || left.is_empty(), "{words:?}: {left:?}");
}

#[test]
fn a_bench_that_is_killed_or_interrupted_leaves_no_process_and_no_shared_memory() {
    for bench in BENCHES.iter().filter(|bench| !bench.long.is_empty()) {
        let words = [&["bench", bench.name], bench.long].concat();
        ended_in_the_middle(&words, bench.roles);
    }
}

#[test]
fn a_tool_that_is_killed_or_interrupted_leaves_no_process_and_no_shared_memory() {
    let machine = Bench::of("xy", &[]);
    let machine = machine.path().display().to_string();
    ended_in_the_middle(&["tune", &machine, "--dry-run"], RUN);
    ended_in_the_middle(
        &["soak", &machine, "--kills", "1000", "--only", "planner"],
        RUN,
    );
}

/// Command lines of processes that have `mark` in them.
fn processes_with(mark: &str) -> Vec<String> {
    fs::read_dir("/proc")
        .expect("/proc")
        .flatten()
        .filter_map(|entry| fs::read(entry.path().join("cmdline")).ok())
        .map(|line| String::from_utf8_lossy(&line).replace('\0', " "))
        .filter(|line| line.contains(mark))
        .collect()
}

#[test]
fn the_report_of_a_long_log_is_measured_beside_reading_alone() {
    let done = quadrant()
        .args(["bench", "report", "machines/xy", "--minutes", "1"])
        .output()
        .expect("quadrant");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let printed = String::from_utf8_lossy(&done.stdout);
    let value = |name: &str| {
        let line = printed.lines().find(|line| line.trim().starts_with(name));
        let words = line.and_then(|line| line.trim().strip_prefix(name));
        let number = words.and_then(|words| words.split_whitespace().next());
        let number = number.and_then(|number| number.parse::<f64>().ok());
        number.unwrap_or_else(|| panic!("no {name} in\n{printed}"))
    };
    // A minute at least, and nothing is free.
    assert!(printed.contains("scans of 2 axes"), "{printed}");
    assert!(value("report:") >= 60.0, "{printed}");
    for name in ["log", "wall time", "processor time", "peak memory", "floor"] {
        assert!(value(name) > 0.0, "{printed}");
    }
    // It reads the log, too: it cannot be cheaper than only that, but for the grain of the clocks.
    assert!(value("ratio") > 0.9, "{printed}");
}

#[test]
fn a_machine_of_three_axes_is_measured_beside_its_own_floor_and_who_watches_it() {
    let done = quadrant()
        .args(["bench", "lockstep", "--rounds", "1", "--axes", "3"])
        .output()
        .expect("quadrant");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let printed = String::from_utf8_lossy(&done.stdout);
    for words in ["axes: 3, processes: 6", "hand-overs  ", "who watches"] {
        assert!(printed.contains(words), "{words}: {printed}");
    }
    let (_, part) = printed.split_once("who watches").expect("a part");
    let percent = part.split_whitespace().next().expect("a number");
    let percent: f64 = percent.parse().expect("a number");
    assert!(percent > 1.0 && percent < 99.0, "{printed}");
}

/// Runs benches in their shortest form, one after the other: each gives its figures, all together a table and a file for programs.
fn end_well_and_give_figures(names: &[&str]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let done = quadrant()
        .args(["bench", "all", "--shortest", "--only"])
        .arg(names.join(","))
        .arg("--out")
        .arg(folder.path().join("out"))
        .output()
        .expect("quadrant");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let printed = String::from_utf8_lossy(&done.stdout);
    let read = |name: &str| fs::read_to_string(folder.path().join("out").join(name));
    let table = read("bench.md").expect("bench.md");
    let json = read("bench.json").expect("bench.json");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let figures = json["figures"].as_array().expect("figures");
    let short = BENCHES.iter().filter(|bench| names.contains(&bench.name));
    for (name, words) in short.filter_map(|bench| Some((bench.name, bench.short?))) {
        let (_, its) = printed
            .split_once(&format!("== bench {name}"))
            .unwrap_or_else(|| panic!("no {name}: {printed}"));
        let its = its.split("\n== ").next().unwrap_or_default();
        assert!(its.contains(words), "{name}: {its}");
        let is_number = |word: &str| word.parse::<f64>().is_ok();
        let shown = its.lines().skip(1);
        let mut shown = shown.flat_map(str::split_whitespace);
        assert!(shown.any(is_number), "{name}: {its}");
        let its: Vec<_> = figures.iter().filter(|f| f["bench"] == name).collect();
        assert!(!its.is_empty(), "{name}: {json}");
        for figure in its {
            // A missed scan, or what the grain of a clock is too coarse for, may be none.
            let least = if ABOVE_0.contains(&name) {
                f64::MIN_POSITIVE
            } else {
                0.0
            };
            let value = figure["value"].as_f64();
            assert!(value.is_some_and(|value| value >= least), "{figure}");
        }
        assert!(table.contains(&format!("| {name} | ")), "{table}");
    }
    let is_left_out = table.contains("Left out: fieldbus");
    assert_eq!(is_left_out, names.contains(&"fieldbus"), "{table}");
    assert!(json["place"]["cores"].as_u64() > Some(0), "{json}");
}

const OF_COMPUTING: [&str; 7] = [
    "faults",
    "fieldbus",
    "ipc",
    "planning",
    "procedures",
    "scan",
    "simulation",
];
const OF_CELLS: [&str; 2] = ["lockstep", "wakeup"];
/// All that these measure is above 0.
const ABOVE_0: [&str; 3] = ["faults", "ipc", "simulation"];

#[test]
fn benches_of_computing_end_well_in_their_shortest_form_and_give_figures() {
    end_well_and_give_figures(&OF_COMPUTING);
}

#[test]
fn benches_of_whole_cells_end_well_in_their_shortest_form_and_give_figures() {
    end_well_and_give_figures(&OF_CELLS);
}

#[test]
fn every_bench_whose_figures_are_known_is_run_in_its_shortest_form() {
    let run = |name: &str| OF_COMPUTING.contains(&name) || OF_CELLS.contains(&name);
    let known = BENCHES.iter().filter(|bench| bench.short.is_some());
    let left_out: Vec<&str> = known
        .map(|bench| bench.name)
        .filter(|name| !run(name))
        .collect();
    assert!(left_out.is_empty(), "{left_out:?}");
}

#[test]
fn without_valgrind_a_scan_is_timed_and_nothing_is_compared() {
    let done = quadrant()
        .args(["bench", "scan", "--check"])
        .env("PATH", "/nowhere")
        .output()
        .expect("quadrant");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let printed = String::from_utf8_lossy(&done.stdout);
    assert!(printed.contains("valgrind is not installed"), "{printed}");
    assert!(printed.contains("a servo's scan"), "{printed}");
}

/// Lines of a bench's output that say what was found, without times and progress.
fn totals(output: &std::process::Output) -> Vec<String> {
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let passes = |line: &&str| {
        let is_found = !line.starts_with("in ") && !line.contains("scans; undisturbed");
        is_found && !line.contains("runs/s")
    };
    printed.lines().filter(passes).map(str::to_owned).collect()
}

/// Runs a campaign as a whole and in parts, and merges those in another order.
fn whole_and_merged(words: &[&str], parts: u32) -> (Vec<String>, Vec<String>) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = |words: &[&str]| {
        let done = quadrant().args(words).output().expect("quadrant");
        let stderr = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{words:?}: {stderr}");
        done
    };
    let whole = totals(&run(words));
    let mut files: Vec<String> = Vec::new();
    for part in 1..=parts {
        let file = folder.path().join(format!("{part}.jsonl"));
        let (file, part) = (file.display().to_string(), format!("{part}/{parts}"));
        run(&[words, &["--part", &part, "--lines", &file]].concat());
        files.push(file);
    }
    files.reverse();
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    let merged = totals(&run(&[&["bench", "merge"], files.as_slice()].concat()));

    // A part that was not run is no total, and one that was run twice neither.
    let merge = |files: &[&str]| {
        let done = quadrant().args(["bench", "merge"]).args(files).output();
        let done = done.expect("quadrant");
        let stderr = String::from_utf8_lossy(&done.stderr).into_owned();
        (done.status.code(), stderr)
    };
    let (status, said) = merge(&files[1..]);
    assert!(status == Some(2) && said.contains("are missing"), "{said}");
    let (status, said) = merge(&[files.as_slice(), &files[..1]].concat());
    assert!(
        status == Some(2) && said.contains("is there twice"),
        "{said}"
    );
    (whole, merged)
}

#[test]
fn parts_of_a_campaign_of_faults_have_the_totals_of_one_run() {
    let words = ["bench", "faults", "machines/xy", "--seeds", "9"];
    let (whole, merged) = whole_and_merged(&words, 3);
    assert_eq!(whole, merged);
    assert!(
        whole.iter().any(|line| line.starts_with("9 seeds: ")),
        "{whole:?}"
    );
}

#[test]
fn parts_of_a_campaign_of_plants_have_the_totals_of_one_run() {
    let words = [
        "bench",
        "plants",
        "machines/xy",
        "--random",
        "2",
        "--seed",
        "5",
    ];
    let (whole, merged) = whole_and_merged(&words, 2);
    assert_eq!(whole, merged);
    let first = "2 random plants of seed 5 from number 0 on; machines/xy";
    assert!(whole.iter().any(|line| line == first), "{whole:?}");
}

/// Whoever runs array jobs finds no cluster here: their shells do what they would be told to do there, on four seeds in two parts.
#[test]
fn the_array_jobs_of_the_book_do_their_parts_and_are_added_up() {
    let page = fs::read_to_string(root().join("docs/howto/campaigns.md")).expect("the page");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("bin")).expect("a folder");
    std::os::unix::fs::symlink(quadrant().get_program(), path("bin/quadrant-lab")).expect("a link");
    std::os::unix::fs::symlink(root().join("machines"), path("machines")).expect("a link");
    let own_srun = "#!/bin/sh\nexec \"$@\"\n";
    fs::write(path("bin/srun"), own_srun).expect("a file");
    let executable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    fs::set_permissions(path("bin/srun"), executable).expect("its mode");
    let shell = |program: &str, script: &str, settings: &[(&str, &str)]| {
        let search = std::env::var("PATH").unwrap_or_default();
        let done = std::process::Command::new(program)
            .args(["-c", script])
            .current_dir(folder.path())
            .env("PATH", format!("{}:{search}", path("bin").display()))
            .env("SLURM_SUBMIT_DIR", folder.path())
            .envs(settings.iter().copied())
            .output()
            .expect("a shell");
        assert!(done.status.success(), "{script}: {done:?}");
        String::from_utf8_lossy(&done.stdout).into_owned()
    };
    let small = |text: &str| text.replace("--seeds 100000", "--seeds 4");
    let merge = "quadrant-lab bench merge faults-*.jsonl";
    assert!(page.contains(merge), "{merge}");
    let is_whole = |said: &str| said.lines().any(|line| line.starts_with("4 seeds: "));

    let (_, slurm) = page
        .split_once("#!/bin/bash\n")
        .expect("a script for Slurm");
    let (slurm, _) = slurm.split_once("```").expect("its end");
    for part in ["1", "2"] {
        let settings = [
            ("SLURM_ARRAY_TASK_ID", part),
            ("SLURM_ARRAY_TASK_COUNT", "2"),
            ("SLURM_CPUS_PER_TASK", "1"),
        ];
        shell("bash", &small(slurm), &settings);
    }
    let said = shell("sh", merge, &[]);
    assert!(is_whole(&said), "{said}");
    for part in ["1", "2"] {
        fs::remove_file(path(&format!("faults-{part}.jsonl"))).expect("its lines");
    }

    let (_, pod) = page
        .split_once("            - exec ")
        .expect("a command for a pod");
    let (pod, _) = pod.split_once("\n          resources:").expect("its end");
    let folded: Vec<&str> = pod.lines().map(str::trim).collect();
    let pod = small(&folded.join(" ")).replace("/16", "/2");
    let pod = pod.replace("/lines/", &format!("{}/", folder.path().display()));
    for index in ["0", "1"] {
        shell(
            "sh",
            &format!("exec {pod}"),
            &[("JOB_COMPLETION_INDEX", index)],
        );
    }
    let said = shell("sh", merge, &[]);
    assert!(is_whole(&said), "{said}");
}

#[test]
fn lines_of_different_campaigns_are_not_added_up() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| folder.path().join(name).display().to_string();
    for (seeds, name) in [("1", "one"), ("2", "other")] {
        let done = quadrant()
            .args(["bench", "faults", "machines/xy", "--seeds", seeds])
            .args(["--lines", &file(name)])
            .output()
            .expect("quadrant");
        assert!(done.status.success(), "{done:?}");
    }
    fs::write(file("none"), "{}\n").expect("a file");
    for (files, words) in [
        (["one", "other"], "other:1: is of another campaign"),
        (["one", "none"], "none:1"),
    ] {
        let done = quadrant()
            .args(["bench", "merge"])
            .args(files.map(file))
            .output()
            .expect("quadrant");
        let stderr = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(words), "{stderr}");
    }
}

#[test]
fn friction_that_fell_by_a_third_is_followed_while_the_machine_runs() {
    if size::is_left_out() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("plants.csv");
    let done = quadrant()
        .args(["bench", "plants", "machines/xy", "--plants", "friction-low"])
        .args(["--ways", "shipped,tuned", "--out"])
        .arg(&file)
        .output()
        .expect("quadrant");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let table = String::from_utf8_lossy(&done.stdout);
    assert!(table.contains("friction-low"), "{table}");

    let csv = fs::read_to_string(&file).expect("plants.csv");
    let mean_um = |way: &str| {
        let rows = csv.lines().filter(|row| row.contains(way));
        let all: Vec<f64> = rows
            .map(|row| row.rsplit(',').next().expect("a column"))
            .map(|um| um.parse().expect("the machine stopped"))
            .collect();
        assert_eq!(all.len(), 12, "{csv}");
        all.iter().sum::<f64>() / 12.0
    };
    let (followed_um, tuned_um) = (mean_um("shipped"), mean_um("tuned"));
    assert!(tuned_um > 6.0, "{table}");
    assert!(followed_um < 2.4, "{table}");
}

#[test]
fn random_plants_are_those_of_their_seed_and_one_of_them_can_be_run_again() {
    if size::is_left_out() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bench = |arguments: &[&str], name: &str| {
        let file = folder.path().join(name);
        let done = quadrant()
            .args(["bench", "plants", "machines/xy", "--seed", "5"])
            .args(arguments)
            .arg("--out")
            .arg(&file)
            .output()
            .expect("quadrant");
        let stderr = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{stderr}");
        let printed = String::from_utf8_lossy(&done.stdout).into_owned();
        (printed, fs::read_to_string(&file).expect("the CSV"))
    };
    let (printed, all) = bench(&["--random", "2"], "all.csv");
    for words in [
        "2 random plants of seed 5",
        "shipped worse than the pulse by more than 0.5 µm:",
        "cross-talk",
    ] {
        assert!(printed.contains(words), "{words}: {printed}");
    }
    let (_, again) = bench(
        &["--random", "1", "--first", "1", "--jobs", "1"],
        "again.csv",
    );
    let rows: Vec<&str> = all.lines().collect();
    assert_eq!(rows.len(), 1 + 2 * 3, "{all}");
    let of_second: Vec<&str> = rows.iter().skip(4).copied().collect();
    assert_eq!(again.lines().skip(1).collect::<Vec<_>>(), of_second);
    let worst_um = |row: &str| -> f64 {
        let cells = row.split(',').rev().take(3);
        cells
            .map(|cell| cell.parse::<f64>().expect("a number"))
            .sum()
    };
    for plant in rows[1..].chunks(3) {
        let [shipped, pulse, none] = [0, 1, 2].map(|way| worst_um(plant[way]));
        assert!(shipped < none && pulse < none, "{plant:?}");
    }
}
