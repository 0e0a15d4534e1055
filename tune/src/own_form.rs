//! A file that a program edits, with its rotary axes as slides, and back with their own units.

use toml_edit::{DocumentMut, InlineTable, Item, Key, Table, Value};

use machine::settings_file::{KeySchema, OwnUnit, Schema};

/// Significant digits of a value that was changed and is written in another unit.
const DIGITS: usize = 4;

/// The document with the keys of slides in place of those of rotary axes.
pub fn with_slides(schema: &Schema, document: &DocumentMut) -> DocumentMut {
    let mut slides = document.clone();
    for_rotary(schema, &mut slides, |of_axis, axis, _| {
        renamed(of_axis, axis, &|of_table, key, item| {
            let (slide, _, unit) = of_table.slide_key(key)?;
            Some((slide.to_string(), times(item, unit.factor)))
        });
    });
    slides
}

/// The document with the keys of rotary axes in their own units, where `original` has them so; what was not changed stands as there.
pub fn with_own_units(
    schema: &Schema,
    slides: &DocumentMut,
    original: &DocumentMut,
) -> DocumentMut {
    let mut own = slides.clone();
    let as_read = with_slides(schema, original);
    for_rotary(schema, &mut own, |of_axis, axis, index| {
        let (Some(before), Some(read)) = (axis_of(original, index), axis_of(&as_read, index))
        else {
            return;
        };
        if before.to_string() == read.to_string() {
            return;
        }
        renamed(of_axis, axis, &|of_table, key, item| {
            let (name, unit) = of_table.own_key(key)?;
            Some((name, divided(item, unit)))
        });
        restored(axis, &written(of_axis, read), before);
    });
    own
}

/// The axis of a document as it would be written in its own units.
fn written(of_axis: KeySchema<'_>, read: &Table) -> Table {
    let mut written = read.clone();
    renamed(of_axis, &mut written, &|of_table, key, item| {
        let (name, unit) = of_table.own_key(key)?;
        Some((name, divided(item, unit)))
    });
    written
}

/// Gives a table back every value that was not changed, as it was written before.
fn restored(table: &mut Table, unchanged: &Table, before: &Table) {
    for (key, item) in table.iter_mut() {
        let (Some(same), Some(old)) = (unchanged.get(&key), before.get(&key)) else {
            continue;
        };
        match (item, same, old) {
            (Item::Table(item), Item::Table(same), Item::Table(old)) => restored(item, same, old),
            (item @ Item::Value(_), Item::Value(same), Item::Value(_))
                if item.to_string().trim() == same.to_string().trim() =>
            {
                *item = old.clone();
            }
            _ => {}
        }
    }
}

fn axis_of(document: &DocumentMut, index: usize) -> Option<&Table> {
    document.get("axis")?.as_array_of_tables()?.get(index)
}

fn for_rotary(
    schema: &Schema,
    document: &mut DocumentMut,
    mut each: impl FnMut(KeySchema<'_>, &mut Table, usize),
) {
    let of_axis = schema.root().key("axis").and_then(KeySchema::items);
    let axes = document
        .get_mut("axis")
        .and_then(Item::as_array_of_tables_mut);
    let (Some(of_axis), Some(axes)) = (of_axis, axes) else {
        return;
    };
    for (index, axis) in axes.iter_mut().enumerate() {
        if axis.get("kind").and_then(Item::as_str) == Some("rotary") {
            each(of_axis, axis, index);
        }
    }
}

/// Another name and value for a key of a table, or none.
type Other<'o> = &'o dyn Fn(KeySchema<'_>, &str, &Item) -> Option<(String, Item)>;

/// Gives the keys of a table, and of those in it, other names; the order and the comments stay.
fn renamed(schema: KeySchema<'_>, table: &mut Table, other: Other<'_>) {
    let names: Vec<String> = table.iter().map(|(key, _)| key.to_string()).collect();
    for name in names {
        let Some((key, mut item)) = table.remove_entry(&name) else {
            continue;
        };
        if let Some(of_key) = schema.key(&name) {
            match &mut item {
                Item::Table(inner) => renamed(of_key, inner, other),
                Item::Value(Value::InlineTable(inline)) => renamed_in_line(of_key, inline, other),
                _ => {}
            }
        }
        let (key, item) = match other(schema, &name, &item) {
            Some((name, changed)) => (with_decor(&key, &name), changed),
            None => (key, item),
        };
        table.insert_formatted(&key, item);
    }
}

/// The same of a table in braces.
fn renamed_in_line(schema: KeySchema<'_>, inline: &mut InlineTable, other: Other<'_>) {
    let before = inline.clone();
    let mut table = inline.clone().into_table();
    renamed(schema, &mut table, other);
    let mut after = table.into_inline_table();
    // What has the same keys stands as it was written.
    let names = |of: &InlineTable| {
        of.iter()
            .map(|(key, _)| key.to_string())
            .collect::<Vec<_>>()
    };
    if names(&after) != names(&before) {
        *after.decor_mut() = before.decor().clone();
        *inline = after;
    }
}

fn with_decor(key: &Key, name: &str) -> Key {
    Key::new(name).with_leaf_decor(key.leaf_decor().clone())
}

/// A number, or a list of numbers, each made another.
fn each_number(item: &Item, other: impl Fn(f64) -> f64) -> Item {
    let mut item = item.clone();
    match &mut item {
        Item::Value(Value::Array(list)) => {
            for value in list.iter_mut() {
                changed(value, &other);
            }
        }
        Item::Value(value) => changed(value, &other),
        _ => {}
    }
    item
}

fn changed(value: &mut Value, other: impl Fn(f64) -> f64) {
    let number = value
        .as_float()
        .or(value.as_integer().map(|whole| whole as f64));
    if let Some(number) = number {
        let mut new = Value::from(other(number));
        *new.decor_mut() = value.decor().clone();
        *value = new;
    }
}

fn times(item: &Item, factor: f64) -> Item {
    match factor {
        1.0 => item.clone(),
        factor => each_number(item, |number| number * factor),
    }
}

fn divided(item: &Item, unit: &OwnUnit) -> Item {
    match unit.factor {
        1.0 => item.clone(),
        factor => each_number(item, |number| {
            let text = format!("{:.*e}", DIGITS - 1, number / factor);
            text.parse().unwrap_or(number / factor)
        }),
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use machine::settings_file::N_PER_NM;
    use machine::{Machine, schema};
    use toml_edit::value;

    use super::*;

    /// A machine of a rotary axis in its own units.
    const TABLE: &str = include_str!("../../machine/tests/own-units.toml");

    #[test]
    fn a_file_that_was_edited_as_slides_is_written_back_as_it_speaks() {
        let original: DocumentMut = TABLE.parse().expect("TOML");
        let mut slides = with_slides(&schema(), &original);
        assert!(slides.to_string().contains("rapid_mm_s = 120.0"));
        assert_eq!(
            with_own_units(&schema(), &slides, &original).to_string(),
            TABLE
        );

        let axis = slides["axis"]
            .as_array_of_tables_mut()
            .and_then(|axes| axes.get_mut(0));
        let axis = axis.expect("an axis");
        axis["velocity_loop"]["gain_n_s_per_m"] = value(2.0 * N_PER_NM * N_PER_NM);
        axis["reversal"]["backlash_um"] = value(3.0);
        let written = with_own_units(&schema(), &slides, &original).to_string();
        assert!(written.contains("gain_nm_s_per_rad = 2.0"), "{written}");
        assert!(written.contains("backlash_mdeg = 3.0"), "{written}");
        assert!(
            written.contains("travel_min_deg = -360.0   # one turn back"),
            "{written}"
        );
        assert!(written.contains("inertia_kg_m2 = 0.8\n"), "{written}");
        Machine::parse("m.toml", &written).expect("a good file");
    }
}
