//! A document as a page that stands alone: no script, nothing from elsewhere, plots inline, every text escaped.

use std::fmt::Write as _;
use std::path::Path;

use super::document::{Block, Cell, Document, Outcome, Row, Section, Table};
use super::error::ReportError;
use console::output::joined;

const STYLE: &str = include_str!("html.css");

/// Rows of a table that are shown without being asked for.
const ROWS_OPEN: usize = 24;
/// Rows of a table and items of a list; what is beyond them is in report.json.
const ROWS_MAX: usize = 400;

/// The document as a page; its plots are read from the folder, where they were drawn just now.
pub(super) fn render(document: &Document, folder: &Path) -> Result<String, ReportError> {
    let (title, about) = (escape(&document.title), escape(&document.about));
    let mut body = format!("<h1>{title}</h1>\n<p class=\"soft\">{about}</p>\n");
    for Section { heading, blocks } in document.shown() {
        if !heading.is_empty() {
            put(&mut body, format_args!("<h2>{}</h2>", escape(heading)));
        }
        for block in blocks {
            add(block, folder, &mut body)?;
        }
    }
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    ))
}

/// Text as it is in a page or between the quotes of an attribute.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            letter if letter.is_control() && letter != '\n' => escaped.push('\u{fffd}'),
            letter => escaped.push(letter),
        }
    }
    escaped
}

fn put(body: &mut String, markup: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = body.write_fmt(markup);
    body.push('\n');
}

fn add(block: &Block, folder: &Path, body: &mut String) -> Result<(), ReportError> {
    match block {
        Block::Outcome(outcome) => add_outcome(outcome, body),
        Block::Warning(word, rest) => {
            let (word, rest) = (escape(word), escape(rest));
            put(body, format_args!("<p><b>{word}</b>: {rest}</p>"));
        }
        Block::Text(text) => put(body, format_args!("<p>{}</p>", escape(text))),
        Block::Note(note) => {
            put(body, format_args!("<p class=\"note\">{}</p>", escape(note)));
        }
        Block::List(items) => {
            let shown = items.iter().take(ROWS_MAX);
            let shown: String = shown
                .map(|item| format!("<li>{}</li>\n", escape(item)))
                .collect();
            if !shown.is_empty() {
                put(body, format_args!("<ul>\n{shown}</ul>"));
            }
            more(items.len(), body);
        }
        Block::Glance(facts) => {
            let known = facts.iter().filter(|fact| fact.value.number.is_some());
            let items = known.map(|fact| {
                let value = escape(&fact.value.to_string());
                format!(
                    "<div><dt>{}</dt><dd>{value}</dd></div>\n",
                    escape(fact.label)
                )
            });
            let items: String = items.collect();
            put(body, format_args!("<dl class=\"numbers\">\n{items}</dl>"));
        }
        Block::Facts(title, facts) => {
            let known = facts.iter().filter(|fact| fact.value.number.is_some());
            let known = joined(known.map(|fact| escape(&fact.to_string())), ", ");
            let title = escape(title);
            put(body, format_args!("<p>{title}: {known}</p>"));
        }
        Block::Table(table) => add_table(table, body),
        Block::Plot { file, caption } => add_plot(&folder.join(file), &escape(caption), body)?,
    }
    Ok(())
}

fn add_outcome(outcome: &Outcome, body: &mut String) {
    let class = if outcome.good {
        "outcome"
    } else {
        "outcome bad"
    };
    let run = outcome
        .run
        .as_deref()
        .map_or(String::new(), |run| format!("{}<br>", escape(run)));
    let (word, rest) = (outcome.word, escape(&outcome.rest));
    put(
        body,
        format_args!("<p class=\"{class}\">{run}<b>{word}.</b> {rest}</p>"),
    );
}

/// A short table, or the largest rows of a long one; all rows of a long one are folded away below a line that opens them.
fn add_table(table: &Table, body: &mut String) {
    let count = table.rows.len();
    if count == 0 {
        return;
    }
    if count <= ROWS_OPEN || table.largest.is_some() {
        add_rows(table, table.shown(ROWS_OPEN), body);
    }
    if count > ROWS_OPEN {
        let shown = count.min(ROWS_MAX);
        let all = if shown == count { "All" } else { "The first" };
        let summary = escape(&format!("{all} {shown} {}", table.of));
        put(body, format_args!("<details><summary>{summary}</summary>"));
        add_rows(table, table.shown(ROWS_MAX), body);
        more(count, body);
        put(body, format_args!("</details>"));
    }
}

fn add_rows(table: &Table, rows: Vec<&Row>, body: &mut String) {
    let heads = table.heads.iter().map(|head| {
        let text = escape(format!("{} {}", head.title, head.unit).trim_end());
        let class = if head.words { " class=\"t\"" } else { "" };
        format!("<th{class}>{text}</th>")
    });
    let heads: String = heads.collect();
    let rows = rows.into_iter().map(|row| {
        let cells: String = row.cells.iter().map(cell).collect();
        format!("<tr>{cells}</tr>\n")
    });
    let rows: String = rows.collect();
    put(
        body,
        format_args!(
            "<div class=\"wide\"><table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>"
        ),
    );
}

/// Words longer than this may take more than one line.
const LONG: usize = 40;

fn cell(cell: &Cell) -> String {
    let text = escape(&cell.text());
    match cell {
        Cell::Words(words) if words.len() > LONG => format!("<td class=\"t long\">{text}</td>"),
        Cell::Words(_) => format!("<td class=\"t\">{text}</td>"),
        Cell::Number(..) | Cell::Written(_) => format!("<td>{text}</td>"),
    }
}

fn add_plot(file: &Path, caption: &str, body: &mut String) -> Result<(), ReportError> {
    let svg = std::fs::read_to_string(file).map_err(|source| ReportError::Read {
        path: file.into(),
        source,
    })?;
    // The SVGs are this crate's own; their texts were escaped when they were drawn.
    let labelled = format!("<svg role=\"img\" aria-label=\"{caption}\" ");
    let svg = svg.replacen("<svg ", &labelled, 1);
    put(
        body,
        format_args!("<figure>\n{svg}\n<figcaption>{caption}</figcaption></figure>"),
    );
    Ok(())
}

fn more(count: usize, body: &mut String) {
    if count > ROWS_MAX {
        let more = count - ROWS_MAX;
        put(
            body,
            format_args!("<p class=\"note\">… and {more} more in report.json</p>"),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::{Columns, Fact};

    #[test]
    fn nothing_that_comes_from_outside_becomes_markup() {
        let evil = "<script>alert('1')</script>\"&\u{7}";
        let outcome = |run: Option<&str>| {
            Block::Outcome(Outcome {
                run: run.map(str::to_string),
                good: false,
                word: "Stopped",
                rest: evil.into(),
            })
        };
        let table = Columns::of(evil, &[(); 25])
            .words(evil, |()| evil.into())
            .written("<script>", "", |()| evil.into())
            .number("x", evil, 0, |()| None)
            .done();
        let fact = || vec![Fact::new(evil, 1.0, evil, 1)];
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("plot.svg"), "<svg >").unwrap();
        let document = Document {
            title: evil.into(),
            about: evil.into(),
            sections: vec![Section {
                heading: evil.into(),
                blocks: vec![
                    outcome(None),
                    outcome(Some(evil)),
                    Block::Warning(evil.into(), evil.into()),
                    Block::Text(evil.into()),
                    Block::Note(evil.into()),
                    Block::List(vec![evil.into()]),
                    Block::Glance(fact()),
                    Block::Facts(evil, fact()),
                    Block::Table(table),
                    Block::Plot {
                        file: "plot.svg".into(),
                        caption: evil.into(),
                    },
                ],
            }],
        };
        let text = render(&document, folder.path()).unwrap();
        assert!(
            !text.contains("<script") && !text.contains('\u{7}'),
            "{text}"
        );
        let escaped = "&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&quot;&amp;\u{fffd}";
        // Title, headline and line below; heading; outcomes 3; warning 2; text, note, item; facts 2 and 3; the table's summary,
        // two heads and two cells in each row; plot 2.
        assert_eq!(
            text.matches(escaped).count(),
            3 + 1 + 3 + 2 + 3 + 5 + 1 + 2 + 2 * 25 + 2
        );
    }
}
