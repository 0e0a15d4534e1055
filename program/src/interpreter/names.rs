//! What parameters are worth: those that were set, and those that tell of the program.

use machine::Dialect;

use super::{Interpreter, Refusal, refuse};
use crate::expression::{Lookup, Target};
use crate::fanuc::Variable;
use crate::parameters::{base, check_settable};

impl Lookup for Interpreter {
    fn dialect(&self) -> Dialect {
        self.state.equipment().dialect
    }

    fn numbered(&self, number: u32) -> Result<f64, Refusal> {
        if self.is_fanuc() {
            return match self.variable(number) {
                Err(_) if !self.state_known => Ok(0.0),
                value => value,
            };
        }
        if (base::POSITION..base::POSITION + 9).contains(&number) {
            let letter = (number - base::POSITION) as usize;
            return Ok(self.state.position_of(letter));
        }
        // Where the state is not known, no number is missing.
        match self.state.parameters().read(number) {
            Err(_) if !self.state_known => Ok(0.0),
            read => read,
        }
    }

    fn named(&self, name: &str) -> Option<f64> {
        let value = if name.starts_with('_') {
            let set = self.state.parameters().named(name);
            set.or_else(|| self.predefined(name))
        } else {
            self.frames.current().named.get(name).copied()
        };
        // Where the state is not known, no name is missing.
        value.or((!self.state_known).then_some(0.0))
    }

    fn check_settable(&self, target: &Target) -> Result<(), Refusal> {
        match target {
            Target::Numbered(number) if self.is_fanuc() => {
                Variable::of(*number)?.check_settable(*number)
            }
            Target::Numbered(number) => check_settable(*number),
            // LinuxCNC has no such names.
            Target::Named(name) if matches!(name.as_str(), "_control_mode" | "_path_control") => {
                Ok(())
            }
            Target::Named(name) if name.starts_with('_') && self.predefined(name).is_some() => {
                let right = "it tells of the machine; a name of your own, such as #<_depth>";
                refuse(0, format!("#<{name}>, which is read-only"), right)
            }
            Target::Named(_) => Ok(()),
        }
    }
}

impl Interpreter {
    fn predefined(&self, name: &str) -> Option<f64> {
        Some(match name {
            "_line" => f64::from(self.line_of_file),
            "_ccomp" => f64::from(self.route.compensation_code()),
            "_call_level" => self.frames.called.len() as f64,
            "_value" => self.returned.0,
            "_value_returned" => f64::from(u8::from(self.returned.1)),
            _ => return self.state.predefined(name),
        })
    }
}
