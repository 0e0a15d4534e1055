//! Seeing a cell from another machine.
//!
//! A reader descends so: [`wire`] is what is reported, and what of it is believed; [`clock`] is how old it is, without trusting any
//! clock that somebody sets; [`events`] is how all events arrive in order although messages get lost; `link` (feature `zenoh`) carries it over
//! zenoh. What is shown is not here: the root package makes snapshots of its live view and fills such a view from them.
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
