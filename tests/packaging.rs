//! What is installed beside the command: completions, manual pages, systemd units, alert rules.

use std::fs;
use std::os::unix::net::UnixDatagram;
use std::process::Command;
use std::time::Duration;

use crate::support::{Bench, LiveCell, quadrant, root, unique_cell};
use crate::tools::{output, says, tool};

#[test]
fn bash_completes_a_command_an_option_and_the_values_of_an_option() {
    let Some(bash) = tool("bash") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("quadrant.bash");
    fs::write(&script, says(quadrant().args(["completions", "bash"]))).expect("the script");
    output(Command::new(&bash).arg("-n").arg(&script));
    let complete = |words: &[&str]| -> Vec<String> {
        let ask = format!(
            "source {}; COMP_WORDS=(quadrant {}); COMP_CWORD={}; _quadrant quadrant '{}' '{}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
            script.display(),
            words.join(" "),
            words.len(),
            words.last().unwrap_or(&""),
            words.iter().rev().nth(1).unwrap_or(&"quadrant"),
        );
        let printed = says(Command::new(&bash).args(["--norc", "-c", &ask]));
        printed.lines().map(str::to_string).collect()
    };
    assert_eq!(complete(&["ho"]), ["hold", "home"]);
    assert_eq!(complete(&["run", "--met"]), ["--metrics"]);
    assert_eq!(complete(&["run", "--pace", "lo"]), ["lockstep"]);
}

#[test]
fn zsh_and_fish_can_read_their_completions() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for shell in ["zsh", "fish"] {
        let script = folder.path().join(shell);
        fs::write(&script, says(quadrant().args(["completions", shell]))).expect("the script");
        if let Some(program) = tool(shell) {
            output(Command::new(program).arg("-n").arg(&script));
        }
    }
    if let Some(fish) = tool("fish") {
        let ask = format!(
            "source {}; complete --do-complete 'quadrant ho'",
            folder.path().join("fish").display()
        );
        let home = folder.path();
        let printed = says(
            Command::new(fish)
                .env("HOME", home)
                .args(["--no-config", "-c", &ask]),
        );
        assert!(printed.starts_with("hold\t"), "{printed}");
    }
}

#[test]
fn every_command_that_can_be_called_has_a_manual_page_without_warnings() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    output(quadrant().arg("man").arg("--out").arg(folder.path()));
    let help = says(quadrant().arg("--help"));
    let (_, commands) = help.split_once("Commands:").expect("commands");
    let (commands, _) = commands.split_once("Options:").expect("options");
    let names: Vec<&str> = commands
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .collect();
    assert!(names.contains(&"hold") && names.len() > 15, "{names:?}");
    for name in &names {
        let page = folder.path().join(format!("quadrant-{name}.1"));
        let text = fs::read_to_string(&page).unwrap_or_else(|e| panic!("{}: {e}", page.display()));
        assert!(text.contains(".SH SYNOPSIS"), "{name}: {text}");
    }
    assert!(!folder.path().join("quadrant-bench-pong.1").exists());
    let mut pages: Vec<_> = fs::read_dir(folder.path())
        .expect("pages")
        .flatten()
        .collect();
    pages.sort_by_key(|page| page.file_name());
    for page in pages {
        if let Some(mandoc) = tool("mandoc") {
            let mut lint = Command::new(mandoc);
            let lint = lint.args(["-T", "lint", "-W", "warning"]).arg(page.path());
            let printed = lint.output().expect("mandoc");
            let printed = String::from_utf8_lossy(&printed.stdout).into_owned();
            // Pages are made from the command, which has no date.
            let wrong: Vec<&str> = printed
                .lines()
                .filter(|line| !line.contains(" date, "))
                .collect();
            assert!(wrong.is_empty(), "{wrong:#?}");
        }
        if let Some(groff) = tool("groff") {
            let printed = output(
                Command::new(groff)
                    .args(["-K", "utf8", "-man", "-ww", "-z", "-Tutf8"])
                    .arg(page.path()),
            );
            assert_eq!(
                String::from_utf8_lossy(&printed.stderr),
                "",
                "{}",
                page.path().display()
            );
        }
    }
}

#[test]
fn systemd_finds_nothing_wrong_with_the_units() {
    let Some(analyze) = tool("systemd-analyze") else {
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let units = root().join("packaging/systemd");
    let verify = |unit: &str| {
        let mut verify = Command::new(&analyze);
        let verify = verify
            .args(["verify", "--man=no"])
            .arg(folder.path().join(unit));
        let printed = verify.output().expect("systemd-analyze");
        let words = String::from_utf8_lossy(&printed.stderr).into_owned();
        // Only what is reported of our own units: others of this PC are not our affair.
        let ours: Vec<String> = words
            .lines()
            .filter(|line| line.contains("quadrant"))
            .map(str::to_string)
            .collect();
        (printed.status.success(), ours)
    };
    fs::copy(
        units.join("quadrant.slice"),
        folder.path().join("quadrant.slice"),
    )
    .expect("a unit");
    let text = fs::read_to_string(units.join("quadrant@.service")).expect("a unit");
    assert!(text.contains("ExecStart=/usr/bin/quadrant up "), "{text}");
    // The command must be there to be found.
    let text = text.replace("/usr/bin/quadrant", env!("CARGO_BIN_EXE_quadrant"));
    fs::write(folder.path().join("quadrant@.service"), &text).expect("a unit");
    assert_eq!(verify("quadrant@.service"), (true, Vec::new()));
    let wrong = text.replace("KillMode=mixed", "KillMode=gentle");
    fs::write(folder.path().join("quadrant@.service"), wrong).expect("a unit");
    let (_, complaints) = verify("quadrant@.service");
    assert_eq!(complaints.len(), 1, "{complaints:?}");
}

#[test]
fn the_alert_rules_name_metrics_that_exist_and_prometheus_takes_them() {
    let rules = root().join("packaging/prometheus/quadrant.rules.yml");
    let text = fs::read_to_string(&rules).expect("the rules");
    let documented =
        fs::read_to_string(root().join("docs/howto/metrics.md")).expect("docs/howto/metrics.md");
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let names = text.lines().filter(|line| line.contains("expr:"));
    let names: Vec<&str> = names
        .flat_map(|line| line.split(|c| !is_word(c)))
        .filter(|word| word.starts_with("quadrant_"))
        .collect();
    assert!(names.len() >= 8, "{names:?}");
    for name in names {
        let name = name.strip_suffix("_bucket").unwrap_or(name);
        assert!(
            documented.contains(&format!("`{name}`")),
            "{name} is not documented"
        );
    }
    if let Some(promtool) = tool("promtool") {
        output(Command::new(promtool).args(["check", "rules"]).arg(rules));
    }
}

#[test]
fn a_service_manager_is_reported_when_the_cell_is_up_and_when_it_is_being_stopped() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let socket = folder.path().join("notify");
    let manager = UnixDatagram::bind(&socket).expect("a socket");
    manager
        .set_read_timeout(Some(Duration::from_secs(60)))
        .expect("a limit");
    let hear = || {
        let mut buffer = [0; 1024];
        let length = manager.recv(&mut buffer).expect("a word");
        String::from_utf8_lossy(&buffer[..length]).into_owned()
    };
    let bench = Bench::patient("xy", &[]);
    let name = unique_cell();
    let cell = LiveCell::up_told(&name, bench.path(), &socket, &["--metrics=0"]);
    assert_eq!(hear(), "READY=1\n");
    assert_eq!(hear(), format!("STATUS=cell {name} is up\n"));
    cell.signal_launcher(libc::SIGTERM);
    assert_eq!(hear(), "STOPPING=1\n");
    assert_eq!(cell.finish().status(), 130);
}

/// The book's pages of the commands are those that the command line makes.
#[test]
fn the_book_has_the_help_of_every_command_as_it_is() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    output(
        quadrant()
            .args(["man", "--markdown", "--out"])
            .arg(folder.path()),
    );
    let pages = |folder: &std::path::Path| -> std::collections::BTreeMap<_, _> {
        let entries = fs::read_dir(folder).expect("pages").flatten();
        let read = |path: std::path::PathBuf| fs::read_to_string(path).expect("a page");
        entries.map(|e| (e.file_name(), read(e.path()))).collect()
    };
    let (made, committed) = (
        pages(folder.path()),
        pages(&root().join("docs/reference/commands")),
    );
    assert_eq!(
        made, committed,
        "run `quadrant man --markdown --out docs/reference/commands`"
    );
}
