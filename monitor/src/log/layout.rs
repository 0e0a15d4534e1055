//! How a sample lies in a message and in its schema, by the table of its fields ([`bus::layout`]).

use std::fmt::Write as _;

pub use bus::layout::{Cut, Field, Kind, Wire};
use machine::Machine;

/// What is in use of the arrays: the same for all samples of one run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Extent {
    /// Names of the axes, in order.
    pub axes: Vec<String>,
    /// Instrument samples within a scan.
    pub subsamples: usize,
    /// Names of the signals, in order.
    pub signals: Vec<String>,
}

impl Extent {
    /// Of the samples of a machine.
    pub fn of(machine: &Machine) -> Extent {
        Extent {
            axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            subsamples: machine.subsamples() as usize,
            signals: machine
                .signals
                .iter()
                .map(|signal| signal.name.clone())
                .collect(),
        }
    }
}

/// How the samples of one type are written in the log of one machine.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Name of the schema.
    pub schema_name: String,
    /// The schema: a ROS 2 interface definition with the nested ones after it.
    pub schema: String,
    /// Length of a message without its encapsulation header, in bytes.
    pub bytes: usize,
    /// Size of the struct in memory, in bytes.
    pub memory_bytes: usize,
    /// Where the pieces that are in use are in the struct: (offset, length) in bytes.
    pieces: Vec<(usize, usize)>,
    /// Every number of a message, in order.
    pub numbers: Vec<Number>,
}

/// A number of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Number {
    /// Names of the fields that it is in, its axis, its place in an array, joined by underscores.
    pub name: String,
    /// Name of its type in ROS 2 interface files.
    pub kind: &'static str,
    /// Where it is in the struct, and its length, in bytes.
    pub piece: (usize, usize),
}

impl Layout {
    /// The layout of `T`, cut to what is in use.
    pub fn of<T: Wire>(extent: &Extent) -> Layout {
        Self::without::<T>(extent, &[])
    }

    /// The same without the fields of these names; the schema still has them.
    pub fn without<T: Wire>(extent: &Extent, left_out: &[&str]) -> Layout {
        let kind = T::KIND;
        let name = match kind {
            Kind::Struct(table) => table.name,
            _ => "Number",
        };
        let mut builder = Builder::new(extent, left_out);
        builder.place("", &kind, 0, Cut::Whole);
        builder.define(&kind);
        let pieces = merged(builder.numbers.iter().map(|number| number.piece));
        Layout {
            schema_name: format!("quadrant/msg/{name}"),
            schema: join_definitions(&builder.definitions),
            bytes: pieces.iter().map(|piece| piece.1).sum(),
            memory_bytes: kind.bytes(),
            pieces,
            numbers: builder.numbers,
        }
    }

    /// A message without fixed length, of which only the schema is kept here.
    pub fn text(name: &str, schema: &str) -> Layout {
        Layout {
            schema_name: format!("quadrant/msg/{name}"),
            schema: schema.into(),
            bytes: 0,
            memory_bytes: 0,
            pieces: Vec::new(),
            numbers: Vec::new(),
        }
    }

    /// Appends the pieces in use of a sample's bytes.
    pub fn encode(&self, sample: &[u8], out: &mut Vec<u8>) {
        for &(offset, length) in &self.pieces {
            if let Some(piece) = sample.get(offset..offset + length) {
                out.extend_from_slice(piece);
            }
        }
    }

    /// The checksum at the end of a message, of a sample that is sent with one.
    pub fn seal(&self, message: &[u8]) -> Option<[u8; 8]> {
        let last = self.numbers.last()?;
        (last.name == "checksum").then_some(*message.last_chunk()?)
    }

    /// Puts a message back into a sample's bytes, unused ones left as they are; false if the lengths do not fit.
    pub fn decode(&self, message: &[u8], sample: &mut [u8]) -> bool {
        if message.len() != self.bytes || sample.len() != self.memory_bytes {
            return false;
        }
        let mut rest = message;
        for &(offset, length) in &self.pieces {
            let Some((piece, after)) = rest.split_at_checked(length) else {
                return false;
            };
            let Some(place) = sample.get_mut(offset..offset + length) else {
                return false;
            };
            place.copy_from_slice(piece);
            rest = after;
        }
        true
    }
}

/// Puts definitions into one schema text, as the MCAP registry asks of `ros2msg`.
pub fn join_definitions(definitions: &[(String, String)]) -> String {
    let mut text = String::new();
    for (index, (name, body)) in definitions.iter().enumerate() {
        if index > 0 {
            let _ = writeln!(text, "{}\nMSG: quadrant/{name}", "=".repeat(80));
        }
        text.push_str(body);
    }
    text
}

/// The definitions of `T` and everything in it, `T` first: (name, body).
pub fn definitions_of<T: Wire>(extent: &Extent) -> Vec<(String, String)> {
    let mut builder = Builder::new(extent, &[]);
    builder.define(&T::KIND);
    builder.definitions
}

struct Builder<'a> {
    extent: &'a Extent,
    left_out: &'a [&'a str],
    numbers: Vec<Number>,
    definitions: Vec<(String, String)>,
}

impl<'a> Builder<'a> {
    fn new(extent: &'a Extent, left_out: &'a [&'a str]) -> Self {
        Builder {
            extent,
            left_out,
            numbers: Vec::new(),
            definitions: Vec::new(),
        }
    }

    /// Names of the elements of an array of axes or signals.
    fn names_of(&self, cut: Cut) -> &'a [String] {
        let axes = self.extent.axes.as_slice();
        let lettered = axes.iter().take_while(|name| machine::is_letter(name));
        match cut {
            Cut::Axes => axes,
            Cut::PathAxes => axes.get(..lettered.count()).unwrap_or(axes),
            Cut::Signals => &self.extent.signals,
            Cut::Whole | Cut::Subsamples => &[],
        }
    }

    fn used(&self, cut: Cut, count: usize) -> usize {
        match cut {
            Cut::Whole => count,
            Cut::Axes | Cut::PathAxes | Cut::Signals => self.names_of(cut).len().min(count),
            Cut::Subsamples => self.extent.subsamples.min(count),
        }
    }

    fn place(&mut self, name: &str, kind: &Kind, offset: usize, cut: Cut) {
        let within = |part: &str| match name {
            "" => part.to_string(),
            _ => format!("{name}_{part}"),
        };
        match kind {
            Kind::Number(number, bytes) => self.numbers.push(Number {
                name: name.into(),
                kind: number,
                piece: (offset, *bytes),
            }),
            Kind::Struct(table) => {
                let kept = table.fields.iter();
                for field in kept.filter(|field| !self.left_out.contains(&field.name)) {
                    let of_axes = matches!(
                        (field.cut, &field.kind),
                        (Cut::Axes, Kind::Array(Kind::Struct(_), _))
                    );
                    let name = if of_axes {
                        name.into()
                    } else {
                        within(field.name)
                    };
                    self.place(&name, &field.kind, offset + field.offset, field.cut);
                }
            }
            Kind::Array(element, count) => {
                for index in 0..self.used(cut, *count) {
                    let axis = self.names_of(cut).get(index);
                    let part = axis.map_or(index.to_string(), |axis| axis.to_lowercase());
                    let at = offset + index * element.bytes();
                    self.place(&within(&part), element, at, Cut::Whole);
                }
            }
        }
    }

    fn define(&mut self, kind: &Kind) {
        let table = match kind {
            Kind::Struct(table) => table,
            Kind::Array(element, _) => return self.define(element),
            Kind::Number(..) => return,
        };
        if self.definitions.iter().any(|(name, _)| name == table.name) {
            return;
        }
        let mut body = String::new();
        for field in table.fields {
            self.declare(field, &mut body);
        }
        self.definitions.push((table.name.into(), body));
        for field in table.fields {
            self.define(&field.kind);
        }
    }

    fn declare(&self, field: &Field, body: &mut String) {
        let axes = self.extent.axes.iter().map(|axis| axis.to_lowercase());
        let name = field.name;
        // Writing to a string cannot fail.
        let _ = match (field.cut, &field.kind) {
            (Cut::Axes, Kind::Array(Kind::Struct(table), _)) => {
                axes.for_each(|axis| {
                    let _ = writeln!(body, "quadrant/{} {axis}", table.name);
                });
                Ok(())
            }
            (cut, Kind::Array(element, count)) => {
                let used = self.used(cut, *count);
                writeln!(body, "{}[{used}] {name}", type_name(element))
            }
            (_, kind) => writeln!(body, "{} {name}", type_name(kind)),
        };
    }
}

fn type_name(kind: &Kind) -> String {
    match kind {
        Kind::Number(name, _) => (*name).into(),
        Kind::Struct(table) => format!("quadrant/{}", table.name),
        Kind::Array(element, count) => format!("{}[{count}]", type_name(element)),
    }
}

/// Adjacent pieces as one, so that a sample is copied in a few long moves.
fn merged(pieces: impl Iterator<Item = (usize, usize)>) -> Vec<(usize, usize)> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for (offset, length) in pieces {
        match out.last_mut() {
            Some(last) if last.0 + last.1 == offset => last.1 += length,
            _ => out.push((offset, length)),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::sample::*;

    fn extent(axes: usize, subsamples: usize) -> Extent {
        let letters = ["X", "Y", "Z", "A", "B", "C", "U", "V", "W"].map(String::from);
        let others = (1..).map(|number| format!("P{number}"));
        Extent {
            axes: letters.into_iter().chain(others).take(axes).collect(),
            subsamples,
            signals: (0..SIGNALS_MAX)
                .map(|number| format!("s{number}"))
                .collect(),
        }
    }

    /// Walks the schema as a CDR reader does and returns the length it would read; panics where CDR would pad.
    fn cdr_length(definitions: &[(String, String)], name: &str, start: usize) -> usize {
        let (_, body) = definitions.iter().find(|(n, _)| n == name).unwrap();
        let mut at = start;
        for line in body.lines() {
            let (kind, field) = line.split_once(' ').unwrap();
            let (kind, count) = match kind.split_once('[') {
                Some((kind, count)) => (kind, count.trim_end_matches(']').parse().unwrap()),
                None => (kind, 1usize),
            };
            for _ in 0..count {
                let bytes = match kind {
                    "uint32" | "int32" => 4,
                    "uint64" | "int64" | "float64" => 8,
                    nested => {
                        let nested = nested.strip_prefix("quadrant/").unwrap();
                        at = cdr_length(definitions, nested, at);
                        continue;
                    }
                };
                assert_eq!(at % bytes, 0, "{name}.{field} would be padded");
                at += bytes;
            }
        }
        at
    }

    fn agrees<T: Wire>(name: &str) {
        for axes in 1..=MAX_AXES {
            for subsamples in 1..=MAX_SUBSAMPLES {
                let extent = extent(axes, subsamples);
                let layout = Layout::of::<T>(&extent);
                let definitions = definitions_of::<T>(&extent);
                assert_eq!(
                    cdr_length(&definitions, name, 0),
                    layout.bytes,
                    "{name} {axes} {subsamples}"
                );
                assert_eq!(layout.bytes % 4, 0);
            }
        }
        let all = Layout::of::<T>(&extent(MAX_AXES, MAX_SUBSAMPLES));
        assert_eq!(
            (all.bytes, all.memory_bytes),
            (size_of::<T>(), size_of::<T>())
        );
    }

    #[test]
    fn every_schema_reads_exactly_the_bytes_of_its_sample_without_padding() {
        agrees::<Feedback>("Feedback");
        agrees::<Instruments>("Instruments");
        agrees::<BusCycle>("BusCycle");
        agrees::<Signals>("Signals");
        agrees::<AxisCommand>("AxisCommand");
        agrees::<PlannerStatus>("PlannerStatus");
        agrees::<Roster>("Roster");
        agrees::<WindowHeader>("WindowHeader");
        agrees::<Setpoint>("Setpoint");
    }

    #[test]
    fn axes_have_their_letters_in_the_schema() {
        let layout = Layout::of::<Feedback>(&extent(2, 4));
        assert!(
            layout.schema.contains(
                "quadrant/AxisFeedback x\nquadrant/AxisFeedback y\nuint64 checksum\n====="
            )
        );
        assert!(layout.schema.contains("MSG: quadrant/AxisFeedback\n"));
        let layout = Layout::of::<Instruments>(&extent(3, 4));
        assert!(layout.schema.contains("quadrant/AxisInstruments z\n"));
    }

    #[test]
    fn encoding_and_decoding_give_the_same_bits_for_the_axes_in_use() {
        let layout = Layout::of::<Feedback>(&extent(3, 4));
        let mut sample: Vec<u8> = (0..size_of::<Feedback>())
            .map(|i| (i * 7 % 251) as u8)
            .collect();
        let answer = std::mem::offset_of!(Feedback, answer);
        for places in [
            std::mem::offset_of!(Feedback, program_start),
            answer + std::mem::offset_of!(Answer, tripped),
            answer + std::mem::offset_of!(Answer, rests),
        ] {
            sample[places + 3 * size_of::<i64>()..places + PATH_AXES * size_of::<i64>()].fill(0);
        }
        let mut message = Vec::new();
        layout.encode(&sample, &mut message);
        assert_eq!(message.len(), layout.bytes);
        let mut back = vec![0; sample.len()];
        assert!(layout.decode(&message, &mut back));
        let used = std::mem::offset_of!(Feedback, axes) + 3 * size_of::<AxisFeedback>();
        assert_eq!(back[..used], sample[..used]);
        let checksum = std::mem::offset_of!(Feedback, checksum);
        assert!(back[used..checksum].iter().all(|b| *b == 0));
        assert_eq!(back[checksum..], sample[checksum..]);
        assert!(!layout.decode(&message[1..], &mut back));
    }
}
