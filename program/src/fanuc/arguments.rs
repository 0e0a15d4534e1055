//! The words of a macro call, as its local variables (B-64304EN, 16.7.1 "Simple call (G65)": argument specification I and II).

use crate::reader::Word;
use crate::refusal::{Refusal, refuse};

/// #1 to #33 are local to a call.
pub const LOCALS: usize = 33;

/// The letters that are arguments, each with its variable.
const NUMBERS: [(char, usize); 21] = [
    ('A', 1),
    ('B', 2),
    ('C', 3),
    ('I', 4),
    ('J', 5),
    ('K', 6),
    ('D', 7),
    ('E', 8),
    ('F', 9),
    ('H', 11),
    ('M', 13),
    ('Q', 17),
    ('R', 18),
    ('S', 19),
    ('T', 20),
    ('U', 21),
    ('V', 22),
    ('W', 23),
    ('X', 24),
    ('Y', 25),
    ('Z', 26),
];

/// The local variables of a call by the words behind it; P and L are the call's own. A second I, J or K, or one out of their order,
/// begins the next three of argument specification II: #4 to #6, #7 to #9, … #31 to #33.
pub fn arguments(words: &[Word]) -> Result<[Option<f64>; LOCALS], Refusal> {
    let mut locals = [None; LOCALS];
    let (mut set, mut last) = (0, None);
    for word in words
        .iter()
        .filter(|word| !matches!(word.letter, 'P' | 'L'))
    {
        let Some(&(letter, mut number)) = NUMBERS.iter().find(|of| of.0 == word.letter) else {
            return word.refuse("the arguments of a macro are A to F, H to K, M and Q to Z");
        };
        if matches!(letter, 'I' | 'J' | 'K') {
            if last.is_some_and(|last| last >= letter) {
                set += 1;
            }
            last = Some(letter);
            number += 3 * set;
        }
        let Some(slot) = locals.get_mut(number - 1) else {
            return refuse(
                word.offset,
                "I, J and K more than ten times",
                "fewer of them",
            );
        };
        *slot = Some(word.value);
    }
    Ok(locals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_become_variables_by_both_tables() {
        let word = |(letter, value)| Word {
            letter,
            value,
            offset: 0,
        };
        let of = |words: &[(char, f64)]| {
            arguments(&words.iter().copied().map(word).collect::<Vec<_>>()).unwrap()
        };
        let locals = of(&[
            ('P', 9010.0),
            ('A', 1.0),
            ('Z', 2.0),
            ('J', 3.0),
            ('K', 4.0),
        ]);
        assert_eq!(
            [locals[0], locals[25], locals[4], locals[5]],
            [1.0, 2.0, 3.0, 4.0].map(Some)
        );
        assert_eq!(locals.iter().flatten().count(), 4);
        let locals = of(&[('I', 1.0), ('J', 2.0), ('I', 3.0), ('K', 4.0), ('J', 5.0)]);
        assert_eq!([locals[3], locals[4], locals[6]], [1.0, 2.0, 3.0].map(Some));
        assert_eq!([locals[8], locals[10]], [4.0, 5.0].map(Some));
        assert!(arguments(&[word(('O', 1.0))]).is_err());
        let many = vec![word(('I', 1.0)); 11];
        assert!(arguments(&many).is_err());
        assert!(arguments(&many[..10]).is_ok());
    }
}
