//! Codes of words, as ten times their number: G33.1 is 331.

/// The number of a code as it is written.
pub fn shown_code(number: u32) -> String {
    if number.is_multiple_of(10) {
        (number / 10).to_string()
    } else {
        format!("{}.{}", number / 10, number % 10)
    }
}

/// An enum of G-codes with their numbers: found by its number, and shown as it is written.
macro_rules! g_codes {
    ($(#[$doc:meta])* pub enum $name:ident { $($(#[$of:meta])* $code:ident = $number:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name { $($(#[$of])* $code = $number,)+ }

        impl $name {
            /// The one with this number.
            pub fn of_code(number: u32) -> Option<Self> {
                let all = [$(Self::$code),+];
                all.into_iter().find(|code| *code as u32 == number)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(formatter, "G{}", $crate::codes::shown_code(*self as u32))
            }
        }
    };
}

pub(crate) use g_codes;
