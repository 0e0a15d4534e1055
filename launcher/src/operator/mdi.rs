//! `mdi`: typed-in blocks run as a small program of their own; the program that was loaded before is loaded again after it.

use std::fs;
use std::path::Path;

use anyhow::anyhow;
use bus::sample::{Cause, Feedback, Mode, OperatorRequest, Order, ProgramState, Refused};

use super::Client;
use super::client::order_urgently;
use super::eyes::Eyes;
use super::program::{Laid, check, started, until_done, until_read};
use crate::exit::{Failure, Kind, Outcome, words};
use crate::options::MdiOptions;
use crate::output::say;
use crate::signals::Signals;

/// Its name in the cell, in run directories and in messages.
const NAME: &str = "mdi.ngc";

/// `mdi`.
pub fn mdi(options: &MdiOptions) -> Outcome {
    let client = Client::to_order(options.to.cell.as_deref())?;
    let text = options.blocks.join("\n");
    let mut says = |words: &str| client.say(words);
    let block = Block::of(&client, &text, &mut says)?;
    if options.no_wait {
        return Ok(());
    }
    let signals = Signals::catch().environment()?;
    if block.until_done(&client, &|| signals.count() > 0)? {
        client.say("done");
        return Ok(());
    }
    // As a program that is held: it waits where it is.
    say(&order_urgently(
        Some(client.cell.place.name()),
        Order::Hold,
    )?);
    client.say("the block is in hold: `quadrant resume` goes on with it; `quadrant stop`, then `load` discards it");
    Err(Failure::Interrupted)
}

/// The same from a view: `says` hears when it has begun.
///
/// # Errors
/// It is refused, wrong, or was stopped.
pub fn mdi_in(cell: &str, text: &str, mut says: impl FnMut(&str)) -> Result<String, Failure> {
    let client = Client::find(Some(cell), "mdi")?;
    let block = Block::of(&client, text, &mut says)?;
    block.until_done(&client, &|| false)?;
    Ok(format!("done: {text}"))
}

/// Blocks that have been started.
struct Block {
    run: u32,
    /// The program that was loaded before.
    earlier: Option<Laid>,
}

impl Block {
    /// Starts these blocks.
    fn of(client: &Client, text: &str, says: &mut dyn FnMut(&str)) -> Result<Block, Failure> {
        if text.trim().is_empty() {
            return Err(Failure::Input(anyhow!(
                "mdi: no block: `quadrant mdi \"G0 X10\"`"
            )));
        }
        let mut eyes = Eyes::open(client)?;
        let now = eyes.look()?;
        if let Some(why) = why_not(&now) {
            return Err(client.fails(&format!("mdi refused: {}", why.words())));
        }
        let written = Written::of(&client.cell.place.folder(), text)?;
        let (notes, _) = check(client, &written.file, &now)
            .map_err(|error| Failure::Input(anyhow!(written.of_blocks(&words(&error)))))?;
        for note in &notes {
            says(&written.of_blocks(note));
        }
        let mut laid = Laid::down(client, now.load, NAME, &written.file)?;
        let mut earlier = match ProgramState::from_wire(now.program) {
            Some(ProgramState::Loaded | ProgramState::Done) => {
                Laid::again(client, laid.number, now.load)?
            }
            _ => None,
        };
        laid.load(client, true)?;
        until_read(&mut eyes, laid.number, NAME)?;
        let request = OperatorRequest {
            order: Order::Start as u32,
            session: laid.number,
            ..OperatorRequest::default()
        };
        let answer = match client.ask(Order::Start, request) {
            Ok(answer) => answer,
            Err(failure) => {
                load_again(client, &mut eyes, &mut earlier)?;
                return Err(failure);
            }
        };
        says(&started(client, &answer, laid.number).0);
        Ok(Block {
            run: answer.run,
            earlier,
        })
    }

    /// Waits until they are done, then loads the program from before again; false if it was interrupted.
    fn until_done(mut self, client: &Client, is_over: &dyn Fn() -> bool) -> Result<bool, Failure> {
        let mut eyes = Eyes::open(client)?;
        let done = until_done(client, &mut eyes, self.run, is_over);
        // Blocks that have given themselves up leave the machine ready for what comes next, as those that are done.
        let has_given_up = |now: Feedback| now.cause == Cause::Abort as u32;
        let leaves =
            matches!(done, Ok(Some(_))) || done.is_err() && eyes.look().is_ok_and(has_given_up);
        if !leaves {
            return done.map(|_| false);
        }
        load_again(client, &mut eyes, &mut self.earlier)?;
        done.map(|_| true)
    }
}

fn load_again(
    client: &Client,
    eyes: &mut Eyes<'_>,
    earlier: &mut Option<Laid>,
) -> Result<(), Failure> {
    let Some(mut earlier) = earlier.take() else {
        return Ok(());
    };
    earlier.load(client, true)?;
    until_read(eyes, earlier.number, "the program from before")
}

/// Why no block can run now.
fn why_not(now: &Feedback) -> Option<Refused> {
    if now.program == ProgramState::Running as u32 {
        return Some(Refused::Running);
    }
    if now.program == ProgramState::Loading as u32 {
        return Some(Refused::Loading);
    }
    match Mode::from_wire(now.mode) {
        Some(Mode::Ready) => None,
        Some(Mode::Disabled) => Some(Refused::DrivesOff),
        Some(Mode::Tripped) => Some(Refused::Tripped),
        Some(Mode::Jogging) => Some(Refused::Jogging),
        _ => Some(Refused::NotAtRest),
    }
}

/// The blocks as a program; taken away again.
struct Written {
    file: std::path::PathBuf,
}

impl Written {
    fn of(folder: &Path, text: &str) -> Result<Written, Failure> {
        let folder = folder.join(format!("mdi-{}", std::process::id()));
        fs::create_dir_all(&folder).environment()?;
        let written = Written {
            file: folder.join(NAME),
        };
        fs::write(&written.file, format!("{text}\n%\n")).environment()?;
        Ok(written)
    }

    /// A message of the program, as one of the typed-in blocks.
    fn of_blocks(&self, message: &str) -> String {
        message.replace(&self.file.display().to_string(), "mdi")
    }
}

impl Drop for Written {
    fn drop(&mut self) {
        if let Some(folder) = self.file.parent() {
            let _ = fs::remove_dir_all(folder);
        }
    }
}
