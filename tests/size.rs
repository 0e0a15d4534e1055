//! How much of a heavy test runs: by default as much as shows each kind of fault that it was written for, with `QUADRANT_TESTS=full` in the
//! environment all of it (`quadrant-lab suite --full`; docs/developers/tests.md). Every crate's tests share this file.

/// Whether all of it is to run.
pub fn is_full() -> bool {
    match std::env::var("QUADRANT_TESTS").as_deref() {
        Err(_) => false,
        Ok("full") => true,
        Ok(other) => panic!("QUADRANT_TESTS={other}: must be full"),
    }
}

/// A number that a test goes by: what the environment has under this name, else the default one or the full one.
pub fn number(name: &str, default: u64, full: u64) -> u64 {
    match std::env::var(name) {
        Ok(text) => text
            .parse()
            .unwrap_or_else(|_| panic!("{name}={text}: must be a whole number")),
        Err(_) if is_full() => full,
        Err(_) => default,
    }
}

/// Of these cases the first of each so many, in full all.
pub fn one_in<T>(cases: usize, all: impl IntoIterator<Item = T>) -> Vec<T> {
    all.into_iter()
        .step_by(if is_full() { 1 } else { cases })
        .collect()
}

/// Whether a test that has no small size is left out; says so.
pub fn is_left_out() -> bool {
    if !is_full() {
        eprintln!("left out: runs with QUADRANT_TESTS=full alone");
    }
    !is_full()
}
