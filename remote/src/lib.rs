//! Seeing a cell from another machine.
//!
//! A reader descends so: [`state`] is what is shown of a cell; [`wire`] is what is reported of it, and what of that is believed;
//! [`clock`] is how old it is, without trusting any clock that somebody sets; [`events`] is how all events arrive in order although
//! messages get lost; `link` (feature `zenoh`) carries it over zenoh. Who makes the state and who shows it is `view`.
//!
//! **Invariant**: nothing here is known to the cell. The server is an observer like any other. Orders travel on a way of their own
//! (`orders`), which is closed unless somebody opens it with certificates.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod clock;
pub mod events;
#[cfg(feature = "zenoh")]
pub mod link;
#[cfg(feature = "zenoh")]
pub mod orders;
pub mod state;
pub mod wire;
