//! A report as a document: sections of facts, tables, notes and plots, each number with its unit and its decimals.
//!
//! It is built once from the typed report ([`super::contents`]). The text ([`super::text`]), the page ([`super::html`]) and the
//! comparison of two runs ([`super::side_by_side`]) are made of it.

use std::fmt;

use serde_json::Value as Json;

/// The whole of it.
#[derive(Debug, Default)]
pub(super) struct Document {
    pub title: String,
    /// One line below the title.
    pub about: String,
    pub sections: Vec<Section>,
}

/// What stands under one heading; the first section of a document has none.
#[derive(Debug, Default)]
pub(super) struct Section {
    pub heading: String,
    pub blocks: Vec<Block>,
}

/// A section of these.
pub(super) fn section(heading: impl Into<String>, blocks: Vec<Block>) -> Section {
    Section {
        heading: heading.into(),
        blocks,
    }
}

/// A piece of a section.
#[derive(Debug)]
pub(super) enum Block {
    Outcome(Outcome),
    /// What must be known before any number is believed: the words that matter, and the rest.
    Warning(String, String),
    Text(String),
    Note(String),
    List(Vec<String>),
    /// Numbers to be seen at a glance.
    Glance(Vec<Fact>),
    /// Numbers in one line, behind a title.
    Facts(&'static str, Vec<Fact>),
    Table(Table),
    Plot {
        /// Name of the file, beside that of the document.
        file: String,
        caption: String,
    },
}

/// How a run ended.
#[derive(Debug)]
pub(super) struct Outcome {
    /// Which run, where there are two.
    pub run: Option<String>,
    pub good: bool,
    pub word: &'static str,
    pub rest: String,
}

/// A number with its unit; none where it is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Value {
    pub number: Option<f64>,
    pub unit: &'static str,
    pub decimals: usize,
}

/// As it is in a table whose head names the unit; a dash where it is not known.
pub(super) fn digits(number: Option<f64>, decimals: usize) -> String {
    let Some(number) = number.filter(|number| !number.is_nan()) else {
        return "–".into();
    };
    let digits = format!("{number:.decimals$}");
    match digits.strip_prefix('-') {
        // No minus before what is nothing.
        Some(zero) if zero.parse() == Ok(0.0) => zero.into(),
        _ => digits,
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&digits(self.number, self.decimals))?;
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        Ok(())
    }
}

/// A number with its name.
#[derive(Debug)]
pub(super) struct Fact {
    pub label: &'static str,
    pub value: Value,
    /// Path of its key in the report.json of a comparison; empty if it is not compared.
    pub key: &'static str,
}

impl Fact {
    pub fn new(
        label: &'static str,
        number: impl Into<Option<f64>>,
        unit: &'static str,
        decimals: usize,
    ) -> Fact {
        let value = Value {
            number: number.into(),
            unit,
            decimals,
        };
        let key = "";
        Fact { label, value, key }
    }

    pub fn um(label: &'static str, number: impl Into<Option<f64>>) -> Fact {
        Fact::new(label, number, "µm", 2)
    }

    pub fn count(label: &'static str, count: impl Into<u64>) -> Fact {
        Fact::new(label, count.into() as f64, "", 0)
    }

    pub fn key(mut self, key: &'static str) -> Fact {
        self.key = key;
        self
    }
}

impl fmt::Display for Fact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let space = if self.label.is_empty() { "" } else { " " };
        write!(f, "{}{space}{}", self.label, self.value)
    }
}

/// Rows of a table that the text shows if nothing else is asked for.
const ROWS_IN_TEXT: usize = 40;
/// The most letters of one cell, likewise.
const LETTERS_IN_TEXT: usize = 42;

/// Rows of cells below heads.
#[derive(Debug)]
pub(super) struct Table {
    /// Key of its rows in the report.json of a comparison.
    pub key: &'static str,
    /// What its rows are.
    pub of: &'static str,
    pub heads: Vec<Head>,
    pub rows: Vec<Row>,
    /// If not all rows are shown: those with the largest number in this column, else the first.
    pub largest: Option<usize>,
    pub rows_in_text: usize,
    /// The most letters of one cell in the text.
    pub letters_in_text: usize,
}

/// The head of a column.
#[derive(Debug)]
pub(super) struct Head {
    pub title: String,
    pub unit: &'static str,
    /// Whether it has words, which stand to the left.
    pub words: bool,
    /// Path of its key in the report.json of a comparison, below that of its row; empty if it is not compared.
    pub key: &'static str,
}

/// One row.
#[derive(Debug, Default)]
pub(super) struct Row {
    /// Its name, which it shares with its counterpart in another run.
    pub label: String,
    /// What it is, in the report.json of a comparison.
    pub id: Vec<(&'static str, Json)>,
    pub cells: Vec<Cell>,
}

/// What a cell holds.
#[derive(Debug, Clone)]
pub(super) enum Cell {
    Words(String),
    /// The number and its decimals; the unit is that of the head.
    Number(Option<f64>, usize),
    /// A number that is already written.
    Written(String),
}

impl Cell {
    pub fn text(&self) -> String {
        match self {
            Cell::Words(text) | Cell::Written(text) => text.clone(),
            Cell::Number(number, decimals) => digits(*number, *decimals),
        }
    }

    pub fn number(&self) -> Option<f64> {
        match self {
            Cell::Number(number, _) => *number,
            _ => None,
        }
    }

    pub fn decimals(&self) -> usize {
        match self {
            Cell::Number(_, decimals) => *decimals,
            _ => 0,
        }
    }
}

/// A table of which each row is of one `T`, being made column by column.
pub(super) struct Columns<'t, T> {
    all: Vec<&'t T>,
    table: Table,
}

impl<'t, T> Columns<'t, T> {
    /// `of` says what the rows are.
    pub fn of(of: &'static str, all: impl IntoIterator<Item = &'t T>) -> Self {
        let all: Vec<&T> = all.into_iter().collect();
        let table = Table {
            key: "",
            of,
            heads: Vec::new(),
            rows: all.iter().map(|_| Row::default()).collect(),
            largest: None,
            rows_in_text: ROWS_IN_TEXT,
            letters_in_text: LETTERS_IN_TEXT,
        };
        Columns { all, table }
    }

    fn add(
        mut self,
        title: impl Into<String>,
        unit: &'static str,
        words: bool,
        cell: impl Fn(&T) -> Cell,
    ) -> Self {
        self.table.heads.push(Head {
            title: title.into(),
            unit,
            words,
            key: "",
        });
        for (row, one) in self.table.rows.iter_mut().zip(&self.all) {
            row.cells.push(cell(one));
        }
        self
    }

    pub fn words(self, title: impl Into<String>, of: impl Fn(&T) -> String) -> Self {
        self.add(title, "", true, |one| Cell::Words(of(one)))
    }

    pub fn number(
        self,
        title: impl Into<String>,
        unit: &'static str,
        decimals: usize,
        of: impl Fn(&T) -> Option<f64>,
    ) -> Self {
        self.add(title, unit, false, |one| Cell::Number(of(one), decimals))
    }

    pub fn count(self, title: &str, of: impl Fn(&T) -> u64) -> Self {
        self.number(title, "", 0, |one| Some(of(one) as f64))
    }

    pub fn written(self, title: &str, unit: &'static str, of: impl Fn(&T) -> String) -> Self {
        self.add(title, unit, false, |one| Cell::Written(of(one)))
    }

    /// The last column is compared.
    pub fn key(mut self, key: &'static str) -> Self {
        if let Some(head) = self.table.heads.last_mut() {
            head.key = key;
        }
        self
    }

    /// The rows' names, and what they are in the report.json of a comparison, in their order.
    pub fn named(
        mut self,
        key: &'static str,
        name: impl Fn(usize, &T) -> (String, Vec<(&'static str, Json)>),
    ) -> Self {
        self.table.key = key;
        let rows = self.table.rows.iter_mut().zip(&self.all);
        for (index, (row, one)) in rows.enumerate() {
            (row.label, row.id) = name(index, one);
        }
        self
    }

    /// Of a long table the rows with the largest number in the last column are shown, so many in the text.
    pub fn largest(mut self, rows_in_text: usize) -> Self {
        self.table.largest = self.table.heads.len().checked_sub(1);
        self.table.rows_in_text = rows_in_text;
        self
    }

    /// The table.
    pub fn done(self) -> Table {
        self.table
    }
}

impl Table {
    /// At most so many rows, in their order.
    pub fn shown(&self, most: usize) -> Vec<&Row> {
        let mut rows: Vec<(usize, &Row)> = self.rows.iter().enumerate().collect();
        if let Some(column) = self.largest {
            let number = |row: &Row| row.cells.get(column).and_then(Cell::number).unwrap_or(0.0);
            rows.sort_by(|(_, a), (_, b)| number(b).total_cmp(&number(a)));
        }
        rows.truncate(most);
        rows.sort_by_key(|(index, _)| *index);
        rows.into_iter().map(|(_, row)| row).collect()
    }
}

impl Block {
    /// Whether there is something to show that is not only about other blocks.
    fn tells(&self) -> bool {
        match self {
            Block::Note(_) | Block::Plot { .. } => false,
            Block::List(items) => !items.is_empty(),
            Block::Table(table) => !table.rows.is_empty(),
            _ => true,
        }
    }
}

impl Document {
    /// The sections that have something to show.
    pub fn shown(&self) -> impl Iterator<Item = &Section> {
        let sections = self.sections.iter();
        sections.filter(|section| section.blocks.iter().any(Block::tells))
    }

    fn blocks(&self) -> impl Iterator<Item = &Block> {
        self.sections.iter().flat_map(|section| &section.blocks)
    }

    /// All its facts.
    pub fn facts(&self) -> impl Iterator<Item = &Fact> {
        self.blocks().flat_map(|block| match block {
            Block::Glance(facts) | Block::Facts(_, facts) => facts.as_slice(),
            _ => &[],
        })
    }

    /// All its tables.
    pub fn tables(&self) -> impl Iterator<Item = &Table> {
        self.blocks().filter_map(|block| match block {
            Block::Table(table) => Some(table),
            _ => None,
        })
    }
}
