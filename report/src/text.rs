//! A document as text.

use super::document::{Block, Document, Fact, Outcome, Section, Table};

/// Columns that text is wrapped to.
const WIDTH: usize = 88;
/// Items of a list before it says how many more there are.
const ITEMS_MAX: usize = 40;

/// The document as text.
pub(super) fn render(document: &Document) -> String {
    let mut text = Text(String::new());
    text.line(&document.title);
    text.line(&"=".repeat(72));
    text.wrapped(&document.about, "", "");
    for Section { heading, blocks } in document.shown() {
        if !heading.is_empty() {
            text.line("");
            text.line(heading);
        }
        blocks.iter().for_each(|block| text.block(block));
    }
    text.0
}

/// A table as text.
pub(super) fn of_table(table: &Table) -> String {
    let mut text = Text(String::new());
    text.table(table);
    text.0
}

/// At most so many characters; what is cut is shown by an ellipsis.
pub(super) fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.into();
    }
    let kept: String = text.chars().take(most.saturating_sub(1)).collect();
    format!("{kept}…")
}

fn width(text: &str) -> usize {
    text.chars().count()
}

struct Text(String);

impl Text {
    fn line(&mut self, line: &str) {
        self.0.push_str(line.trim_end());
        self.0.push('\n');
    }

    /// In lines of the text's width.
    fn wrapped(&mut self, text: &str, first_indent: &str, indent: &str) {
        let mut line = String::from(first_indent);
        if width(text) + width(&line) <= WIDTH {
            return self.line(&(line + text));
        }
        let mut empty = true;
        for word in text.split_whitespace() {
            if !empty && width(&line) + 1 + width(word) > WIDTH {
                self.line(&line);
                line = indent.into();
                empty = true;
            }
            if !empty {
                line.push(' ');
            }
            line.push_str(word);
            empty = false;
        }
        self.line(&shortened(&line, WIDTH));
    }

    fn block(&mut self, block: &Block) {
        match block {
            Block::Outcome(outcome) => self.outcome(outcome),
            Block::Warning(word, rest) => {
                self.wrapped(&format!("{}: {rest}", word.to_uppercase()), "", "  ");
            }
            Block::Text(text) | Block::Note(text) => self.wrapped(text, "", "  "),
            Block::List(items) => {
                for item in items.iter().take(ITEMS_MAX) {
                    self.wrapped(item, "  ", "    ");
                }
                self.more(items.len(), ITEMS_MAX);
            }
            Block::Glance(facts) => {
                let known = || facts.iter().filter(|fact| fact.value.number.is_some());
                let longest = known().map(|fact| width(fact.label)).max().unwrap_or(0);
                for Fact { label, value, .. } in known() {
                    self.line(&format!("  {label:<longest$}  {value}"));
                }
            }
            Block::Facts(title, facts) => {
                let known = facts.iter().filter(|fact| fact.value.number.is_some());
                let known: Vec<String> = known.map(Fact::to_string).collect();
                self.wrapped(&format!("{title}: {}", known.join(", ")), "", "  ");
            }
            Block::Table(table) => self.table(table),
            Block::Plot { file, caption } => {
                self.wrapped(&format!("Picture {file}: {caption}."), "", "  ");
            }
        }
    }

    fn outcome(&mut self, outcome: &Outcome) {
        let word = outcome.word.to_uppercase();
        let mut indent = "";
        if let Some(run) = &outcome.run {
            self.line(&shortened(run, WIDTH));
            indent = "   ";
        }
        self.wrapped(&format!("{word}: {}", outcome.rest), indent, "   ");
    }

    fn table(&mut self, table: &Table) {
        if table.rows.is_empty() {
            return;
        }
        let rows = table.shown(table.rows_in_text).into_iter();
        let rows: Vec<Vec<String>> = rows
            .map(|row| {
                let cells = row.cells.iter();
                let most = table.letters_in_text;
                cells.map(|c| shortened(&c.text(), most)).collect()
            })
            .collect();
        let mut heads: Vec<Vec<String>> = Vec::new();
        let mut widths = Vec::new();
        for (index, head) in table.heads.iter().enumerate() {
            let cells = rows.iter().filter_map(|row| row.get(index));
            let words = head.title.split(' ').chain([head.unit]);
            let all = words.chain(cells.map(String::as_str));
            let widest = all.map(width).max().unwrap_or(0);
            heads.push(head_lines(&head.title, widest));
            widths.push(widest);
        }
        let height = heads.iter().map(Vec::len).max().unwrap_or(0);
        let units = || table.heads.iter().map(|head| head.unit);
        for line in 0..height {
            // The last words of all heads stand side by side.
            let word = |head: &Vec<String>| {
                let from = (line + head.len()).checked_sub(height);
                from.and_then(|line| head.get(line).cloned())
            };
            let words = heads.iter().map(|head| word(head).unwrap_or_default());
            self.cells(table, &widths, words);
        }
        if units().any(|unit| !unit.is_empty()) {
            self.cells(table, &widths, units().map(str::to_string));
        }
        for row in rows {
            self.cells(table, &widths, row.into_iter());
        }
        self.more(table.rows.len(), table.rows_in_text);
    }

    fn cells(&mut self, table: &Table, widths: &[usize], cells: impl Iterator<Item = String>) {
        let mut line = String::new();
        for ((cell, head), &width) in cells.zip(&table.heads).zip(widths) {
            line.push_str("  ");
            line += &if head.words {
                format!("{cell:<width$}")
            } else {
                format!("{cell:>width$}")
            };
        }
        self.line(&line);
    }

    fn more(&mut self, count: usize, shown: usize) {
        if count > shown {
            self.line(&format!("  … and {} more in report.json", count - shown));
        }
    }
}

/// The words of a head in lines of this width.
fn head_lines(title: &str, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in title.split(' ') {
        match lines.last_mut() {
            Some(line) if width(line) + 1 + width(word) <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::{Columns, Value};

    fn rendered(table: Table) -> String {
        render(&Document {
            sections: vec![Section {
                heading: "Heading".into(),
                blocks: vec![
                    Block::Note("Only with a table.".into()),
                    Block::Table(table),
                ],
            }],
            ..Document::default()
        })
    }

    #[test]
    fn heads_are_wrapped_to_their_columns_and_units_stand_below_them() {
        let rows = [("one", Some(1.5)), ("two", None), ("three", Some(-0.001))];
        let table = Columns::of("rows", &rows)
            .words("Name", |row| row.0.into())
            .number("Radius error", "µm", 2, |row| row.1)
            .done();
        let text = rendered(table);
        let below = text.split("Heading\nOnly with a table.\n").nth(1).unwrap();
        assert_eq!(
            below,
            "         Radius\n  \
             Name    error\n             \
             µm\n  \
             one      1.50\n  \
             two         –\n  \
             three    0.00\n"
        );
    }

    #[test]
    fn of_a_long_table_the_largest_rows_are_shown_in_their_order() {
        let table = |count: usize| {
            let numbers: Vec<f64> = (0..count).map(|n| ((n * 7) % count) as f64).collect();
            Columns::of("numbers", &numbers)
                .number("n", "", 0, |number| Some(*number))
                .largest(3)
                .done()
        };
        let text = rendered(table(10));
        assert!(text.contains("  7\n  8\n  9\n"), "{text}");
        assert!(text.ends_with("  … and 7 more in report.json\n"), "{text}");
        let empty = rendered(table(0));
        assert!(!empty.contains("Heading"), "{empty}");
    }

    #[test]
    fn a_number_that_is_not_known_is_a_dash_and_what_is_nothing_has_no_minus() {
        let value = |number, unit| {
            let decimals = 1;
            Value {
                number,
                unit,
                decimals,
            }
            .to_string()
        };
        assert_eq!(value(Some(-0.04), "µm"), "0.0 µm");
        assert_eq!(value(Some(-0.06), ""), "-0.1");
        assert_eq!(value(None, "µm"), "– µm");
    }
}
