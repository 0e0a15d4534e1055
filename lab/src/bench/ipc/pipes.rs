//! A byte to each and one back, through pipes.

use std::io::{Read as _, Write as _};
use std::process::{Child, ChildStdin, ChildStdout};

use anyhow::Context;

/// The master's ends.
pub(super) struct Pipes {
    to: Vec<ChildStdin>,
    from: Vec<ChildStdout>,
}

impl Pipes {
    /// Of processes that read their standard input and write to their standard output.
    pub fn of(children: &mut [Child]) -> anyhow::Result<Pipes> {
        let mut pipes = Pipes {
            to: Vec::new(),
            from: Vec::new(),
        };
        for child in children {
            pipes.to.push(child.stdin.take().context("no pipe")?);
            pipes.from.push(child.stdout.take().context("no pipe")?);
        }
        Ok(pipes)
    }

    /// Once to everybody and back.
    pub fn round_trip(&mut self) -> anyhow::Result<()> {
        for to in &mut self.to {
            to.write_all(&[1])?;
        }
        for from in &mut self.from {
            from.read_exact(&mut [0])?;
        }
        Ok(())
    }
}

/// The other side, until the pipe is closed or it is told to end.
pub(super) fn answer(is_over: impl Fn() -> bool) -> anyhow::Result<()> {
    // Not through a buffer of lines.
    let (input, output) = (rustix::stdio::stdin(), rustix::stdio::stdout());
    while !is_over() {
        match rustix::io::read(input, &mut [0]) {
            Ok(0) => return Ok(()),
            Ok(_) => {
                rustix::io::write(output, &[1])?;
            }
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
