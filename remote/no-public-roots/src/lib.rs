//! No public certificate authority.
//!
//! zenoh's client trusts the authorities of the web beside the one that it is told to trust: whoever has a certificate of the web for
//! the controller's name could then say "held" in its place. There is no setting against it, so its list is this one.

/// Nobody.
pub const TLS_SERVER_ROOTS: &[pki_types::TrustAnchor<'static>] = &[];
