//! Seeds of `quadrant-lab bench faults`, a few in each run of the tests; more with `SEEDS=5000 cargo test -p lab --test all seeds::`, one and
//! all of it with `FROM=17 SEEDS=1 VERBOSE=1`.

use std::path::PathBuf;

use lab::options::{FaultsOptions, SeedOptions};

use crate::size;

#[test]
fn no_seed_violates_an_invariant_or_hangs() {
    let options = FaultsOptions {
        machine: PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../machines/xy"),
        seeds: size::number("SEEDS", 20, 60),
        of: SeedOptions {
            from: size::number("FROM", 1, 1),
            part: lab::bench::PartOf::WHOLE,
            lines: None,
            jobs: 2,
        },
        program: None,
        verbose: std::env::var_os("VERBOSE").is_some(),
    };
    let outcome = lab::bench::faults(&options);
    assert!(outcome.is_ok(), "{outcome:?}");
}
