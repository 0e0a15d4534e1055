//! What `/proc` says of a cell's processes: their ids, the pace and the program, from the launcher's children's command lines.

use std::fs;
use std::path::PathBuf;

use bus::member::Pace;

/// One child of the launcher.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Child {
    /// Process id.
    pub pid: u32,
    /// Place in the roster.
    pub place: usize,
    /// Which process in that place it is.
    pub incarnation: u32,
    /// Pace of the cell.
    pub pace: Option<Pace>,
    /// Part program, of those who hear of it.
    pub program: Option<PathBuf>,
    /// Where the recorder writes.
    pub out: Option<PathBuf>,
}

/// The roles that this launcher has started and that have not ended. Empty where `/proc` does not tell.
pub fn children_of(launcher_pid: u32) -> Vec<Child> {
    let tasks = fs::read_dir(format!("/proc/{launcher_pid}/task"));
    let mut children = Vec::new();
    for task in tasks.into_iter().flatten().flatten() {
        let list = fs::read_to_string(task.path().join("children")).unwrap_or_default();
        let pids = list.split_whitespace().filter_map(|pid| pid.parse().ok());
        children.extend(pids.filter_map(child));
    }
    children
}

fn child(pid: u32) -> Option<Child> {
    let bytes = fs::read(format!("/proc/{pid}/cmdline")).ok()?;
    let text = String::from_utf8(bytes).ok()?;
    of_command_line(pid, text.split('\0'))
}

fn of_command_line<'a>(pid: u32, words: impl Iterator<Item = &'a str> + Clone) -> Option<Child> {
    let after = |name: &str| words.clone().skip_while(|word| *word != name).nth(1);
    Some(Child {
        pid,
        place: after("--index")?.parse().ok()?,
        incarnation: after("--incarnation").map_or(Some(1), |n| n.parse().ok())?,
        pace: after("--pace").and_then(|pace| pace.parse().ok()),
        program: after("--program").map(PathBuf::from),
        out: after("--out").map(PathBuf::from),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_is_known_by_its_command_line_and_nothing_else_is() {
        let line = "quadrant recorder --out /runs/a --program /runs/a/circle.ngc --cell xy --index 3 --incarnation 2 --pace realtime";
        let expected = Child {
            pid: 7,
            place: 3,
            incarnation: 2,
            pace: Some(Pace::Realtime),
            program: Some("/runs/a/circle.ngc".into()),
            out: Some("/runs/a".into()),
        };
        assert_eq!(of_command_line(7, line.split(' ')), Some(expected));
        assert_eq!(of_command_line(7, "sleep 1".split(' ')), None);
        assert_eq!(
            of_command_line(7, "quadrant servo --index x".split(' ')),
            None
        );
    }
}
