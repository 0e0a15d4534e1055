//! The source that the command line names.

use console::exit::Failure;

use super::feed::Feed;
use super::source::Source;
use crate::options::CellOptions;

/// The source that the command line names.
///
/// # Errors
/// No cell runs; or, of another machine, nobody answers there.
pub fn of(to: &CellOptions) -> Result<Box<dyn Source>, Failure> {
    let cell = to.cell.as_deref();
    match &to.remote {
        None => Ok(Box::new(Feed::attach(cell)?)),
        Some(server) => remote(server, cell),
    }
}

#[cfg(feature = "remote")]
fn remote(server: &str, cell: Option<&str>) -> Result<Box<dyn Source>, Failure> {
    Ok(Box::new(super::remote_feed::RemoteFeed::attach(
        server, cell,
    )?))
}

#[cfg(not(feature = "remote"))]
fn remote(server: &str, _cell: Option<&str>) -> Result<Box<dyn Source>, Failure> {
    Err(Failure::Input(anyhow::anyhow!(
        "--remote {server}: this quadrant was built without it: cargo build --release --features remote (docs/howto/remote.md)"
    )))
}
