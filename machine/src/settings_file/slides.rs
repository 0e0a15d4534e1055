//! Rotary axes of a file that is read, as the slides that stand for them.

use toml::{Table, Value};

use crate::settings_file::schema::KeySchema;

/// Gives the rotary axes of a file the keys of the slides that stand for them.
pub fn into_slides(schema: KeySchema<'_>, file: &mut Table) {
    let of_axis = schema.key("axis").and_then(KeySchema::items);
    let axes = file.get_mut("axis").and_then(Value::as_array_mut);
    let (Some(of_axis), Some(axes)) = (of_axis, axes) else {
        return;
    };
    for axis in axes.iter_mut().filter_map(Value::as_table_mut) {
        if axis.get("kind").and_then(Value::as_str) == Some("rotary") {
            into_slide(of_axis, axis);
        }
    }
}

fn into_slide(schema: KeySchema<'_>, table: &mut Table) {
    let keys: Vec<String> = table.keys().cloned().collect();
    for own in keys {
        if let Some((key, _, unit)) = schema.slide_key(&own) {
            if let Some(value) = table.remove(&own) {
                table.insert(key.to_string(), scaled(value, unit.factor));
            }
        } else if let (Some(Value::Table(inner)), Some(of_key)) =
            (table.get_mut(&own), schema.key(&own))
        {
            into_slide(of_key, inner);
        }
    }
}

/// A value of another unit; of the same digits where one is one.
fn scaled(value: Value, factor: f64) -> Value {
    match value {
        value if factor == 1.0 => value,
        Value::Integer(number) => Value::Float(number as f64 * factor),
        Value::Float(number) => Value::Float(number * factor),
        Value::Array(list) => Value::Array(
            list.into_iter()
                .map(|value| scaled(value, factor))
                .collect(),
        ),
        other => other,
    }
}
