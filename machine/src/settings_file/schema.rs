//! What a settings file may hold: a JSON Schema made from the structs it is read into.

use schemars::generate::SchemaSettings;
use schemars::transform::transform_subschemas;
use schemars::{JsonSchema, Schema as JsonSchemaValue};
use serde_json::{Map, Value, json};

use crate::settings_file::own_units::{self, OWN_UNITS, OwnUnit};
use crate::settings_file::range::{From, Range};

/// The schema of a settings file.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema(Value);

/// The schema of one key: of a value, a list or a table.
#[derive(Debug, Clone, Copy)]
pub struct KeySchema<'a>(&'a Value);

/// What a key holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Further keys.
    Table,
    /// Values or tables in a row.
    List,
    /// Any number.
    Number,
    /// A number without a fraction.
    Whole,
    /// Text.
    Text,
    /// `true` or `false`.
    Flag,
}

/// One of the words that a key can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Word<'a> {
    /// The word.
    pub word: &'a str,
    /// What it means; empty where it says that itself.
    pub meaning: &'a str,
}

impl Schema {
    /// The schema of a file that is read into `T`.
    pub fn of<T: JsonSchema>() -> Schema {
        let mut settings = SchemaSettings::draft07();
        settings.inline_subschemas = true;
        let generator = settings.with_transform(plain).into_generator();
        Schema(generator.into_root_schema_for::<T>().to_value())
    }

    /// The whole file, as a table.
    pub fn root(&self) -> KeySchema<'_> {
        KeySchema(&self.0)
    }

    /// The JSON Schema for editors, whose help shows the description alone: unit, range and default stand there too.
    pub fn json(&self) -> String {
        let mut shown = self.0.clone();
        let axis = shown
            .get_mut("properties")
            .and_then(|keys| keys.get_mut("axis"));
        if let Some(axis) = axis.and_then(|axes| axes.get_mut("items")) {
            for_rotary(axis);
        }
        describe(&mut shown);
        without_unless(&mut shown);
        format!("{shown:#}\n")
    }
}

/// Makes of a schema one that is easy to read: no `null`, which TOML does not have, no formats; what has a default is not required, and
/// a table whose keys all have defaults has one itself; the numbers of a list have its unit. No table has other keys than its own.
fn plain(schema: &mut JsonSchemaValue) {
    transform_subschemas(&mut plain, schema);
    let Some(object) = schema.as_object_mut() else {
        return;
    };
    object.shift_remove("format");
    if let Some(Value::Array(kinds)) = object.get("type") {
        let kind = kinds.iter().find(|kind| *kind != "null").cloned();
        object.extend(kind.map(|kind| ("type".to_string(), kind)));
    }
    // A key that may be left out and is one of several words.
    if let Some(Value::Array(any)) = object.shift_remove("anyOf") {
        let mut some = any
            .into_iter()
            .filter(|of| of.get("type") != Some(&json!("null")));
        if let Some(Value::Object(of)) = some.next() {
            for (key, value) in of {
                object.entry(key).or_insert(value);
            }
        }
    }
    if let (Some(unit), Some(items)) = (object.get("unit").cloned(), object.get_mut("items")) {
        items["unit"] = unit;
    }
    if object.contains_key("properties") {
        object.insert("additionalProperties".into(), false.into());
    }
    let Some(Value::Array(required)) = object.shift_remove("required") else {
        return;
    };
    let Some(Value::Object(keys)) = object.get_mut("properties") else {
        return;
    };
    let mut needed = Vec::new();
    for key in required {
        let Some(of_key) = key.as_str().and_then(|key| keys.get_mut(key)) else {
            continue;
        };
        let is_table = of_key.get("type") == Some(&json!("object"));
        if is_table && of_key.get("required").is_none() {
            of_key["default"] = json!({});
        }
        if of_key.get("default").is_none() {
            needed.push(key);
        }
    }
    if !needed.is_empty() {
        object.insert("required".into(), needed.into());
    }
}

/// Lets editors take the keys of an axis by the names that they have on a rotary one too.
fn for_rotary(schema: &mut Value) {
    let whole = schema.clone();
    let Some(Value::Object(keys)) = schema.get_mut("properties") else {
        return;
    };
    let mut own = Vec::new();
    for (key, of_key) in keys.iter_mut() {
        for_rotary(of_key);
        if let Some((name, unit)) = KeySchema(&whole).own_key(key) {
            let mut of_own = of_key.clone();
            own_units::of_rotary(&mut of_own, unit);
            own.push((key.clone(), name, of_own));
        }
    }
    let mut known = Vec::new();
    for (key, name, of_own) in own {
        keys.insert(name, of_own);
        known.push(key);
    }
    if let Some(Value::Array(required)) = schema.get_mut("required") {
        required.retain(|key| known.iter().all(|known| key != known));
    }
}

/// Takes out what is no word of JSON Schema; what another key makes needless is not required.
fn without_unless(schema: &mut Value) {
    let mut needless = Vec::new();
    if let Some(Value::Object(keys)) = schema.get_mut("properties") {
        for (key, of_key) in keys.iter_mut() {
            without_unless(of_key);
            let unless = of_key
                .as_object_mut()
                .and_then(|of_key| of_key.shift_remove("unless"));
            needless.extend(unless.map(|_| key.clone()));
        }
    }
    if let Some(items) = schema.get_mut("items") {
        without_unless(items);
    }
    if let Some(Value::Array(required)) = schema.get_mut("required") {
        required.retain(|key| needless.iter().all(|needless| key != needless));
    }
}

fn describe(schema: &mut Value) {
    let facts = KeySchema(schema).facts();
    let Some(object) = schema.as_object_mut() else {
        return;
    };
    if let (Some(Value::String(text)), false) = (object.get_mut("description"), facts.is_empty()) {
        text.push_str(&format!("\n\n{facts}"));
    }
    if let Some(Value::Object(keys)) = object.get_mut("properties") {
        keys.values_mut().for_each(describe);
    }
    if let Some(items) = object.get_mut("items") {
        describe(items);
    }
}

impl<'a> KeySchema<'a> {
    /// What it holds.
    pub fn kind(self) -> Kind {
        match self.0.get("type").and_then(Value::as_str) {
            Some("object") => Kind::Table,
            Some("array") => Kind::List,
            Some("number") => Kind::Number,
            Some("integer") => Kind::Whole,
            Some("boolean") => Kind::Flag,
            _ => Kind::Text,
        }
    }

    /// Its meaning.
    pub fn meaning(self) -> String {
        self.text("description").replace('\n', " ")
    }

    /// Its unit; none of what is a plain number or no number.
    pub fn unit(self) -> &'a str {
        self.text("unit")
    }

    /// The unit of its numbers, whether it is one or a list of them.
    pub(in crate::settings_file) fn number_unit(self) -> &'a str {
        match self.items() {
            Some(of_item) => of_item.unit(),
            None => self.unit(),
        }
    }

    /// The key of the slide that a rotary axis has under the name `own` in a table, and its unit there. None for what the table has itself.
    pub fn slide_key(self, own: &str) -> Option<(&'a str, KeySchema<'a>, &'static OwnUnit)> {
        if self.key(own).is_some() {
            return None;
        }
        OWN_UNITS.iter().find_map(|unit| {
            let name = format!(
                "{}{}",
                own.strip_suffix(unit.own_ending)?,
                unit.slide_ending
            );
            let (name, of_key) = self.keys().find(|(key, _)| *key == name)?;
            (of_key.number_unit() == unit.slide_unit).then_some((name, of_key, unit))
        })
    }

    /// The name that a rotary axis has for a key of a slide, and its unit; none for what is the same for both.
    pub fn own_key(self, key: &str) -> Option<(String, &'static OwnUnit)> {
        let of_key = self.keys().find(|(name, _)| *name == key)?.1;
        let unit = OWN_UNITS.iter().find(|unit| {
            key.ends_with(unit.slide_ending) && of_key.number_unit() == unit.slide_unit
        })?;
        let own = format!(
            "{}{}",
            key.strip_suffix(unit.slide_ending)?,
            unit.own_ending
        );
        // What a rotary axis would call like another key keeps its name.
        self.key(&own).is_none().then_some((own, unit))
    }

    /// The key of the same table that makes this one needless: by being there, or of a flag by being true.
    pub fn unless(self) -> Option<&'a str> {
        self.0.get("unless").and_then(Value::as_str)
    }

    /// Whether the key of this name in a table is true or false.
    pub(in crate::settings_file) fn is_flag(self, name: &str) -> bool {
        self.key(name).is_some_and(|key| key.kind() == Kind::Flag)
    }

    fn text(self, word: &str) -> &'a str {
        self.0.get(word).and_then(Value::as_str).unwrap_or_default()
    }

    /// Between which values a number must lie.
    pub fn range(self) -> Range {
        let number = |word| self.0.get(word).and_then(Value::as_f64);
        let above = number("exclusiveMinimum").map(From::Above);
        Range {
            from: above.or(number("minimum").map(From::AtLeast)),
            high: number("maximum"),
        }
    }

    /// The words it can have; none where any will do.
    pub fn words(self) -> Vec<Word<'a>> {
        let list = |word| self.0.get(word).and_then(Value::as_array);
        let plain = list("enum").into_iter().flatten();
        let plain = plain
            .filter_map(Value::as_str)
            .map(|word| Word { word, meaning: "" });
        let described = list("oneOf").into_iter().flatten().map(KeySchema);
        let described = described.map(|of_word| Word {
            word: of_word.text("const"),
            meaning: of_word.text("description"),
        });
        plain.chain(described).collect()
    }

    /// The value it has where the file has none.
    pub fn default(self) -> Option<&'a Value> {
        self.0.get("default")
    }

    /// The keys of a table, in the order of their declaration.
    pub fn keys(self) -> impl Iterator<Item = (&'a str, KeySchema<'a>)> {
        let keys = self.0.get("properties").and_then(Value::as_object);
        let keys = keys.into_iter().flat_map(Map::iter);
        keys.map(|(key, schema)| (key.as_str(), KeySchema(schema)))
    }

    /// The key of this name in a table: one of its own, or any where names are free.
    pub fn key(self, name: &str) -> Option<KeySchema<'a>> {
        let own = self.0.get("properties").and_then(|keys| keys.get(name));
        own.map(KeySchema).or(self.any_key())
    }

    /// What stands under each key of a table whose names are free.
    pub fn any_key(self) -> Option<KeySchema<'a>> {
        let any = self.0.get("additionalProperties");
        any.filter(|any| any.is_object()).map(KeySchema)
    }

    /// The keys of a table that must be there.
    pub fn required(self) -> impl Iterator<Item = &'a str> {
        let keys = self.0.get("required").and_then(Value::as_array);
        keys.into_iter().flatten().filter_map(Value::as_str)
    }

    /// What is in a list.
    pub fn items(self) -> Option<KeySchema<'a>> {
        self.0.get("items").map(KeySchema)
    }

    /// How many values a list has: fewest and most.
    pub fn length(self) -> (u64, u64) {
        let number = |word| self.0.get(word).and_then(Value::as_u64);
        (
            number("minItems").unwrap_or(0),
            number("maxItems").unwrap_or(u64::MAX),
        )
    }

    /// Unit, range and default of a value in one line.
    pub fn facts(self) -> String {
        let mut facts = Vec::new();
        if matches!(self.kind(), Kind::Number | Kind::Whole) {
            let unit = self.unit();
            facts.extend((!unit.is_empty()).then(|| format!("in {unit}")));
            facts.push(self.range().to_string());
        }
        if let Some(default) = self.default().filter(|_| self.kind() != Kind::Table) {
            facts.push(format!("default {default}"));
        }
        facts.retain(|fact| !fact.is_empty());
        facts.join("; ")
    }
}
