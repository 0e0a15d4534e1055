//! The counts that are kept in the repository.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, anyhow};
use toml_edit::DocumentMut;

use super::Cost;
use crate::options::Part;

/// What stands in the file.
const HEAD: &str = "\
# Instructions of the parts of a scan, of a release build with the toolchain of rust-toolchain.toml, on x86-64.
# Written by `quadrant-lab bench scan --renew`; `quadrant-lab bench scan --check` fails where one is off by more than 2 %.
";

/// Counts of a machine.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Kept {
    pub machine: String,
    counts: Vec<(Part, f64)>,
}

impl Kept {
    pub fn of(machine: &str, costs: &[Cost]) -> Kept {
        let counts = costs.iter();
        let counts = counts.filter_map(|cost| Some((cost.part, cost.instructions?.round())));
        Kept {
            machine: machine.into(),
            counts: counts.collect(),
        }
    }

    /// The count of a part.
    pub fn of_part(&self, part: Part) -> Option<f64> {
        let mut counts = self.counts.iter();
        counts.find(|(of, _)| *of == part).map(|(_, count)| *count)
    }

    fn text(&self) -> String {
        let mut text = format!("{HEAD}machine = \"{}\"\n", self.machine);
        for (part, count) in &self.counts {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{} = {count}", part.word());
        }
        text
    }

    fn parse(text: &str) -> anyhow::Result<Kept> {
        let file: DocumentMut = text.parse()?;
        let machine = file.get("machine").and_then(|item| item.as_str());
        let mut kept = Kept {
            machine: machine.context("no machine")?.into(),
            counts: Vec::new(),
        };
        for part in Part::ALL {
            let count = file.get(part.word()).and_then(|item| item.as_integer());
            let count = count.filter(|count| *count > 0);
            let count = count.ok_or_else(|| anyhow!("{}: no count above 0", part.word()))?;
            kept.counts.push((part, count as f64));
        }
        Ok(kept)
    }

    /// Reads the file.
    ///
    /// # Errors
    /// It is not there, or is not such a file.
    pub fn read(file: &Path) -> anyhow::Result<Kept> {
        let text = fs::read_to_string(file).with_context(|| file.display().to_string())?;
        Kept::parse(&text).with_context(|| file.display().to_string())
    }

    /// Writes it.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, file: &Path) -> anyhow::Result<()> {
        fs::write(file, self.text()).with_context(|| file.display().to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_read_again() {
        let costs = Part::ALL.map(|part| Cost {
            part,
            time_us: 1.0,
            instructions: Some(1000.4),
        });
        let kept = Kept::of("xy", &costs);
        assert_eq!(Kept::parse(&kept.text()).expect("a file"), kept);
        assert_eq!(kept.of_part(Part::Physics), Some(1000.0));
        let without = kept.text().replace("physics", "metaphysics");
        let refused = Kept::parse(&without).expect_err("a part is missing");
        assert_eq!(refused.to_string(), "physics: no count above 0");
    }

    #[test]
    fn the_file_of_the_repository_is_one() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scan-instructions.toml");
        assert_eq!(Kept::read(&file).expect("counts").machine, "xy");
    }
}
