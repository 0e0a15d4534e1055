//! Files of the repository that are made from the program.

use std::fs;
use std::path::Path;

/// A file, by its path in the repository, has the text that the program makes. With `RENEW=1` it is written.
pub fn assert_fresh(path: &str, text: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    if std::env::var_os("RENEW").is_some() {
        fs::write(&file, text).unwrap_or_else(|e| panic!("{path}: {e}"));
    }
    let found = fs::read_to_string(&file).unwrap_or_default();
    let krate = env!("CARGO_PKG_NAME");
    assert!(
        found == text,
        "{path} is not what the keys in the code say. Write it again: RENEW=1 cargo test --release -p {krate} reference"
    );
}
