//! Numbers, parameters and expressions (LinuxCNC manual, *G Code Overview*: parameters, expressions, functions; NIST §3.3.2).
//!
//! An expression is evaluated while it is read: no tree is built. Operators bind in this order, those of a row from left to right:
//! `**`; `*` `/` `MOD`; `+` `-`; `EQ` `NE` `GT` `GE` `LT` `LE`; `AND` `OR` `XOR`.

use std::f64::consts::PI;

use machine::Dialect;

use crate::number::{self, NUMBER_MAX};
use crate::parameters::check_settable;
use crate::refusal::{Refusal, refuse, shown};

mod fanuc;

use fanuc::{COMPARES, FANUC_OPERATORS, filled, variable};

/// Expressions may be nested this deep.
const DEPTH_MAX: u32 = 32;
/// Numbers nearer than this are equal for EQ and NE, as LinuxCNC reads them.
const EQUAL_WITHIN: f64 = 1e-4;
/// A parameter's number may be off a whole number by as much.
const WHOLE_WITHIN: f64 = 1e-4;

/// Where parameters have their values.
pub trait Lookup {
    /// The language whose operators and functions are meant. Only Fanuc's has values that are vacant: they are no number.
    fn dialect(&self) -> Dialect {
        Dialect::LinuxCnc
    }
    /// The value of `#number`.
    ///
    /// # Errors
    /// Why there is none, and what would be right.
    fn numbered(&self, number: u32) -> Result<f64, Refusal>;
    /// The value of `#<name>`, if it is defined; lower case, without blanks.
    fn named(&self, name: &str) -> Option<f64>;
    /// Refuses a parameter that a program cannot set.
    ///
    /// # Errors
    /// What was found, and what would be right.
    fn check_settable(&self, target: &Target) -> Result<(), Refusal> {
        match target {
            Target::Numbered(number) => check_settable(*number),
            Target::Named(_) => Ok(()),
        }
    }
}

/// Which parameter is named, such as for setting it.
#[derive(Debug, Clone, PartialEq)]
pub enum Target {
    /// `#5`.
    Numbered(u32),
    /// `#<name>`, lower case, without blanks.
    Named(String),
}

/// A place in a line from which things are read.
pub struct Cursor<'a> {
    pub text: &'a str,
    pub offset: usize,
    /// A number was written with blanks in it.
    pub blanks_in_number: bool,
}

impl<'a> Cursor<'a> {
    pub fn new(text: &'a str, offset: usize) -> Self {
        Self {
            text,
            offset,
            blanks_in_number: false,
        }
    }

    fn byte(&self, offset: usize) -> u8 {
        self.text.as_bytes().get(offset).copied().unwrap_or(0)
    }

    /// The byte at the cursor in lower case; 0 at the end.
    pub fn peek(&self) -> u8 {
        self.byte(self.offset).to_ascii_lowercase()
    }

    pub fn skip_blanks(&mut self) {
        while matches!(self.byte(self.offset), b' ' | b'\t') {
            self.offset += 1;
        }
    }

    /// The next byte that is no blank, in lower case.
    pub fn next_byte(&mut self) -> u8 {
        self.skip_blanks();
        self.peek()
    }

    /// Passes this byte if it comes next.
    pub fn take(&mut self, byte: u8) -> bool {
        let is_next = self.next_byte() == byte;
        if is_next {
            self.offset += 1;
        }
        is_next
    }

    /// Passes this word if it comes next, whatever its case and the blanks in it.
    pub fn take_word(&mut self, word: &str) -> bool {
        let mut at = self.offset;
        for expected in word.bytes() {
            while matches!(self.byte(at), b' ' | b'\t') {
                at += 1;
            }
            if self.byte(at).to_ascii_lowercase() != expected {
                return false;
            }
            at += 1;
        }
        self.offset = at;
        true
    }

    /// Refuses what stands at the cursor.
    fn unexpected<T>(&self, right: &str) -> Result<T, Refusal> {
        self.error(shown(self.text, self.offset), right)
    }

    fn error<T>(&self, found: impl Into<String>, right: &str) -> Result<T, Refusal> {
        refuse(self.offset, found, right)
    }

    /// A value after a letter: a number, a parameter, an expression or a function, each with a sign before it or without.
    pub fn value(&mut self, lookup: &impl Lookup) -> Result<f64, Refusal> {
        self.value_at(lookup, 0)
    }

    fn value_at(&mut self, lookup: &impl Lookup, depth: u32) -> Result<f64, Refusal> {
        if depth > DEPTH_MAX {
            return self.error("an expression nested too deep", "at most 32 levels");
        }
        self.skip_blanks();
        match self.peek() {
            b'[' => self.expression_at(lookup, depth + 1),
            b'#' => self.parameter(lookup, depth + 1),
            sign @ (b'+' | b'-') => {
                let mut at = self.offset + 1;
                while matches!(self.byte(at), b' ' | b'\t') {
                    at += 1;
                }
                if matches!(self.byte(at), b'0'..=b'9' | b'.') {
                    return self.number();
                }
                self.offset = at;
                if matches!(self.peek(), b'+' | b'-') {
                    return self.unexpected("one sign before a value");
                }
                let value = self.value_at(lookup, depth + 1)?;
                Ok(if sign == b'-' { -value } else { value })
            }
            letter if letter.is_ascii_alphabetic() => self.function(lookup, depth + 1),
            _ => self.number(),
        }
    }

    /// A plain number.
    fn number(&mut self) -> Result<f64, Refusal> {
        let start = self.offset;
        if let Some((value, end)) = number::number(self.text.as_bytes(), start) {
            self.offset = end;
            return Ok(value);
        }
        let mut end = start;
        let signs = usize::from(matches!(self.byte(end), b'+' | b'-'));
        end += signs;
        let (mut digits, mut points) = (0, 0);
        let mut last = end;
        loop {
            match self.byte(end) {
                b'0'..=b'9' => digits += 1,
                b'.' if points == 0 => points += 1,
                // A number goes on behind a blank if a digit or its point follows (NIST §3.3.2: blanks mean nothing).
                b' ' | b'\t' => {
                    end += 1;
                    continue;
                }
                _ => break,
            }
            end += 1;
            last = end;
        }
        if digits == 0 {
            let right = "a number, such as 12.5 or -.5, #parameter or [expression]";
            return self.error(shown(self.text, start), right);
        }
        if self.byte(last) == b'.' {
            return refuse(last, "a second point", "a number has one point");
        }
        let text = self.text.get(start..last).unwrap_or_default();
        let value = if signs + digits + points < last - start {
            self.blanks_in_number = true;
            text.replace([' ', '\t'], "").parse::<f64>()
        } else {
            text.parse::<f64>()
        };
        self.offset = last;
        match value {
            Ok(value) if value.abs() <= NUMBER_MAX => Ok(value),
            _ => refuse(
                start,
                format!("a number of {} characters", last - start),
                "at most 1e9",
            ),
        }
    }

    /// The parameter that `#…` names.
    pub fn target(&mut self, lookup: &impl Lookup) -> Result<Target, Refusal> {
        self.target_at(lookup, 0)
    }

    fn target_at(&mut self, lookup: &impl Lookup, depth: u32) -> Result<Target, Refusal> {
        let start = self.offset;
        self.offset += 1;
        if self.next_byte() == b'<' {
            return Ok(Target::Named(self.name()?));
        }
        let value = self.value_at(lookup, depth + 1)?;
        if lookup.dialect() == Dialect::Fanuc {
            return variable(value).map_err(|wrong| wrong.at(start));
        }
        let Some(number) = number_of_parameter(value) else {
            let found = format!("parameter #{value}");
            let right = "a whole number from 1 to 5602, or a name such as #<depth>";
            return refuse(start, found, right);
        };
        Ok(Target::Numbered(number))
    }

    /// `<name>`: lower case, without blanks.
    pub fn name(&mut self) -> Result<String, Refusal> {
        let inside = self.text.get(self.offset + 1..).unwrap_or_default();
        let Some(length) = inside.find('>') else {
            return self.error("a name without >", "close the name: #<depth>");
        };
        let name: String = inside
            .get(..length)
            .unwrap_or_default()
            .chars()
            .filter(|character| !character.is_whitespace())
            .flat_map(char::to_lowercase)
            .collect();
        if name.is_empty() {
            return self.error("an empty name", "a name such as #<depth>");
        }
        self.offset += length + 2;
        Ok(name)
    }

    fn parameter(&mut self, lookup: &impl Lookup, depth: u32) -> Result<f64, Refusal> {
        let start = self.offset;
        match self.target_at(lookup, depth)? {
            Target::Numbered(number) => lookup.numbered(number).map_err(|wrong| wrong.at(start)),
            Target::Named(name) => lookup.named(&name).ok_or(()).or_else(|()| {
                let found = format!("#<{name}> has no value");
                let right = match name.split_once('[') {
                    Some(("_hal", _)) => {
                        "there are no pins of HAL: M66 reads inputs of the machine"
                    }
                    Some(("_ini", _)) => {
                        "there is no INI file of LinuxCNC: set a parameter of your own"
                    }
                    _ => "set it before it is used; EXISTS[#<name>] asks whether it is set",
                };
                refuse(start, found, right)
            }),
        }
    }

    /// Operators and their values, in brackets or without.
    pub fn open_expression(&mut self, lookup: &impl Lookup) -> Result<f64, Refusal> {
        self.operation(lookup, 0, 0)
    }

    /// `[…]`.
    pub fn expression(&mut self, lookup: &impl Lookup) -> Result<f64, Refusal> {
        self.expression_at(lookup, 0)
    }

    fn expression_at(&mut self, lookup: &impl Lookup, depth: u32) -> Result<f64, Refusal> {
        let start = self.offset;
        self.offset += 1;
        let value = self.operation(lookup, depth, 0)?;
        if !self.take(b']') {
            if self.peek() == 0 {
                return refuse(start, "[ that is not closed", "close it with ]");
            }
            let right = "an operator (+ - * / ** MOD EQ NE GT GE LT LE AND OR XOR) or ]";
            return self.unexpected(right);
        }
        Ok(value)
    }

    /// A chain of operators that bind tighter than `bound`.
    fn operation(&mut self, lookup: &impl Lookup, depth: u32, bound: u32) -> Result<f64, Refusal> {
        let mut left = self.value_at(lookup, depth)?;
        let is_fanuc = lookup.dialect() == Dialect::Fanuc;
        let operators: &[_] = if is_fanuc {
            &FANUC_OPERATORS
        } else {
            &OPERATORS
        };
        let mut compared = false;
        loop {
            self.skip_blanks();
            let start = self.offset;
            let Some(&(name, level, apply)) = operators.iter().find(|of| self.take_operator(of.0))
            else {
                return Ok(left);
            };
            if level <= bound {
                self.offset = start;
                return Ok(left);
            }
            if is_fanuc && level == COMPARES && std::mem::replace(&mut compared, true) {
                let right = "brackets around each of them: [[#1 GT 0] AND [#2 GT 0]]";
                return refuse(start, "two comparisons in one bracket", right);
            }
            let mut right = self.operation(lookup, depth + 1, level)?;
            // A vacant value counts as 0, but is equal to another vacant one alone.
            if !matches!(name, "eq" | "ne") {
                (left, right) = (filled(left), filled(right));
            }
            left = match apply(left, right) {
                Ok(value) if value.is_finite() => value,
                Ok(_) => {
                    return refuse(start, "a result that is no number", "values within range");
                }
                Err(found) => return refuse(start, found, "values that have a result"),
            };
        }
    }

    fn take_operator(&mut self, operator: &str) -> bool {
        if operator
            .as_bytes()
            .first()
            .is_some_and(u8::is_ascii_alphabetic)
        {
            return self.take_word(operator);
        }
        let rest = self.text.get(self.offset..).unwrap_or_default();
        let is_next = rest.starts_with(operator);
        if is_next {
            self.offset += operator.len();
        }
        is_next
    }

    /// A function with its argument; ATAN has two.
    fn function(&mut self, lookup: &impl Lookup, depth: u32) -> Result<f64, Refusal> {
        let start = self.offset;
        if lookup.dialect() == Dialect::Fanuc {
            return self.fanuc_function(lookup, depth);
        }
        let Some(function) = FUNCTIONS.iter().find(|function| self.take_word(function)) else {
            let right = "a number, #parameter, [expression] or one of the functions ABS ACOS ASIN ATAN COS EXP FIX FUP LN ROUND SIN SQRT TAN EXISTS";
            return self.error(shown(self.text, start), right);
        };
        if self.next_byte() != b'[' {
            return self.unexpected("an argument in brackets, such as SIN[30]");
        }
        if *function == "exists" {
            return self.exists(lookup);
        }
        let argument = self.expression_at(lookup, depth)?;
        let value = match *function {
            "abs" => argument.abs(),
            "acos" => in_degrees(libm::acos(argument)),
            "asin" => in_degrees(libm::asin(argument)),
            "cos" => libm::cos(argument.to_radians()),
            "exp" => libm::exp(argument),
            "fix" => libm::floor(argument),
            "fup" => libm::ceil(argument),
            "ln" => libm::log(argument),
            "round" => libm::round(argument),
            "sin" => libm::sin(argument.to_radians()),
            "sqrt" => argument.sqrt(),
            "tan" => libm::tan(argument.to_radians()),
            _ => {
                if !self.take(b'/') || self.next_byte() != b'[' {
                    return self.unexpected("ATAN has two arguments: ATAN[1]/[2]");
                }
                let second = self.expression_at(lookup, depth)?;
                in_degrees(libm::atan2(argument, second))
            }
        };
        if !value.is_finite() {
            let found = format!("{} of {argument}", function.to_uppercase());
            let right = "an argument for which the function has a value";
            return refuse(start, found, right);
        }
        Ok(value)
    }
}

/// What [`PI`] leaves out of the true number.
const PI_REST: f64 = 1.224_646_799_147_353_2e-16;

/// An angle in degrees. Divided by more of π than a double holds, as LinuxCNC does: ASIN[0.5] is 30, not a bit more.
fn in_degrees(angle_rad: f64) -> f64 {
    let whole = angle_rad * 180.0;
    let quotient = whole / PI;
    let left = libm::fma(-quotient, PI, whole) - quotient * PI_REST;
    quotient + left / PI
}

/// Offset behind the comment that opens at `offset`.
pub fn comment_end(text: &str, offset: usize) -> Result<usize, Refusal> {
    let inside = text.get(offset + 1..).unwrap_or_default();
    match inside.find(['(', ')']) {
        Some(length) if inside.as_bytes().get(length) == Some(&b')') => Ok(offset + 1 + length + 1),
        Some(length) => {
            let right = "comments do not nest; close with ) first";
            refuse(offset + 1 + length, "( inside a comment", right)
        }
        None => {
            let right = "close it with ) on the same line";
            refuse(offset, "a comment that is not closed", right)
        }
    }
}

/// The number of a parameter, if a value is one.
fn number_of_parameter(value: f64) -> Option<u32> {
    let whole = value.round();
    let is_one = (value - whole).abs() <= WHOLE_WITHIN && (1.0..=5602.0).contains(&whole);
    is_one.then_some(whole as u32)
}

impl Cursor<'_> {
    /// The argument of EXISTS: `[#<name>]`.
    fn exists(&mut self, lookup: &impl Lookup) -> Result<f64, Refusal> {
        let right = "a parameter, such as EXISTS[#<depth>]";
        self.offset += 1;
        if self.next_byte() != b'#' {
            return self.unexpected(right);
        }
        self.offset += 1;
        let exists = if self.next_byte() == b'<' {
            lookup.named(&self.name()?).is_some()
        } else {
            // A number that no parameter has is one that is not there.
            let number = number_of_parameter(self.value_at(lookup, 1)?);
            number.is_some_and(|number| lookup.numbered(number).is_ok())
        };
        if !self.take(b']') {
            return self.unexpected("]");
        }
        Ok(f64::from(u8::from(exists)))
    }
}

const FUNCTIONS: [&str; 14] = [
    "abs", "acos", "asin", "atan", "cos", "exp", "fix", "fup", "ln", "round", "sin", "sqrt", "tan",
    "exists",
];

/// What an operator makes of the values at its sides, or why it has no result.
type Apply = fn(f64, f64) -> Result<f64, &'static str>;

/// Operators, each with its level (higher ones bind more closely) and what it does. An operator that begins with another one stands
/// before it.
#[rustfmt::skip] // a table
const OPERATORS: [(&str, u32, Apply); 15] = [
 ("**", 5, power),
 ("*", 4, |left, right| Ok(left * right)),
 ("/", 4, |left, right| if right == 0.0 { Err("a division by zero") } else { Ok(left / right) }),
 ("mod", 4, modulo),
 ("+", 3, |left, right| Ok(left + right)),
 ("-", 3, |left, right| Ok(left - right)),
 ("eq", 2, |left, right| truth((left - right).abs() < EQUAL_WITHIN)),
 ("ne", 2, |left, right| truth((left - right).abs() >= EQUAL_WITHIN)),
 ("gt", 2, |left, right| truth(left > right)),
 ("ge", 2, |left, right| truth(left >= right)),
 ("lt", 2, |left, right| truth(left < right)),
 ("le", 2, |left, right| truth(left <= right)),
 ("and", 1, |left, right| truth(left != 0.0 && right != 0.0)),
 ("or", 1, |left, right| truth(left != 0.0 || right != 0.0)),
 ("xor", 1, |left, right| truth((left != 0.0) != (right != 0.0))),
];

fn power(left: f64, right: f64) -> Result<f64, &'static str> {
    if left < 0.0 && right.fract() != 0.0 {
        return Err("a negative number to a power that is not whole");
    }
    Ok(libm::pow(left, right))
}

/// The rest of a division, never negative.
fn modulo(left: f64, right: f64) -> Result<f64, &'static str> {
    if right == 0.0 {
        return Err("MOD 0");
    }
    let rest = libm::fmod(left, right);
    Ok(if rest < 0.0 { rest + right.abs() } else { rest })
}

fn truth(value: bool) -> Result<f64, &'static str> {
    Ok(f64::from(u8::from(value)))
}
