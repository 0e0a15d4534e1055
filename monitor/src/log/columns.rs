//! Samples of many scans as one message, number by number: what stands still costs nothing, and who reads a number has all its
//! values in one array.
//!
//! A message is `rows`, how many samples it holds, and for each number an array: with as many values as there are samples; with one,
//! where it is the same in all of them; with two, a first value and a step, where a whole number rises by the same step.

use std::slice::ChunksExact;

use super::codec::ENCAPSULATION;
use super::layout::{Layout, Number};

/// Most samples in a message.
pub(super) const ROWS_MAX: usize = 512;

/// How the samples of one type are written in columns. A row is the message that one sample would be.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    pub(super) schema_name: String,
    pub(super) schema: String,
    pub(super) row: Layout,
    /// Where in a row the scan is in which a sample becomes visible, in bytes; a row for people has none, and nobody reads it back.
    pub(super) visible_from: usize,
}

impl Columns {
    pub(super) fn of(row: Layout) -> Columns {
        let declared = row.numbers.iter();
        let declared = declared.map(|number| format!("{}[] {}\n", number.kind, number.name));
        let mut at = 0;
        let mut visible_from = 0;
        for number in &row.numbers {
            if number.name == "visible_from" {
                visible_from = at;
            }
            at += number.piece.1;
        }
        Columns {
            schema_name: format!("{}Columns", row.schema_name),
            schema: std::iter::once("uint32 rows\n".to_string())
                .chain(declared)
                .collect(),
            visible_from,
            row,
        }
    }

    /// Appends the body of the message that these rows are to a message that has its encapsulation header.
    pub(super) fn encode(&self, rows: &[u8], message: &mut Vec<u8>) {
        let row_bytes = self.row.bytes.max(1);
        put(message, (rows.len() / row_bytes) as u64, 4);
        let (mut fours, mut eights) = (Vec::new(), Vec::new());
        let mut at = 0;
        for number in &self.row.numbers {
            let rows = rows.chunks_exact(row_bytes);
            if number.piece.1 == 4 {
                put_column::<4>(number, rows, at, &mut fours, message);
            } else {
                put_column::<8>(number, rows, at, &mut eights, message);
            }
            at += number.piece.1;
        }
    }

    /// The rows of a message's body, one behind the other; none if it does not fit.
    pub(super) fn decode(&self, body: &[u8]) -> Option<Vec<u8>> {
        let mut taken = Taken { body, at: 0 };
        let count = taken.value(4)? as usize;
        if count > ROWS_MAX {
            return None;
        }
        let row_bytes = self.row.bytes;
        let mut rows = vec![0; count * row_bytes];
        let mut at = 0;
        for number in &self.row.numbers {
            let bytes = number.piece.1;
            let mut places = rows
                .chunks_exact_mut(row_bytes)
                .filter_map(|row| row.get_mut(at..at + bytes));
            let length = taken.value(4)? as usize;
            let step = match length {
                2 if count != 2 && number.is_whole() => {
                    Some((taken.value(bytes)?, taken.value(bytes)?))
                }
                1 => Some((taken.value(bytes)?, 0)),
                _ if length == count => None,
                _ => return None,
            };
            for (row, place) in places.by_ref().enumerate() {
                let value = match step {
                    Some((first, step)) => first.wrapping_add(step.wrapping_mul(row as u64)),
                    None => taken.value(bytes)?,
                };
                place.copy_from_slice(value.to_le_bytes().get(..bytes)?);
            }
            at += bytes;
        }
        (taken.at == body.len()).then_some(rows)
    }
}

impl Number {
    fn is_whole(&self) -> bool {
        !self.kind.starts_with("float")
    }
}

/// The value in these bytes, as it stands there.
fn value(bytes: &[u8]) -> Option<u64> {
    match bytes.len() {
        4 => Some(u32::from_le_bytes(bytes.try_into().ok()?).into()),
        _ => Some(u64::from_le_bytes(bytes.try_into().ok()?)),
    }
}

/// What comes next stands at a multiple of its length from the encapsulation header on.
fn align(message: &mut Vec<u8>, bytes: usize) {
    let start = ENCAPSULATION.len();
    message.resize(start + (message.len() - start).next_multiple_of(bytes), 0);
}

/// Appends a value of so many bytes.
fn put(message: &mut Vec<u8>, value: u64, bytes: usize) {
    align(message, bytes);
    message.extend_from_slice(value.to_le_bytes().get(..bytes).unwrap_or_default());
}

/// Appends the column that begins at `at` of each row. `values` is memory to put its values one behind the other, so that looking at
/// them twice costs little.
fn put_column<const BYTES: usize>(
    number: &Number,
    rows: ChunksExact<'_, u8>,
    at: usize,
    values: &mut Vec<[u8; BYTES]>,
    message: &mut Vec<u8>,
) {
    values.clear();
    values.extend(rows.filter_map(|row| row.get(at..)?.first_chunk::<BYTES>()));
    let of = |bytes: &[u8; BYTES]| value(bytes).unwrap_or(0);
    let first = values.first().map_or(0, of);
    if values.iter().all(|other| of(other) == first) {
        put(message, 1, 4);
        put(message, first, BYTES);
        return;
    }
    let mask = u64::MAX >> (64 - 8 * BYTES);
    let step = |pair: &[[u8; BYTES]]| match pair {
        [one, next] => of(next).wrapping_sub(of(one)) & mask,
        _ => 0,
    };
    let mut steps = values.windows(2).map(step);
    let rise = steps.next().unwrap_or(0);
    if number.is_whole() && values.len() > 2 && steps.all(|other| other == rise) {
        put(message, 2, 4);
        put(message, first, BYTES);
        put(message, rise, BYTES);
        return;
    }
    put(message, values.len() as u64, 4);
    align(message, BYTES);
    message.extend_from_slice(values.as_flattened());
}

/// What of a body has been taken.
struct Taken<'a> {
    body: &'a [u8],
    at: usize,
}

impl Taken<'_> {
    fn value(&mut self, bytes: usize) -> Option<u64> {
        let at = self.at.next_multiple_of(bytes);
        self.at = at.checked_add(bytes)?;
        value(self.body.get(at..self.at)?)
    }
}

#[cfg(test)]
mod tests {
    use bus::sample::{Feedback, MAX_AXES};
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    use super::super::layout::Extent;
    use super::*;

    fn columns(axes: usize) -> Columns {
        let letters = ["X", "Y", "Z", "A", "B", "C", "U", "V"];
        let extent = Extent {
            axes: letters
                .iter()
                .take(axes)
                .map(|axis| axis.to_string())
                .collect(),
            subsamples: 4,
            signals: Vec::new(),
        };
        Columns::of(Layout::of::<Feedback>(&extent))
    }

    fn message(columns: &Columns, rows: &[u8]) -> Vec<u8> {
        let mut message = ENCAPSULATION.to_vec();
        columns.encode(rows, &mut message);
        message
    }

    /// Rows in which a number stands still, rises by a step, or does as it likes.
    fn rows(columns: &Columns, kinds: &[u8], count: usize, seed: u64) -> Vec<u8> {
        let mut rows = Vec::new();
        let mut noise = seed | 1;
        for row in 0..count as u64 {
            let numbers = columns.row.numbers.iter().zip(kinds.iter().cycle());
            for (number, kind) in numbers {
                noise ^= noise << 13;
                noise ^= noise >> 7;
                noise ^= noise << 17;
                let value = match kind {
                    0 => seed,
                    1 => seed.wrapping_add(row.wrapping_mul(seed >> 3)),
                    _ => noise,
                };
                rows.extend_from_slice(&value.to_le_bytes()[..number.piece.1]);
            }
        }
        rows
    }

    proptest! {
        #[test]
        fn columns_give_the_rows_back_to_the_bit(
            axes in 1..=MAX_AXES, kinds in proptest::collection::vec(0..3u8, 1..40), count in 1..=9usize, seed: u64
        ) {
            let columns = columns(axes);
            let rows = rows(&columns, &kinds, count, seed);
            let message = message(&columns, &rows);
            prop_assert_eq!(columns.decode(&message[ENCAPSULATION.len()..]), Some(rows));
        }

        #[test]
        fn a_damaged_message_is_refused_or_is_rows(at in any::<proptest::sample::Index>(), byte: u8, cut in any::<proptest::sample::Index>()) {
            let columns = columns(2);
            let mut message = message(&columns, &rows(&columns, &[0, 1, 2], 7, 77));
            let at = at.index(message.len());
            message[at] = byte;
            message.truncate(cut.index(message.len()) + 1);
            if let Some(rows) = columns.decode(message.get(ENCAPSULATION.len()..).unwrap_or_default()) {
                prop_assert_eq!(rows.len() % columns.row.bytes, 0);
            }
        }
    }

    #[test]
    fn what_stands_still_or_rises_evenly_costs_next_to_nothing() {
        let columns = columns(2);
        let mut all = Vec::new();
        for scan in 0..ROWS_MAX as u64 {
            let mut feedback = Feedback::zeroed();
            (feedback.scan, feedback.visible_from) = (scan, scan);
            columns.row.encode(bytemuck::bytes_of(&feedback), &mut all);
        }
        let bytes = message(&columns, &all).len();
        assert!(bytes < 16 * columns.row.numbers.len(), "{bytes} bytes");
    }
}
