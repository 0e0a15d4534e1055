//! Pieces of a web page that stands alone: no script, nothing from elsewhere, plots inline, every text escaped.

use std::fmt::Write as _;
use std::path::Path;

use super::ReportError;

const STYLE: &str = include_str!("html.css");

/// Text as it stands in a page or between the quotes of an attribute.
pub(super) fn escape(text: &str) -> String {
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

/// A page that is being written. What is named `text` is escaped here; nothing else comes from outside.
pub(super) struct Page {
    title: String,
    body: String,
}

/// What a cell of a table holds.
pub(super) enum Cell {
    /// Words, to the left.
    Text(String),
    /// Words that may take more than one line.
    Long(String),
    /// A number, to the right; a dash where there is none.
    Number(Option<f64>, usize),
    /// A whole number.
    Count(u64),
    /// A number that is already text, to the right.
    Right(String),
}

impl Page {
    pub(super) fn new(title: &str) -> Page {
        Page {
            title: escape(title),
            body: String::new(),
        }
    }

    fn add(&mut self, markup: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.body.write_fmt(markup);
        self.body.push('\n');
    }

    /// Headline of the page, and a line below it.
    pub(super) fn headline(&mut self, text: &str, below: &str) {
        let (text, below) = (escape(text), escape(below));
        self.add(format_args!(
            "<h1>{text}</h1>\n<p class=\"soft\">{below}</p>"
        ));
    }

    /// The sentence that matters most: a word and what follows it.
    pub(super) fn outcome(&mut self, good: bool, word: &str, rest: &str) {
        let class = if good { "outcome" } else { "outcome bad" };
        let (word, rest) = (escape(word), escape(rest));
        self.add(format_args!(
            "<p class=\"{class}\"><b>{word}</b> {rest}</p>"
        ));
    }

    pub(super) fn heading(&mut self, text: &str) {
        let text = escape(text);
        self.add(format_args!("<h2>{text}</h2>"));
    }

    pub(super) fn paragraph(&mut self, text: &str) {
        let text = escape(text);
        self.add(format_args!("<p>{text}</p>"));
    }

    pub(super) fn note(&mut self, text: &str) {
        let text = escape(text);
        self.add(format_args!("<p class=\"note\">{text}</p>"));
    }

    /// Lines one below the other; nothing if there are none.
    pub(super) fn list(&mut self, texts: &[String]) {
        if texts.is_empty() {
            return;
        }
        let items = texts
            .iter()
            .map(|text| format!("<li>{}</li>\n", escape(text)));
        let items: String = items.collect();
        self.add(format_args!("<ul>\n{items}</ul>"));
    }

    /// Numbers to be seen at a glance: what, and how much.
    pub(super) fn numbers(&mut self, numbers: &[(&str, String)]) {
        let items = numbers.iter().map(|(what, value)| {
            let (what, value) = (escape(what), escape(value));
            format!("<div><dt>{what}</dt><dd>{value}</dd></div>\n")
        });
        let items: String = items.collect();
        self.add(format_args!("<dl class=\"numbers\">\n{items}</dl>"));
    }

    /// A table; a head that begins with `<` is one of words, to the left.
    pub(super) fn table(&mut self, heads: &[&str], rows: Vec<Vec<Cell>>) {
        let heads: String = heads
            .iter()
            .map(|head| match head.strip_prefix('<') {
                Some(text) => format!("<th class=\"t\">{}</th>", escape(text)),
                None => format!("<th>{}</th>", escape(head)),
            })
            .collect();
        let rows: String = rows
            .into_iter()
            .map(|row| {
                let cells: String = row.into_iter().map(cell).collect();
                format!("<tr>{cells}</tr>\n")
            })
            .collect();
        self.add(format_args!(
            "<div class=\"wide\"><table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>"
        ));
    }

    /// What `fill` writes, folded away below a line that opens it.
    pub(super) fn folded(&mut self, summary: &str, fill: impl FnOnce(&mut Page)) {
        let summary = escape(summary);
        self.add(format_args!("<details><summary>{summary}</summary>"));
        fill(self);
        self.add(format_args!("</details>"));
    }

    /// A plot that was written to a file just now, inline.
    pub(super) fn plot(&mut self, file: &Path, what: &str) -> Result<(), ReportError> {
        let svg = std::fs::read_to_string(file).map_err(|source| ReportError::Plot {
            path: file.into(),
            what: source.to_string(),
        })?;
        // The SVGs are this crate's own; their texts were escaped when they were drawn.
        let svg = svg.replacen(
            "<svg ",
            &format!("<svg role=\"img\" aria-label=\"{}\" ", escape(what)),
            1,
        );
        let what = escape(what);
        self.add(format_args!(
            "<figure>\n{svg}\n<figcaption>{what}</figcaption></figure>"
        ));
        Ok(())
    }

    /// The whole page.
    pub(super) fn finish(self) -> String {
        let Page { title, body } = self;
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
        )
    }
}

fn cell(cell: Cell) -> String {
    match cell {
        Cell::Text(text) => format!("<td class=\"t\">{}</td>", escape(&text)),
        Cell::Long(text) => format!("<td class=\"t long\">{}</td>", escape(&text)),
        Cell::Number(Some(value), digits) => format!("<td>{value:.digits$}</td>"),
        Cell::Number(None, _) => "<td>–</td>".into(),
        Cell::Count(value) => format!("<td>{value}</td>"),
        Cell::Right(text) => format!("<td>{}</td>", escape(&text)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_comes_from_outside_becomes_markup() {
        let evil = "<script>alert('1')</script>\"&\u{7}";
        let mut page = Page::new(evil);
        page.headline(evil, evil);
        page.outcome(false, evil, evil);
        page.heading(evil);
        page.paragraph(evil);
        page.note(evil);
        page.list(&[evil.into()]);
        page.numbers(&[(evil, evil.into())]);
        let row = vec![
            Cell::Text(evil.into()),
            Cell::Long(evil.into()),
            Cell::Right(evil.into()),
        ];
        page.table(&[evil, "<script>", "x"], vec![row]);
        page.folded(evil, |_| {});
        let text = page.finish();
        assert!(
            !text.contains("<script") && !text.contains('\u{7}'),
            "{text}"
        );
        let escaped = "&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&quot;&amp;\u{fffd}";
        assert_eq!(text.matches(escaped).count(), 15);
    }
}
