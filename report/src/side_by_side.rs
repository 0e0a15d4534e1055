//! Two documents of one program side by side: the numbers that both have, and their differences.
//!
//! Differences are A − B, per cent those of |B|. Rows are matched by their names; what has no counterpart stands alone.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Map, Value as Json, json};

use super::document::{Block, Cell, Columns, Document, Row, Section, Table, digits};
use super::match_up::matched;
use super::rounded::r3;

/// The headings of a comparison in their order, and the keys whose numbers stand below each. What has another key is only in
/// the report.json.
const TOPICS: [(&str, &[&str]); 12] = [
    ("Contour error on the table, in µm", &["contour_error_um"]),
    ("Parts of the contour error, rms in µm", &["part_rms_um"]),
    ("Following error, in µm", &["following_error_um"]),
    (
        "Following error of rotary axes, in mdeg",
        &["following_error_mdeg"],
    ),
    ("Circular deviation G, in µm", &["circular_deviation_um"]),
    (
        "Both directions of a circle together G(b), in µm",
        &["bidirectional_deviation_um"],
    ),
    ("Hysteresis H of a circle, in µm", &["hysteresis_um"]),
    (
        "Reversals on arcs in steady motion, in µm",
        &["protrusions_um"],
    ),
    (
        "Protrusion of each reversal on an arc, in µm",
        &["protrusion_um"],
    ),
    (
        "Timing and faults",
        &[
            "machine_time_s",
            "wall_s",
            "overrun_scans",
            "samples_lost",
            "faults",
            "missed_scans",
        ],
    ),
    ("Setpoints beyond limits", &["limits"]),
    ("Motor torque, rms in Nm", &["torque_rms_nm"]),
];

/// One quantity of both.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Compared {
    pub a: Option<f64>,
    pub b: Option<f64>,
    /// A − B; none where one has none.
    pub difference: Option<f64>,
    /// The same in per cent of |B|; none also where B is 0.
    pub per_cent: Option<f64>,
}

impl Compared {
    pub fn of(a: Option<f64>, b: Option<f64>) -> Compared {
        let (a, b) = (a.map(r3), b.map(r3));
        let difference = a.zip(b).map(|(a, b)| r3(a - b));
        Compared {
            a,
            b,
            difference,
            per_cent: difference
                .zip(b.filter(|b| *b != 0.0))
                .map(|(difference, b)| libm::round(difference / b.abs() * 1e4) / 1e2 + 0.0),
        }
    }
}

/// A quantity of both with its name and its decimals.
struct Line(String, Compared, usize);

/// The table below a heading.
fn table(lines: &[Line]) -> Table {
    let signed = |Line(_, both, decimals): &Line| match both.difference {
        None => "–".into(),
        // Nothing differs.
        Some(0.0) => "=".into(),
        Some(difference) => format!("{difference:+.decimals$}"),
    };
    let share = |line: &Line| {
        let share = line.1.per_cent.filter(|share| *share != 0.0);
        share.map_or(String::new(), |share| format!("{share:+.1} %"))
    };
    Columns::of("rows", lines)
        .words("", |line| line.0.clone())
        .written("A", "", |line| digits(line.1.a, line.2))
        .written("B", "", |line| digits(line.1.b, line.2))
        .written("A\u{a0}-\u{a0}B", "", signed)
        .written("%", "", share)
        .done()
}

/// What was compared.
#[derive(Default)]
pub(super) struct SideBySide {
    /// Below each of [`TOPICS`].
    lines: BTreeMap<usize, Vec<Line>>,
    /// The same for report.json.
    pub json: Map<String, Json>,
}

impl SideBySide {
    /// Compares two documents of one program.
    pub fn of(a: &Document, b: &Document) -> SideBySide {
        let mut compared = SideBySide::default();
        for (of_a, of_b) in a.facts().zip(b.facts()).filter(|(a, _)| !a.key.is_empty()) {
            let both = Compared::of(of_a.value.number, of_b.value.number);
            let (value, label) = (of_a.value, of_a.label.to_lowercase());
            let add = |heading: &str| match value.unit {
                "" => label.clone(),
                unit if heading.ends_with(&format!(" in {unit}")) => label.clone(),
                unit => format!("{label}, {unit}"),
            };
            compared.add(of_a.key, both, value.decimals, |(heading, _)| add(heading));
            put(&mut compared.json, of_a.key, json!(both));
        }
        // One may have more tables that are not compared.
        let is_compared = |of: &Table| !of.key.is_empty();
        let of_a = a.tables().filter(|table| is_compared(table));
        let of_b = b.tables().filter(|table| is_compared(table));
        let tables = of_a.zip(of_b);
        for (of_a, of_b) in tables {
            let pairs = matched(&of_a.rows, &of_b.rows, |row| row.label.clone());
            let items = pairs.iter().filter_map(|pair| {
                let id = &pair.a.or(pair.b)?.id;
                let mut item: Map<String, Json> = Map::new();
                item.extend(id.iter().map(|(key, id)| (key.to_string(), id.clone())));
                compared.add_row(of_a, pair.a, pair.b, &mut item);
                Some(item)
            });
            let items = items.collect();
            join(&mut compared.json, of_a.key, items);
        }
        compared
    }

    /// Adds the numbers of a row of both.
    fn add_row(
        &mut self,
        table: &Table,
        a: Option<&Row>,
        b: Option<&Row>,
        item: &mut Map<String, Json>,
    ) {
        let name = a.or(b).map_or("", |row| row.label.as_str());
        let heads = table.heads.iter().enumerate();
        for (column, head) in heads.filter(|(_, head)| !head.key.is_empty()) {
            let cell = |row: Option<&Row>| row?.cells.get(column).cloned();
            let (a, b) = (cell(a), cell(b));
            let number = |cell: &Option<Cell>| cell.as_ref().and_then(Cell::number);
            let both = Compared::of(number(&a), number(&b));
            let decimals = a.or(b).map_or(0, |cell| cell.decimals());
            self.add(head.key, both, decimals, |(_, keys)| {
                // One heading stands over several columns.
                let several = keys.len() > 1 || head.key.contains('/');
                let column = several.then(|| format!(" {}", head.title.to_lowercase()));
                format!("{name}{}", column.unwrap_or_default())
            });
            put(item, head.key, json!(both));
        }
    }

    fn add(
        &mut self,
        key: &str,
        both: Compared,
        decimals: usize,
        label: impl FnOnce(&(&str, &[&str])) -> String,
    ) {
        let first = key.split('/').next().unwrap_or(key);
        let topic = TOPICS.iter().position(|(_, keys)| keys.contains(&first));
        if let Some((index, topic)) = topic.and_then(|index| Some((index, TOPICS.get(index)?)))
            && both.a.or(both.b).is_some()
        {
            let lines = self.lines.entry(index).or_default();
            lines.push(Line(label(topic), both, decimals));
        }
    }

    /// A section for each heading, with the first of its keys.
    pub fn sections(&self) -> impl Iterator<Item = (&'static str, Section)> {
        let topics = TOPICS.iter().enumerate();
        topics.filter_map(|(index, (heading, keys))| {
            let section = Section {
                heading: (*heading).into(),
                blocks: vec![Block::Table(table(self.lines.get(&index)?))],
            };
            Some((*keys.first()?, section))
        })
    }
}

/// Puts a value at a path of keys.
fn put(object: &mut Map<String, Json>, path: &str, value: Json) {
    let Some((key, rest)) = path.split_once('/') else {
        object.insert(path.into(), value);
        return;
    };
    if let Json::Object(inner) = object.entry(key).or_insert_with(|| json!({})) {
        put(inner, rest, value);
    }
}

/// Adds items to those under a key: two tables may be of the same things, row by row.
fn join(object: &mut Map<String, Json>, key: &str, items: Vec<Map<String, Json>>) {
    let Json::Array(known) = object.entry(key).or_insert_with(|| json!([])) else {
        return;
    };
    for (index, item) in items.into_iter().enumerate() {
        match known.get_mut(index) {
            Some(Json::Object(known)) => known.extend(item),
            _ => known.push(item.into()),
        }
    }
}
