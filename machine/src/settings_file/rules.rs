//! Rules that relate several keys of a settings file.

use crate::settings_file::document::Document;
use crate::settings_file::error::SettingsFileError;
use crate::settings_file::problems::{Place, Problems};
use crate::settings_file::range::{From, Range, spaced};

/// One axis in the file: its index and name.
pub type At<'a> = Option<(usize, &'a str)>;

/// Checks values one by one and collects what breaks a rule.
#[derive(Debug)]
pub struct Rules<'a> {
    document: Option<Document<'a>>,
    broken: Problems,
    /// Keys that are wrong by themselves: a relation that they break as well says more.
    alone: Vec<Place>,
}

impl<'a> Rules<'a> {
    /// For a file of this name and text.
    pub fn of(name: &'a str, text: &'a str) -> Rules<'a> {
        Rules {
            document: Document::parse(name, text).ok(),
            broken: Problems::of(name),
            alone: Vec::new(),
        }
    }

    /// For a file of which this is known already.
    pub(in crate::settings_file) fn after(document: Document<'a>, broken: Problems) -> Rules<'a> {
        Rules {
            document: Some(document),
            alone: broken.places(),
            broken,
        }
    }

    /// Whether the file has this key.
    pub fn has(&self, axis: At<'_>, path: &[&str]) -> bool {
        let document = self.document.as_ref();
        document.is_some_and(|document| document.has(axis, path))
    }

    /// A rule is broken: reports it of the key at `path`.
    pub fn say(&mut self, path: &[&str], axis: At, what: &str) {
        let place = match &self.document {
            Some(document) => document.place(axis, path),
            None => Place::unknown(axis, path),
        };
        let what = format!(" {what}");
        let same = |at: &Place| (&at.axis, &at.path) == (&place.axis, &place.path);
        match self.alone.iter().position(same) {
            Some(index) => {
                self.alone.swap_remove(index);
                self.broken.replace(place, &what);
            }
            None => self.broken.add(place, &what),
        }
    }

    /// The value must lie between `from` and `high`; NaN does not.
    pub fn range(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        from: From,
        high: f64,
    ) {
        let range = Range {
            from: Some(from),
            high: Some(high),
        };
        // Limits that follow from a value which is wrong itself are none.
        let low = match from {
            From::Above(low) | From::AtLeast(low) => low,
        };
        if high <= low && !self.all_kept() {
            return;
        }
        if !range.contains(value) {
            let (value, unit, by) = self.shown(path, axis, value, unit);
            let (range, unit) = (range.divided(by), spaced(unit));
            self.say(
                path,
                axis,
                &format!("= {value}{unit}: must be {range}{unit}"),
            );
        }
    }

    /// The value must lie between `low` and `high`, both included; NaN does not.
    pub fn between(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        low: f64,
        high: f64,
    ) {
        self.range(path, axis, value, unit, From::AtLeast(low), high);
    }

    /// `low_key <= value` of two keys of one table.
    pub fn at_least(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        low_key: &str,
        low: f64,
    ) {
        if value < low {
            let (value, unit, by) = self.shown(path, axis, value, unit);
            let (low, unit) = (low / by, spaced(unit));
            let what = format!("= {value}{unit}: must be at least {low_key} = {low}{unit}");
            self.say(path, axis, &what);
        }
    }

    /// A value and its unit as the file has it, and by what it is divided for it.
    fn shown<'u>(&self, path: &[&str], axis: At, value: f64, unit: &'u str) -> (f64, &'u str, f64) {
        let document = self.document.as_ref();
        match document.and_then(|document| document.own_unit(axis, path)) {
            Some(own) => (value / own.factor, own.unit, own.factor),
            None => (value, unit, 1.0),
        }
    }

    /// Whether no rule is broken so far.
    pub fn all_kept(&self) -> bool {
        self.broken.none()
    }

    /// Ends the check.
    ///
    /// # Errors
    /// [`SettingsFileError::Broken`] with everything that breaks a rule, in the order of the file.
    pub fn judge(self) -> Result<(), SettingsFileError> {
        self.broken.judge()
    }
}
