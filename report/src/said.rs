//! What the program of a run has said, read from `messages.jsonl`.

use std::io::{BufRead, BufReader};
use std::path::Path;

use bus::files::open_to_read;
use monitor::said::{Line, MESSAGES_FILE};

/// What a program has said, as far as a report lists it.
#[derive(Debug, Clone, Default)]
pub struct Said {
    /// The first ones.
    pub lines: Vec<Line>,
    /// Those behind them.
    pub more: u64,
    /// The last one.
    pub last: Option<Line>,
    /// Those that are lost.
    pub dropped: u64,
}

impl Said {
    /// Reads the file in a run directory, up to so many lines; nothing where there is none.
    pub fn read(folder: &Path, most: usize) -> Said {
        let mut said = Said::default();
        let Ok(file) = open_to_read(&folder.join(MESSAGES_FILE)) else {
            return said;
        };
        for line in BufReader::new(file).lines().map_while(Result::ok) {
            let Ok(line) = serde_json::from_str::<Line>(&line) else {
                continue;
            };
            if let Some(dropped) = line.dropped {
                said.dropped += u64::from(dropped);
                continue;
            }
            said.last = Some(line.clone());
            if said.lines.len() < most {
                said.lines.push(line);
            } else {
                said.more += 1;
            }
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_messages_are_listed_and_the_others_are_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let line =
            |number: u32| format!("{{\"scan\":{number},\"number\":{number},\"text\":\"a\"}}\n");
        let lost = "{\"scan\":9,\"number\":3,\"dropped\":4}\n";
        let text = line(1) + &line(2) + lost + &line(8);
        std::fs::write(folder.path().join(MESSAGES_FILE), text).expect("a file");
        let said = Said::read(folder.path(), 2);
        assert_eq!((said.lines.len(), said.more, said.dropped), (2, 1, 4));
        assert_eq!(said.last.map(|last| last.number), Some(8));
    }
}
