//! Findings on a screen of 80 columns, and as JSON.

use serde::Serialize;

use super::finding::{Finding, Grade};
use super::lateness::Lateness;
use console::output;

const COLUMNS: usize = 80;
/// Where text begins behind the name of the thing.
const INDENT: usize = 22;

/// For people: what must be changed first, then what could be better, then the rest, a line each.
pub fn text(findings: &[Finding], host: &str) -> String {
    let mut lines = vec![host.to_string()];
    for (grade, heading) in [
        (Grade::Must, "MUST BE CHANGED"),
        (Grade::Better, "COULD BE BETTER"),
        (Grade::Fine, "OK"),
    ] {
        let of: Vec<&Finding> = findings.iter().filter(|f| f.grade == grade).collect();
        if of.is_empty() {
            continue;
        }
        lines.push(String::new());
        lines.push(heading.into());
        for finding in of {
            lines.extend(wrapped(&format!("  {}", finding.what), &finding.found));
            if grade == Grade::Fine {
                continue;
            }
            lines.extend(wrapped("    why", &finding.why));
            for (index, line) in finding.change.iter().enumerate() {
                let name = if index == 0 { "    change" } else { "" };
                lines.extend(change(name, line));
            }
        }
    }
    let count = |grade| findings.iter().filter(|f| f.grade == grade).count();
    lines.push(String::new());
    lines.push(format!(
        "{} must be changed, {} could be better, {} ok.",
        count(Grade::Must),
        count(Grade::Better),
        count(Grade::Fine)
    ));
    if count(Grade::Must) + count(Grade::Better) > 0 {
        lines.push("Commands are for root.".into());
    }
    lines.join("\n")
}

/// A command is on one line whatever its length, so that it can be copied; a remark is wrapped.
fn change(name: &str, line: &str) -> Vec<String> {
    if line.starts_with('#') {
        return wrapped(name, line);
    }
    vec![format!("{name:INDENT$}{line}")]
}

/// A name and a text behind it, wrapped at spaces.
fn wrapped(name: &str, text: &str) -> Vec<String> {
    let (first, next) = (format!("{name:INDENT$}"), " ".repeat(INDENT));
    output::wrapped(COLUMNS, &first, &next, text)
}

#[derive(Serialize)]
struct Json<'a> {
    quadrant: &'static str,
    grade: Grade,
    measured: serde_json::Value,
    findings: &'a [Finding],
}

/// For scripts.
pub fn json(findings: &[Finding], measured: &Lateness) -> String {
    let worst = findings.iter().map(|finding| finding.grade).max();
    let json = Json {
        quadrant: env!("CARGO_PKG_VERSION"),
        grade: worst.unwrap_or(Grade::Fine),
        measured: serde_json::json!({
            "scan_period_us": measured.scan_period_us,
            "priority": measured.priority,
            "memory_locked": measured.memory_locked,
            "processors": measured.processors,
            "scans": measured.scans,
            "lost_scans": measured.lost_scans,
            "p50_us": measured.p50_us,
            "p99_us": measured.p99_us,
            "max_us": measured.max_us,
        }),
        findings,
    };
    serde_json::to_string_pretty(&json).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings() -> Vec<Finding> {
        let long = "a word after the other ".repeat(10);
        vec![
            Finding::fine("swap", "none"),
            Finding::better(
                "kernel",
                "no PREEMPT_RT",
                &long,
                &["reboot", "# then look again"],
            ),
            Finding::must("SCHED_FIFO", "refused", &long, &["usermod"]),
        ]
    }

    #[test]
    fn what_must_be_changed_stands_first_and_nothing_is_wider_than_the_screen() {
        let text = text(&findings(), "Linux 6, 2 processors");
        let at = |word: &str| text.find(word).unwrap_or_else(|| panic!("no {word:?}"));
        assert!(at("MUST BE CHANGED") < at("COULD BE BETTER"));
        assert!(at("COULD BE BETTER") < at("\nOK"));
        assert!(
            text.lines().all(|line| line.chars().count() <= COLUMNS),
            "{text}"
        );
        assert!(text.contains("1 must be changed, 1 could be better, 1 ok."));
    }

    #[test]
    fn a_command_is_never_broken_over_lines() {
        let command = format!("echo {}", "x ".repeat(60));
        let finding = Finding::better("kernel", "no", "because", &[command.as_str()]);
        assert!(text(&[finding], "").contains(command.trim_end()));
    }

    #[test]
    fn json_carries_the_worst_grade_and_every_finding() {
        let value: serde_json::Value =
            serde_json::from_str(&json(&findings(), &Lateness::default())).expect("JSON");
        assert_eq!(value["grade"], "must-be-changed");
        assert_eq!(value["findings"][1]["change"][0], "reboot");
        assert_eq!(value["findings"][0]["grade"], "ok");
    }
}
