//! `mdi`: typed-in blocks run as a small program of their own; the cell has the program from before again after it.

use std::borrow::Cow;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use bus::sample::{Cause, Feedback, Mode, Order, ProgramState, Refused};

use super::Client;
use super::client::order_urgently;
use super::eyes::Eyes;
use super::program::{
    LOOK, Laid, READ_LIMIT, check, folder_of, started_words, until_done, until_read,
};
use crate::options::MdiOptions;
use console::exit::{Failure, Kind, Outcome, words};
use console::output::say;
use console::signals::Signals;

/// Its name in the cell, in run directories and in messages.
const NAME: &str = "mdi.ngc";
/// The cell gives up blocks that have stopped or tripped within this time.
const GIVEN_UP_WITHIN: Duration = Duration::from_secs(2);

/// `mdi`.
pub fn mdi(options: &MdiOptions) -> Outcome {
    let client = Client::to_order(options.to.cell.as_deref())?;
    let text = options.blocks.join("\n");
    if options.no_wait {
        let mut says = |words: &str| client.say(words);
        return Block::of(&client, "mdi", &text, &mut says).map(|_| ());
    }
    run(&client, "mdi", &text)
}

/// Runs blocks of a command of this name, and waits until they are done; Ctrl-C holds them.
pub(super) fn run(client: &Client, command: &str, text: &str) -> Outcome {
    // Before the cell has the block: it begins by itself, and Ctrl-C holds it from then on.
    let signals = Signals::catch().environment()?;
    let block = Block::of(client, command, text, &mut |words| client.say(words))?;
    if block.until_done(client, &|| signals.count() > 0)? {
        client.say("done");
        return Ok(());
    }
    // As a program that is held: it waits where it is.
    say(&order_urgently(
        Some(client.cell.place.name()),
        Order::Hold,
    )?);
    client.say(
        "the block is in hold: `quadrant resume` goes on with it; `quadrant stop` gives it up",
    );
    Err(Failure::Interrupted)
}

/// The same from a view: `says` hears when it has begun.
///
/// # Errors
/// It is refused, wrong, or was stopped.
pub fn mdi_in(cell: &str, text: &str, mut says: impl FnMut(&str)) -> Result<String, Failure> {
    let client = Client::find(Some(cell), "mdi")?;
    let block = Block::of(&client, "mdi", text, &mut says)?;
    block.until_done(&client, &|| false)?;
    Ok(format!("done: {text}"))
}

/// Blocks that the cell has taken.
struct Block {
    load: u32,
    run: u32,
    /// Number under which the program from before is read again behind them; 0 where none was loaded.
    before: u32,
}

impl Block {
    /// Has the cell take these blocks of a command, and waits until they have begun.
    fn of(
        client: &Client,
        command: &str,
        text: &str,
        says: &mut dyn FnMut(&str),
    ) -> Result<Block, Failure> {
        if text.trim().is_empty() {
            return Err(Failure::Input(anyhow!(
                "mdi: no block: `quadrant mdi \"G0 X10\"`"
            )));
        }
        let mut eyes = Eyes::open(client)?;
        let now = eyes.look()?;
        if let Some(why) = why_not(&now) {
            return Err(client.fails(&format!("{command} refused: {}", why.words())));
        }
        let written = Written::of(&client.cell.place.folder(), text)?;
        let checked = check(client, &written.file, None, &now)
            .map_err(|error| Failure::Input(anyhow!(written.of_blocks(command, &words(&error)))))?;
        for note in &checked.notes {
            says(&written.of_blocks(command, note));
        }
        let mut laid = Laid::down(client, now.load, NAME, &written.file, None)?;
        let mut before = match ProgramState::from_wire(now.program) {
            Some(ProgramState::Loaded | ProgramState::Done) => {
                Laid::again(client, laid.number, now.load)?
            }
            _ => None,
        };
        let answer = laid.load_typed(client, &now, before.as_mut(), checked.ends_by_word)?;
        let block = Block {
            load: laid.number,
            run: answer.run + 1,
            before: before.map_or(0, |before| before.number),
        };
        block.until_begun(&mut eyes)?;
        let folder = folder_of(client, block.run, Path::new(NAME));
        says(&started_words(
            block.run,
            answer.hold == 1,
            folder.as_deref(),
        ));
        Ok(block)
    }

    /// Whether nothing else was loaded since.
    fn is_latest(&self, now: &Feedback) -> bool {
        now.load <= self.load || now.load == self.before
    }

    /// Whether the cell has taken it and is done with it, one way or another.
    fn is_over(&self, now: &Feedback) -> bool {
        now.load > self.load || now.load == self.load && now.program == ProgramState::None as u32
    }

    /// Waits until they have begun: the cell sees to that.
    fn until_begun(&self, eyes: &mut Eyes<'_>) -> Result<(), Failure> {
        let asked = Instant::now();
        loop {
            let now = eyes.look()?;
            if now.run >= self.run && now.load >= self.load {
                return Ok(());
            }
            let why = if !self.is_latest(&now) {
                Cow::Borrowed("another program was loaded meanwhile")
            } else if !self.is_over(&now) && asked.elapsed() <= READ_LIMIT {
                std::thread::sleep(LOOK);
                continue;
            } else if now.cause == Cause::Planner as u32 {
                let reason = eyes.planners_reason(&now);
                format!("the planner refuses the blocks: {reason}").into()
            } else if self.is_over(&now) {
                "the blocks were not begun: the machine was no longer ready for them".into()
            } else {
                "the planner has not read the blocks; it is still at it".into()
            };
            return Err(Failure::Stopped(anyhow!("{why}")));
        }
    }

    /// Waits until they are done, and the cell has the program from before again; false if it was interrupted.
    fn until_done(
        self,
        client: &Client,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<bool, Failure> {
        let mut eyes = Eyes::open(client)?;
        let done = until_done(client, &mut eyes, self.run, is_interrupted);
        if matches!(done, Ok(None)) {
            return Ok(false);
        }
        let ended = Instant::now();
        while !self.is_over(&eyes.look()?) && ended.elapsed() < GIVEN_UP_WITHIN {
            std::thread::sleep(LOOK);
        }
        if self.before != 0
            && eyes.look()?.load == self.before
            && let Err(failure) = until_read(&mut eyes, self.before, "the program from before")
        {
            match failure {
                // The blocks are done all the same.
                Failure::Stopped(why) => client.say(&words(&why)),
                failure => return Err(failure),
            }
        }
        done.map(|_| true)
    }
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
    fn of_blocks(&self, command: &str, message: &str) -> String {
        message.replace(&self.file.display().to_string(), command)
    }
}

impl Drop for Written {
    fn drop(&mut self) {
        if let Some(folder) = self.file.parent() {
            let _ = fs::remove_dir_all(folder);
        }
    }
}
