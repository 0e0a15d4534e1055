//! `--what-if`: other limits than those of the machine file.

use anyhow::{Context, bail};
use machine::Machine;
use program::Program;

/// A limit that can be another.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Key {
    Velocity,
    Acceleration,
    Jerk,
    Tolerance,
    Vibration,
}

/// One limit, of all axes or of one.
#[derive(Debug, Clone, PartialEq)]
struct Change {
    key: Key,
    axis: Option<String>,
    /// None: not limited.
    value: Option<f64>,
}

/// What is to be different.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WhatIf {
    changes: Vec<Change>,
}

impl WhatIf {
    /// Of words `KEY=VALUE` or `KEY.AXIS=VALUE`.
    ///
    /// # Errors
    /// A word that is none of these.
    pub fn of(words: &[String]) -> anyhow::Result<Self> {
        let changes = words.iter().map(|word| {
            Change::of(word).with_context(|| {
                format!(
                    "--what-if {word}: must be velocity, acceleration, jerk (.AXIS for one axis), tolerance or vibration, then = and a \
                     number above 0 (jerk and vibration: or none)"
                )
            })
        });
        Ok(Self {
            changes: changes.collect::<anyhow::Result<_>>()?,
        })
    }

    /// Gives the machine these limits.
    ///
    /// # Errors
    /// An axis that it does not have.
    pub fn apply(&self, machine: &mut Machine) -> anyhow::Result<()> {
        for Change { key, axis, value } in &self.changes {
            let number = value.unwrap_or(f64::INFINITY);
            match key {
                Key::Tolerance => machine.path.tolerance_mm = number,
                Key::Vibration => machine.path.vibration_hz = *value,
                Key::Velocity | Key::Acceleration | Key::Jerk => {
                    let mut found = false;
                    for of in &mut machine.axes {
                        if axis.as_ref().is_some_and(|name| *name != of.name) {
                            continue;
                        }
                        found = true;
                        match key {
                            Key::Velocity => of.rapid_mm_s = number,
                            Key::Acceleration => of.acceleration_mm_s2 = number,
                            _ => of.jerk_mm_s3 = *value,
                        }
                    }
                    if let (false, Some(axis)) = (found, axis) {
                        bail!("--what-if: the machine has no axis {axis}");
                    }
                }
            }
        }
        Ok(())
    }

    /// Gives what a program has in G64 the tolerance.
    pub fn apply_to_path(&self, program: &mut Program) {
        let tolerance = self.changes.iter().rfind(|of| of.key == Key::Tolerance);
        let Some(tolerance_mm) = tolerance.and_then(|of| of.value) else {
            return;
        };
        for element in &mut program.path.elements {
            if element.tolerance.corner_mm > 0.0 {
                element.tolerance.corner_mm = tolerance_mm;
                element.tolerance.chord_mm = 0.0;
            }
        }
    }
}

impl Change {
    fn of(word: &str) -> Option<Self> {
        let (name, value) = word.split_once('=')?;
        let (name, axis) = match name.split_once('.') {
            Some((name, axis)) => (name, Some(axis.to_uppercase())),
            None => (name, None),
        };
        let key = match name {
            "velocity" => Key::Velocity,
            "acceleration" => Key::Acceleration,
            "jerk" => Key::Jerk,
            "tolerance" => Key::Tolerance,
            "vibration" => Key::Vibration,
            _ => return None,
        };
        let may_be_none = matches!(key, Key::Jerk | Key::Vibration);
        let of_axes = matches!(key, Key::Velocity | Key::Acceleration | Key::Jerk);
        let value = match value {
            "none" if may_be_none => None,
            number => Some(
                number
                    .parse()
                    .ok()
                    .filter(|of: &f64| of.is_finite() && *of > 0.0)?,
            ),
        };
        (of_axes || axis.is_none()).then_some(Self { key, axis, value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_name_a_limit_of_all_axes_or_of_one_and_anything_else_is_refused() {
        let change = |word: &str| Change::of(word).map(|of| (of.key, of.axis, of.value));
        assert_eq!(change("jerk=1e5"), Some((Key::Jerk, None, Some(1e5))));
        let of_x = Some((Key::Jerk, Some("X".to_string()), None));
        assert_eq!(change("jerk.x=none"), of_x);
        assert_eq!(
            change("tolerance=0.02"),
            Some((Key::Tolerance, None, Some(0.02)))
        );
        for word in [
            "jerk",
            "jerk=",
            "jerk=0",
            "jerk=-1",
            "jerk=inf",
            "acceleration=none",
            "tolerance.X=1",
            "speed=3",
        ] {
            assert_eq!(change(word), None, "{word}");
        }
    }
}
