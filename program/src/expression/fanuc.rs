//! Operators, functions and variables of Fanuc's language.

use super::{Apply, Cursor, Lookup, Target, WHOLE_WITHIN, in_degrees, power, truth};
use crate::refusal::{Refusal, refuse, shown};

/// Numbers nearer than this are equal for EQ and NE: what sums of decimal fractions miss.
const EQUAL_WITHIN: f64 = 1e-7;
/// The highest number of a variable in Fanuc's language.
const VARIABLE_MAX: f64 = 99_999.0;

/// The functions of Fanuc's language.
const FUNCTIONS: [&str; 16] = [
    "abs", "acos", "asin", "atan", "bcd", "bin", "cos", "exp", "fix", "fup", "ln", "pow", "round",
    "sin", "sqrt", "tan",
];

/// The level of operators that compare.
pub const COMPARES: u32 = 2;

/// The operators of Fanuc's language (B-64304EN, 16.3: "Priority of operations"): AND binds as a product, OR and XOR as a sum, each by
/// the bits of whole numbers.
#[rustfmt::skip] // a table
pub const FANUC_OPERATORS: [(&str, u32, Apply); 14] = [
 ("*", 4, |left, right| Ok(left * right)),
 ("/", 4, |left, right| if right == 0.0 { Err("a division by zero") } else { Ok(left / right) }),
 ("mod", 4, |left, right| if right == 0.0 { Err("MOD 0") } else { Ok(libm::fmod(left, right)) }),
 ("and", 4, |left, right| Ok((bits(left)? & bits(right)?) as f64)),
 ("+", 3, |left, right| Ok(left + right)),
 ("-", 3, |left, right| Ok(left - right)),
 ("or", 3, |left, right| Ok((bits(left)? | bits(right)?) as f64)),
 ("xor", 3, |left, right| Ok((bits(left)? ^ bits(right)?) as f64)),
 ("eq", COMPARES, |left, right| truth(are_equal(left, right))),
 ("ne", COMPARES, |left, right| truth(!are_equal(left, right))),
 ("gt", COMPARES, |left, right| truth(left > right)),
 ("ge", COMPARES, |left, right| truth(left >= right)),
 ("lt", COMPARES, |left, right| truth(left < right)),
 ("le", COMPARES, |left, right| truth(left <= right)),
];

/// The bits of a whole number.
fn bits(value: f64) -> Result<i64, &'static str> {
    let whole = libm::round(value);
    match whole.abs() < 4_294_967_296.0 {
        true => Ok(whole as i64),
        false => Err("AND, OR or XOR of a number above 32 bits"),
    }
}

/// Whether two values of Fanuc's language are equal: a vacant one to another vacant one alone.
fn are_equal(left: f64, right: f64) -> bool {
    match (left.is_nan(), right.is_nan()) {
        (false, false) => (left - right).abs() < EQUAL_WITHIN,
        (left, right) => left && right,
    }
}

impl Cursor<'_> {
    /// A function of Fanuc's language with its argument (B-64304EN, 16.3 "Arithmetic and logic operation"). Its name may be cut to two
    /// letters or more.
    pub(super) fn fanuc_function(
        &mut self,
        lookup: &impl Lookup,
        depth: u32,
    ) -> Result<f64, Refusal> {
        let start = self.offset;
        let mut name = String::new();
        while self.next_byte().is_ascii_alphabetic() && name.len() <= 5 {
            name.push(self.peek().into());
            self.offset += 1;
        }
        let mut functions = FUNCTIONS.iter();
        let function = functions.find(|of| name.len() >= 2 && of.starts_with(&name));
        let Some(function) = function else {
            self.offset = start;
            let right = "a number, #variable, [expression] or one of the functions ABS ACOS ASIN ATAN BCD BIN COS EXP FIX FUP LN POW ROUND SIN SQRT TAN";
            return self.error(shown(self.text, start), right);
        };
        if self.next_byte() != b'[' {
            return self.unexpected("an argument in brackets, such as SIN[30]");
        }
        self.offset += 1;
        let argument = filled(self.operation(lookup, depth, 0)?);
        // The second argument of ATAN[1,2] and POW[1,2].
        let mut second = None;
        if matches!(*function, "atan" | "pow") && self.take(b',') {
            second = Some(filled(self.operation(lookup, depth, 0)?));
        }
        if !self.take(b']') {
            return self.unexpected("an operator (+ - * / MOD EQ NE GT GE LT LE AND OR XOR) or ]");
        }
        if *function == "atan" && second.is_none() && self.take(b'/') {
            if self.next_byte() != b'[' {
                return self.unexpected("ATAN has two arguments: ATAN[1]/[2]");
            }
            second = Some(filled(self.expression_at(lookup, depth)?));
        }
        let value = match (*function, second) {
            ("abs", _) => argument.abs(),
            ("acos", _) => in_degrees(libm::acos(argument)),
            ("asin", _) => in_degrees(libm::asin(argument)),
            ("atan", Some(second)) => in_degrees(libm::atan2(argument, second)),
            ("atan", None) => in_degrees(libm::atan(argument)),
            ("bcd", _) => bcd_of(argument),
            ("bin", _) => binary_of(argument),
            ("cos", _) => libm::cos(argument.to_radians()),
            ("exp", _) => libm::exp(argument),
            ("fix", _) => libm::trunc(argument),
            ("fup", _) => libm::ceil(argument.abs()).copysign(argument),
            ("ln", _) => libm::log(argument),
            ("pow", Some(second)) => power(argument, second).unwrap_or(f64::NAN),
            ("round", _) => libm::round(argument),
            ("sin", _) => libm::sin(argument.to_radians()),
            ("sqrt", _) => argument.sqrt(),
            ("tan", _) => libm::tan(argument.to_radians()),
            _ => f64::NAN,
        };
        if !value.is_finite() {
            let found = format!("{} of {argument}", function.to_uppercase());
            let right = "an argument for which the function has a value";
            return refuse(start, found, right);
        }
        Ok(value)
    }
}

/// A value, 0 in place of a vacant one.
pub fn filled(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value }
}

/// The variable of a number, in Fanuc's language.
pub fn variable(value: f64) -> Result<Target, Refusal> {
    let whole = filled(value).round();
    if (filled(value) - whole).abs() <= WHOLE_WITHIN && (0.0..=VARIABLE_MAX).contains(&whole) {
        return Ok(Target::Numbered(whole as u32));
    }
    refuse(
        0,
        format!("variable #{value}"),
        "a whole number from 0 to 99999",
    )
}

/// A whole number as binary-coded decimals: 12 is 0x12, 18.
fn bcd_of(value: f64) -> f64 {
    if !(0.0..=99_999_999.0).contains(&value) {
        return f64::NAN;
    }
    let (mut left, mut coded, mut shift) = (value as u64, 0u64, 0);
    while left > 0 {
        coded |= (left % 10) << shift;
        left /= 10;
        shift += 4;
    }
    coded as f64
}

/// The other way round.
fn binary_of(value: f64) -> f64 {
    if !(0.0..=f64::from(u32::MAX)).contains(&value) {
        return f64::NAN;
    }
    let (mut left, mut number, mut factor) = (value as u64, 0u64, 1);
    while left > 0 {
        if left & 15 > 9 {
            return f64::NAN;
        }
        number += (left & 15) * factor;
        left >>= 4;
        factor *= 10;
    }
    number as f64
}
