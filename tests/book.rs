//! The pages that lead in and show how: each block of commands is run as it stands, in the order of its page, and what a page shows
//! is what was printed.
//!
//! A block without a word behind its backticks holds commands, one of `console` commands with what they print, one of `text` what
//! commands before it have printed; a line `…` stands for any lines, `…` within a line for any words. A comment `<!-- run: … -->` is
//! run too: it makes what the page takes for granted. `<!-- file: NAME -->` makes a file of the next block, `<!-- needs: PATH -->` leaves
//! the page out on a PC without that file. `RENEW=book` writes into the pages what is printed now.

use std::fs;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use clap::Parser as _;

use crate::support::{PATIENCE, root, send};

/// Pages that are run at the same time.
const SIDE_BY_SIDE: usize = 3;
const ON_A_BUS: &str = "drives on a bus: tests/ethercat";
const LIVE: &str = "needs a terminal: tests/monitor_live.rs";
const ELSEWHERE: &str = "another PC: tests/remote.rs";

/// Commands that cannot be run here: page (none: all pages), words that are in the command (none: all commands), and why.
const NOT_RUN: &[(&str, &[&str], &str)] = &[
    ("", &["cargo build", "target/release/quadrant"], "a build"),
    ("", &["--view"], LIVE),
    (
        "",
        &["quadrant tune"],
        "minutes of test motions: tests/tune.rs",
    ),
    (
        "",
        &["quadrant doctor"],
        "it looks at this PC: tests/doctor.rs",
    ),
    (
        "start/first-kill.md",
        &["quadrant status", "planner", "kill -9"],
        "beside a cell in another terminal: tests/deaths.rs",
    ),
    (
        "howto/cell.md",
        &["jog Y-", "jog Y+"],
        "goes on until Ctrl-C: tests/jog.rs",
    ),
    (
        "howto/drives.md",
        &[
            "setcap",
            "bus scan",
            "bus sdo",
            "mine",
            "status",
            "enable",
            "jog",
            "load",
            "start",
            "foreign",
            "ip link",
            "sysctl",
            "xy-ethercat",
        ],
        ON_A_BUS,
    ),
    ("howto/scope.md", &["bus.missed"], ON_A_BUS),
    ("howto/remote.md", &[""], ELSEWHERE),
    (
        "howto/web.md",
        &[""],
        "a port, and another PC: tests/web.rs",
    ),
    (
        "howto/service.md",
        &[""],
        "root, and a service manager: tests/packaging.rs",
    ),
];

/// Blocks of what is printed that no command of their page prints here: page, words of the block, and why.
const NOT_SHOWN: &[(&str, &[&str], &str)] = &[
    (
        "howto/drives.md",
        &["slaves on eth1", "takes in", "mine", "bus in operation"],
        ON_A_BUS,
    ),
    ("howto/remote.md", &[""], ELSEWHERE),
    ("howto/watch.md", &[""], LIVE),
    ("howto/set-up.md", &["▶ RUNS"], LIVE),
    ("howto/web.md", &[""], "a port: tests/web.rs"),
    (
        "howto/spindle.md",
        &["WAITS: for the spindle"],
        "moments: tests/auxiliary.rs",
    ),
    (
        "howto/tune.md",
        &["dead time, scans", "Coulomb friction"],
        "minutes of test motions: tests/tune.rs",
    ),
];

/// A part of a page.
#[derive(Debug)]
enum Step {
    /// A command, and the number of its line, from 1.
    Run(usize, String),
    /// What is shown, and the number of its first line.
    Shown(usize, Vec<String>),
}

/// What a page has done, as it was printed.
#[derive(Debug, Default)]
struct Printed {
    /// Lines.
    lines: Vec<String>,
    /// For each command the first of its lines, and its exit status.
    commands: Vec<(usize, i32)>,
}

/// Joins lines that end in a backslash.
fn logical_lines(block: &[(usize, &str)]) -> Vec<(usize, String)> {
    let mut lines: Vec<(usize, String)> = Vec::new();
    let mut goes_on = false;
    for (number, line) in block {
        let (part, more) = match line.strip_suffix('\\') {
            Some(part) => (part, true),
            None => (*line, false),
        };
        match lines.last_mut().filter(|_| goes_on) {
            Some((_, before)) => before.push_str(part),
            None => lines.push((*number, part.trim().to_string())),
        }
        goes_on = more;
    }
    lines.retain(|(_, line)| !line.is_empty());
    lines
}

/// A remark of the page behind a command, as `   (until it touches)`.
fn without_remark(command: &str) -> String {
    let end = command.find("  (").unwrap_or(command.len());
    command[..end].trim_end().to_string()
}

fn steps_of(text: &str) -> Vec<Step> {
    let lines: Vec<(usize, &str)> = text.lines().enumerate().map(|(i, l)| (i + 1, l)).collect();
    let mut steps = Vec::new();
    let (mut at, mut file) = (0, None);
    while at < lines.len() {
        let (number, line) = lines[at];
        at += 1;
        if let Some(hidden) = comment(line, "run") {
            steps.push(Step::Run(number, hidden.to_string()));
        }
        file = comment(line, "file").or(file);
        let Some(word) = line.trim_start().strip_prefix("```") else {
            continue;
        };
        let ends = |line: &&(usize, &str)| line.1.trim_start().starts_with("```");
        let length = lines[at..].iter().take_while(|line| !ends(line)).count();
        let block = &lines[at..at + length];
        at += length + 1;
        if let Some(name) = file.take() {
            let words: String = block.iter().map(|(_, line)| format!("{line}\n")).collect();
            let command = format!("cat > {name} <<'END'\n{words}END");
            steps.push(Step::Run(number, command));
        }
        match word {
            "" => {
                let commands = logical_lines(block).into_iter();
                steps.extend(commands.map(|(number, command)| Step::Run(number, command)));
            }
            "text" => {
                let shown = block.iter().map(|(_, line)| line.to_string()).collect();
                steps.push(Step::Shown(block[0].0, shown));
            }
            "console" => steps.extend(console(block)),
            _ => {}
        }
    }
    steps
}

/// What a comment of this word says.
fn comment<'a>(line: &'a str, word: &str) -> Option<&'a str> {
    let rest = line.trim().strip_prefix("<!-- ")?.strip_prefix(word)?;
    rest.strip_prefix(": ")?.strip_suffix(" -->")
}

/// Commands behind `$`, and what each has printed.
fn console(block: &[(usize, &str)]) -> Vec<Step> {
    let mut steps = Vec::new();
    for (number, line) in block {
        match (line.strip_prefix("$ "), steps.last_mut()) {
            (Some(command), _) => steps.push(Step::Run(*number, without_remark(command))),
            (None, Some(Step::Shown(_, shown))) => shown.push(line.to_string()),
            (None, _) if line.is_empty() => {}
            (None, _) => steps.push(Step::Shown(*number, vec![line.to_string()])),
        }
    }
    steps
}

/// Why something of a page is left out, if it is: the place in the list.
fn left_out(list: &[(&str, &[&str], &str)], page: &str, text: &str) -> Option<usize> {
    list.iter().position(|(of, words, _)| {
        (of.is_empty() || *of == page) && words.iter().any(|word| text.contains(word))
    })
}

/// Whether a shown line is this printed one.
fn is_like(shown: &str, printed: &str) -> bool {
    let (shown, mut rest) = (shown.trim(), printed.trim());
    let mut parts = shown.split('…');
    let first = parts.next().unwrap_or_default();
    match rest.strip_prefix(first) {
        Some(behind) => rest = behind,
        None => return false,
    }
    let parts: Vec<&str> = parts.collect();
    for (index, part) in parts.iter().enumerate() {
        if index + 1 == parts.len() && !part.is_empty() {
            return rest.ends_with(part);
        }
        match rest.find(part) {
            Some(found) => rest = &rest[found + part.len()..],
            None => return false,
        }
    }
    !parts.is_empty() || rest.is_empty()
}

/// A line without its numbers and its spaces: which line it is.
fn skeleton(line: &str) -> String {
    let kept = |c: &char| !c.is_ascii_digit() && !c.is_whitespace() && !".-+−–=".contains(*c);
    line.chars().filter(kept).collect()
}

/// For each shown line the printed one in its place, the latest that there are; none for lines that stand for any.
fn found(
    shown: &[String],
    printed: &[String],
    is_it: &dyn Fn(&str, &str) -> bool,
) -> Option<Vec<Option<usize>>> {
    let says = |line: &String| !line.trim().is_empty() && line.trim() != "…";
    let first = shown.iter().find(|line| says(line))?;
    let starts = (0..printed.len()).rev();
    starts
        .filter(|start| is_it(first, &printed[*start]))
        .find_map(|start| {
            let mut at = start;
            let place = |line: &String| {
                if !says(line) {
                    return Some(None);
                }
                let ahead = printed[at..].iter().position(|of| is_it(line, of))?;
                at += ahead + 1;
                Some(Some(at - 1))
            };
            shown.iter().map(place).collect()
        })
}

/// What is to be shown in place of these lines: for each the printed line with the same words, or, of a picture, all lines from the
/// place of the first on.
fn renewed(shown: &[String], printed: &[String]) -> Option<Vec<String>> {
    let alike = |a: &str, b: &str| is_like(a, b) || skeleton(a) == skeleton(b);
    let Some(places) = found(shown, printed, &alike) else {
        let first = found(&shown[..1], printed, &alike)?[0]?;
        return Some(printed.get(first..first + shown.len())?.to_vec());
    };
    let line = |(line, place): (&String, &Option<usize>)| match place {
        Some(place) if !is_like(line, &printed[*place]) => printed[*place].clone(),
        _ => line.clone(),
    };
    Some(shown.iter().zip(&places).map(line).collect())
}

/// What the shell of every page knows: cells have names of their own and go in lockstep; one that is to stay is up before the next
/// command; an order that is told to wait a moment is given again.
const SHELL: &str = r#"
quadrant() {
    case $1 in
    up)
        printf '\001name %s\n' "$(sed -n 's/^name = "\(.*\)".*/\1/p' "$2/machine.toml" | head -n 1)"
        command quadrant "$@" --pace lockstep --cell "$CELL" > up.txt 2>&1 &
        up=$!
        until command quadrant status --cell "$CELL" > status.txt 2>&1; do
            kill -0 "$up" || { cat up.txt; return 1; }
            sleep 0.02
        done
        cat up.txt ;;
    run) command quadrant "$@" --cell "$CELL-r" ;;
    load | start | hold | resume | stop | override | rapid-override | single-block | optional-stop | reset | jog | wheel | home | offsets | \
    tool | zero | enable | disable | mdi | estop | status | down)
        for look in $(seq 100); do
            said=$(command quadrant "$@" --cell "$CELL" 2>&1)
            ended=$?
            case $said in *"(wait a moment)"*) sleep 0.1 ;; *) break ;; esac
        done
        printf '%s\n' "$said"
        if [ "$1" = down ] && [ "$ended" = 0 ]; then wait "$up"; up=; fi
        return "$ended" ;;
    *) command quadrant "$@" ;;
    esac
}
up=
trap 'if [ -n "$up" ]; then kill "$up"; wait "$up"; fi' EXIT
"#;

/// The shell of a page; it ends with the test, with all that it has started.
struct Shell {
    child: Child,
    cell: String,
}

impl Drop for Shell {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            send(-(self.child.id() as i32), libc::SIGTERM);
            let _ = self.child.wait();
        }
        for cell in [self.cell.clone(), format!("{}-r", self.cell)] {
            let _ = Command::new(env!("CARGO_BIN_EXE_quadrant"))
                .args(["clean", &cell])
                .output();
        }
    }
}

/// Runs commands in a folder with the machines that come with the product.
fn run(commands: &[(usize, &str)], cell: &str) -> Printed {
    if commands.is_empty() {
        return Printed::default();
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    for name in ["bin", "home"] {
        fs::create_dir(path(name)).expect("a folder");
    }
    let program = env!("CARGO_BIN_EXE_quadrant");
    std::os::unix::fs::symlink(program, path("bin/quadrant")).expect("a link");
    let copied = Command::new("cp")
        .arg("-r")
        .args([root().join("machines"), path("machines")])
        .status();
    assert!(copied.is_ok_and(|status| status.success()));
    let mut script = String::from(SHELL);
    for (_, command) in commands {
        script += &format!("printf '\\001run\\n'\n{command}\nprintf '\\001ended %s\\n' \"$?\"\n");
    }
    fs::write(path("script"), script).expect("the script");
    let printed = fs::File::create(path("printed")).expect("a file");
    let search = std::env::var("PATH").unwrap_or_default();
    let child = Command::new("bash")
        .arg("script")
        .current_dir(folder.path())
        .env("HOME", path("home"))
        .env("PATH", format!("{}:{search}", path("bin").display()))
        .env("CELL", cell)
        .env("SOURCES", root())
        .env("LC_ALL", "C.UTF-8")
        .stdin(Stdio::null())
        .stderr(printed.try_clone().expect("a file"))
        .stdout(printed)
        .process_group(0)
        .spawn()
        .expect("bash");
    let mut shell = Shell {
        child,
        cell: cell.to_string(),
    };
    let since = Instant::now();
    while shell.child.try_wait().expect("bash").is_none() {
        let printed = || fs::read_to_string(path("printed")).unwrap_or_default();
        assert!(since.elapsed() < 5 * PATIENCE, "no end: {}", printed());
        std::thread::sleep(Duration::from_millis(10));
    }
    let bytes = fs::read(path("printed")).expect("what was printed");
    let printed = String::from_utf8_lossy(&bytes);
    read(
        &printed.replace(&format!("{}/", folder.path().display()), ""),
        cell,
    )
}

fn read(text: &str, cell: &str) -> Printed {
    let mut printed = Printed::default();
    let mut name = cell.to_string();
    for line in text.lines() {
        let Some(word) = line.strip_prefix('\u{1}') else {
            printed.lines.push(line.replace(cell, &name));
            continue;
        };
        if let Some(new) = word.strip_prefix("name ") {
            name = new.to_string();
        } else if let Some(status) = word.strip_prefix("ended ") {
            let status = status.parse().expect("a status");
            printed.commands.last_mut().expect("a command").1 = status;
        } else {
            printed.commands.push((printed.lines.len(), -1));
        }
    }
    printed
}

/// Runs a page; what is wrong with it, and its text with what is printed now.
fn check(page: &str, text: &str, cell: &str) -> (Vec<String>, String) {
    let needed = text.lines().find_map(|line| comment(line, "needs"));
    if let Some(missing) = needed.filter(|path| !Path::new(path).exists()) {
        println!("{page} is left out: there is no {missing}");
        return (Vec::new(), text.to_string());
    }
    let (steps, mut wrong) = (steps_of(text), Vec::new());
    let mut commands = Vec::new();
    for step in &steps {
        if let Step::Run(number, command) = step {
            match left_out(NOT_RUN, page, command) {
                None => commands.push((*number, command.as_str())),
                Some(_) => {
                    wrong.extend(unknown(command).map(|why| format!("{page}:{number}: {why}")));
                }
            }
        }
    }
    let printed = run(&commands, cell);
    let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
    // Lines that were printed up to where the page is, and those before its newest command.
    let (mut until, mut newest) = (0, 0);
    for step in &steps {
        match step {
            Step::Run(number, command) => {
                let Some(at) = commands.iter().position(|(of, _)| of == number) else {
                    continue;
                };
                let (first, status) = printed.commands.get(at).copied().unwrap_or((until, -1));
                let next = printed.commands.get(at + 1).map(|(first, _)| *first);
                (newest, until) = (first, next.unwrap_or(printed.lines.len()));
                // A refusal is shown as such.
                if (status != 0) != refusal(&steps, *number) {
                    let said = printed.lines[newest..until].join("\n    ");
                    wrong.push(format!(
                        "{page}:{number}: {command}: status {status}\n    {said}"
                    ));
                }
            }
            Step::Shown(_, shown) if left_out(NOT_SHOWN, page, &shown.join("\n")).is_some() => {}
            Step::Shown(number, shown) => {
                let so_far = &printed.lines[..until];
                if found(shown, so_far, &is_like).is_none() {
                    let said = so_far[newest..].join("\n    ");
                    wrong.push(format!("{page}:{number}: not what is printed:\n    {said}"));
                    renew(&mut lines, *number, shown, so_far);
                }
            }
        }
    }
    (wrong, lines.join("\n") + "\n")
}

/// Writes what was printed in place of what is shown from this line on, if it is known which lines that are.
fn renew(lines: &mut [String], number: usize, shown: &[String], printed: &[String]) {
    // Within a list the block is indented as a whole.
    let fence = lines[number - 2].find("```").unwrap_or(0);
    let new = renewed(shown, printed).unwrap_or_default();
    for (line, new) in lines[number - 1..].iter_mut().zip(new) {
        if line.trim() != new.trim() {
            *line = format!("{}{}", " ".repeat(fence), new.trim_end());
        }
    }
}

/// Whether what is shown behind the command of this line is a refusal.
fn refusal(steps: &[Step], number: usize) -> bool {
    let mut behind = steps.iter().skip_while(|step| match step {
        Step::Run(line, _) | Step::Shown(line, _) => *line <= number,
    });
    let refuses = |line: &String| line.trim_start().starts_with("quadrant: ");
    matches!(behind.next(), Some(Step::Shown(_, shown)) if shown.iter().any(refuses))
}

/// What the command line says against a command of the product that is not run here.
fn unknown(command: &str) -> Option<String> {
    // What is in quotes is one word; a remark and a file that takes what is printed are none.
    let parts = command.split(['#', '>']).next()?.split('"').enumerate();
    let words: Vec<&str> = parts
        .flat_map(|(index, part)| match index % 2 {
            0 => part.split_whitespace().collect(),
            _ => vec![part],
        })
        .collect();
    let known = words.first() == Some(&"quadrant") && words.get(1) != Some(&"remote");
    let wrong = quadrant::cli::Cli::try_parse_from(words.iter().filter(|_| known)).err()?;
    (known && wrong.exit_code() != 0).then(|| format!("{command}: {wrong}"))
}

/// The pages, by their names below `docs/`.
fn pages() -> Vec<(String, PathBuf)> {
    let docs = root().join("docs");
    let mut pages = Vec::new();
    for part in ["start", "howto"] {
        for entry in fs::read_dir(docs.join(part)).expect("pages").flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            pages.push((format!("{part}/{name}"), entry.path()));
        }
    }
    // Those that take longest are at the end.
    pages.sort_by(|a, b| b.cmp(a));
    pages
}

#[test]
fn every_command_of_the_first_pages_is_run_as_it_stands_and_prints_what_they_show() {
    let only = std::env::var("PAGE").unwrap_or_default();
    let renew = std::env::var("RENEW").is_ok_and(|what| what == "book");
    let pages: Vec<_> = pages()
        .into_iter()
        .filter(|(page, _)| page.contains(&only))
        .collect();
    let next = Mutex::new(pages.iter().enumerate());
    let all = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..SIDE_BY_SIDE {
            scope.spawn(|| {
                loop {
                    let turn = next.lock().expect("no panic").next();
                    let Some((index, (page, path))) = turn else {
                        return;
                    };
                    let text = fs::read_to_string(path).expect("a page");
                    let cell = format!("b{}-{index}", std::process::id());
                    let since = Instant::now();
                    let (wrong, now) = check(page, &text, &cell);
                    println!("{page}: {:.1} s", since.elapsed().as_secs_f64());
                    if renew && now != text {
                        fs::write(path, now).expect("writing the page");
                    }
                    all.lock().expect("no panic").extend(wrong);
                }
            });
        }
    });
    let all = all.into_inner().expect("no panic");
    assert!(
        all.is_empty(),
        "RENEW=book writes what is printed now.\n{}",
        all.join("\n")
    );
}

#[test]
fn all_that_is_left_out_of_the_first_pages_is_there() {
    let mut used = [vec![false; NOT_RUN.len()], vec![false; NOT_SHOWN.len()]];
    for (page, path) in pages() {
        for step in steps_of(&fs::read_to_string(path).expect("a page")) {
            let (list, place) = match step {
                Step::Run(_, command) => (0, left_out(NOT_RUN, &page, &command)),
                Step::Shown(_, shown) => (1, left_out(NOT_SHOWN, &page, &shown.join("\n"))),
            };
            if let Some(place) = place {
                used[list][place] = true;
            }
        }
    }
    for (used, list) in used.iter().zip([NOT_RUN, NOT_SHOWN]) {
        let unused = used.iter().zip(list).find(|(used, _)| !**used);
        if let Some((_, entry)) = unused {
            panic!("nothing is left out by {entry:?}");
        }
    }
}
