//! Kinds that travel as numbers, declared once: number, meaning and words of each side by side.

/// An enum of numbers that stay what they are: `ALL` of it in its order, and `from_wire`. With a function behind it, each kind also has
/// its words, which that function gives.
macro_rules! wire_enum {
    (
        $(#[$of_enum:meta])*
        pub enum $name:ident { $($(#[$of_kind:meta])* $kind:ident = $number:expr,)+ }
    ) => {
        $(#[$of_enum])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u32)]
        pub enum $name { $($(#[$of_kind])* $kind = $number,)+ }

        impl $name {
            /// All of them.
            pub const ALL: [$name; [$($name::$kind),+].len()] = [$($name::$kind),+];

            /// Decodes what came over the wire.
            pub fn from_wire(value: u32) -> Option<$name> {
                Self::ALL.into_iter().find(|kind| *kind as u32 == value)
            }
        }
    };
    (
        $(#[$of_enum:meta])*
        pub enum $name:ident { $($(#[$of_kind:meta])* $kind:ident = $number:expr => $words:expr,)+ }
        $(#[$of_words:meta])*
        pub fn $give:ident
    ) => {
        wire_enum! { $(#[$of_enum])* pub enum $name { $($(#[$of_kind])* $kind = $number,)+ } }

        impl $name {
            $(#[$of_words])*
            pub fn $give(self) -> &'static str {
                match self {
                    $($name::$kind => $words,)+
                }
            }
        }
    };
}
