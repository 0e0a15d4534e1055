//! Where each field of a sample lies in it: one table per sample, for its log, its schema and for tests that spoil it.
//!
//! A table only lists names; offsets, sizes and kinds come from the struct itself, and a compile-time check holds that
//! the fields follow each other without a hole to the last byte, so none can be forgotten, swapped or mistyped.

/// What a field is.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// A number: its name in ROS 2 interface files and its size in bytes.
    Number(&'static str, usize),
    /// A struct of its own.
    Struct(&'static Table),
    /// Several of one kind.
    Array(&'static Kind, usize),
}

impl Kind {
    /// Size in memory, in bytes.
    pub const fn bytes(&self) -> usize {
        match self {
            Kind::Number(_, bytes) => *bytes,
            Kind::Struct(table) => table.bytes,
            Kind::Array(element, count) => element.bytes() * *count,
        }
    }
}

/// A type that can be in a sample.
pub trait Wire {
    /// What it is.
    const KIND: Kind;
}

macro_rules! numbers {
    ($($number:ident $name:literal),*) => {$(
        impl Wire for $number {
            const KIND: Kind = Kind::Number($name, size_of::<$number>());
        }
    )*};
}
numbers!(u32 "uint32", i32 "int32", u64 "uint64", i64 "int64", f64 "float64");

impl<T: Wire, const N: usize> Wire for [T; N] {
    const KIND: Kind = Kind::Array(&T::KIND, N);
}

/// How much of an array is in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// All of it.
    Whole,
    /// One element per axis of the machine.
    Axes,
    /// One element per axis of the machine that programs move.
    PathAxes,
    /// One element per instrument sample within a scan.
    Subsamples,
    /// One element per named signal of the machine.
    Signals,
}

/// One field.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Where it is in the struct, in bytes.
    pub offset: usize,
    /// What it is.
    pub kind: Kind,
    /// How much of it is in use.
    pub cut: Cut,
}

/// One struct.
#[derive(Debug)]
pub struct Table {
    /// Its name.
    pub name: &'static str,
    /// Its size in memory, in bytes.
    pub bytes: usize,
    /// Its fields in order.
    pub fields: &'static [Field],
}

impl Table {
    /// Whether the fields cover the struct from the first to the last byte.
    #[expect(
        clippy::indexing_slicing,
        reason = "evaluated by the compiler alone: `get` is not const"
    )]
    pub const fn is_whole(&self) -> bool {
        let (mut next, mut index) = (0, 0);
        while index < self.fields.len() {
            if self.fields[index].offset != next {
                return false;
            }
            next += self.fields[index].kind.bytes();
            index += 1;
        }
        next == self.bytes
    }
}

/// The kind of the field that `_get` names; the function itself is never called.
pub const fn kind_of<T, F: Wire>(_get: fn(&T) -> &F) -> Kind {
    F::KIND
}

/// Writes the table of a struct and implements [`Wire`] for it.
#[macro_export]
macro_rules! table {
    ($name:ident: $($field:ident $(@ $cut:ident)?),* $(,)?) => {
        impl $crate::layout::Wire for $name {
            const KIND: $crate::layout::Kind = $crate::layout::Kind::Struct(&$crate::layout::Table {
                name: stringify!($name),
                bytes: size_of::<$name>(),
                fields: &[$($crate::layout::Field {
                    name: stringify!($field),
                    offset: std::mem::offset_of!($name, $field),
                    kind: $crate::layout::kind_of(|sample: &$name| &sample.$field),
                    cut: $crate::table!(@cut $($cut)?),
                }),*],
            });
        }
        const _: () = assert!(
            matches!(<$name as $crate::layout::Wire>::KIND, $crate::layout::Kind::Struct(table) if table.is_whole()),
            "the table does not name every field in order"
        );
    };
    (@cut) => { $crate::layout::Cut::Whole };
    (@cut $cut:ident) => { $crate::layout::Cut::$cut };
}

/// One number in a sample.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leaf {
    /// Its name: those of the fields that it is in, and its place in an array, with dots between.
    pub name: String,
    /// Where it is, in bytes.
    pub offset: usize,
    /// Name of its type in ROS 2 interface files.
    pub number: &'static str,
    /// Its size, in bytes.
    pub bytes: usize,
}

/// Every number of `T`, in order.
pub fn leaves<T: Wire>() -> Vec<Leaf> {
    let mut found = Vec::new();
    place("", &T::KIND, 0, &mut found);
    found
}

fn place(name: &str, kind: &Kind, offset: usize, found: &mut Vec<Leaf>) {
    let within = |part: &str| match name {
        "" => part.to_string(),
        _ => format!("{name}.{part}"),
    };
    match kind {
        Kind::Number(number, bytes) => found.push(Leaf {
            name: name.into(),
            offset,
            number,
            bytes: *bytes,
        }),
        Kind::Struct(table) => {
            for field in table.fields {
                place(
                    &within(field.name),
                    &field.kind,
                    offset + field.offset,
                    found,
                );
            }
        }
        Kind::Array(element, count) => {
            for index in 0..*count {
                let at = offset + index * element.bytes();
                place(&within(&index.to_string()), element, at, found);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Feedback, PathTag, WindowHeader};

    #[test]
    fn a_table_that_forgets_or_swaps_a_field_is_not_whole() {
        let Kind::Struct(table) = PathTag::KIND else {
            panic!()
        };
        assert!(table.is_whole());
        let without_last = Table {
            name: "PathTag",
            bytes: table.bytes,
            fields: &table.fields[..2],
        };
        assert!(!without_last.is_whole());
        let first_missing = Table {
            name: "PathTag",
            bytes: table.bytes,
            fields: &table.fields[1..],
        };
        assert!(!first_missing.is_whole());
    }

    #[test]
    fn every_number_of_a_sample_has_a_name_and_a_place() {
        let header = leaves::<WindowHeader>();
        let names: Vec<&str> = header.iter().map(|leaf| leaf.name.as_str()).collect();
        let first = ["id.checksum", "id.sequence", "id.incarnation"];
        assert_eq!(names.get(..3), Some(&first[..]));
        assert_eq!(names.last(), Some(&"ends_program"));
        let feedback = leaves::<Feedback>();
        assert_eq!(
            feedback.iter().map(|leaf| leaf.bytes).sum::<usize>(),
            size_of::<Feedback>()
        );
        assert!(feedback.iter().any(|leaf| leaf.name == "axes.7.drive_code"));
    }
}
