//! What is wrong with a settings file, each with the place it is at.

use crate::settings_file::error::SettingsFileError;

/// A key in a settings file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The axis, by its number in the file from 0, and its name.
    pub axis: Option<(usize, String)>,
    /// The path of the key, below the axis if there is one; empty for the whole table.
    pub path: String,
    /// Its line, from 1.
    pub line: usize,
}

impl Place {
    /// A key in a document that cannot be read.
    pub fn unknown(axis: Option<(usize, &str)>, path: &[&str]) -> Place {
        Place {
            axis: axis.map(|(index, name)| (index, name.to_string())),
            path: path.join("."),
            line: 1,
        }
    }

    /// A key of this one, on a line.
    pub fn key(&self, key: &str, line: usize) -> Place {
        let path = match self.path.as_str() {
            "" => key.to_string(),
            table => format!("{table}.{key}"),
        };
        Place {
            axis: self.axis.clone(),
            path,
            line,
        }
    }

    /// The path by the words of the reference: `axis.motor.rated_torque_nm`.
    pub fn full_path(&self) -> String {
        match (&self.axis, self.path.as_str()) {
            (None, path) => path.to_string(),
            (Some(_), "") => "axis".to_string(),
            (Some(_), path) => format!("axis.{path}"),
        }
    }
}

/// All that is wrong with one file.
#[derive(Debug)]
pub struct Problems {
    file: String,
    found: Vec<(Place, String)>,
}

impl Problems {
    /// None so far, in the file of this name.
    pub fn of(file: &str) -> Problems {
        Problems {
            file: file.to_string(),
            found: Vec::new(),
        }
    }

    /// Something is wrong at `place`; `what` follows the name of the key.
    pub fn add(&mut self, place: Place, what: &str) {
        let mut subject = Vec::new();
        if let Some((_, name)) = &place.axis {
            subject.push(format!("axis {name}"));
        }
        if !place.path.is_empty() {
            subject.push(place.path.clone());
        }
        let (file, line, subject) = (&self.file, place.line, subject.join(" "));
        let what = match subject.as_str() {
            "" => what.trim_start_matches([':', ' ']),
            _ => what,
        };
        let text = format!("{file}:{line}: {subject}{what}");
        self.found.push((place, text));
    }

    /// The same, in the place of what is known of this key already: a relation says more than a range.
    pub fn replace(&mut self, place: Place, what: &str) {
        self.found
            .retain(|(at, _)| (&at.axis, &at.path) != (&place.axis, &place.path));
        self.add(place, what);
    }

    /// Where something is wrong.
    pub fn places(&self) -> Vec<Place> {
        self.found.iter().map(|(place, _)| place.clone()).collect()
    }

    /// Whether there is none.
    pub fn none(&self) -> bool {
        self.found.is_empty()
    }

    /// Ends the check.
    ///
    /// # Errors
    /// Everything that is wrong, in the order of the file.
    pub fn judge(self) -> Result<(), SettingsFileError> {
        if self.none() {
            Ok(())
        } else {
            Err(self.into_error())
        }
    }

    /// Everything that is wrong, in the order of the file.
    pub fn into_error(mut self) -> SettingsFileError {
        self.found.sort_by_key(|(place, _)| place.line);
        let lines = self.found.into_iter().map(|(_, text)| text);
        SettingsFileError::Broken(lines.collect())
    }
}
