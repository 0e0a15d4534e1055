//! A program that is read block by block: what its blocks make comes in pieces, and what was taken away is not kept.

use std::path::Path;
use std::sync::Arc;

use machine::{KeptParameters, Tool};
use path::geometry::AxisVector;

use crate::error::ProgramError;
use crate::execution::Execution;
use crate::file::{open_text, text_hash};
use crate::meaning::Modal;
use crate::program::{Note, Piece, ProgramEnd, Setup, in_dialect, source_hash};
use crate::question::{Answer, Question};
use crate::route::Bound;
use crate::setup::check_setup;
use crate::snapshot;
use crate::source::Source;
use crate::text::{Text, TextHash, hash_of};

/// The most elements of one block.
const BLOCK_ELEMENTS_MAX: u64 = 200_000;
/// With so many elements a piece is long enough: a block may make many.
pub(crate) const PIECE_ELEMENTS: u64 = 10_000;

/// A program that is being read.
///
/// It holds the state of its interpreter and a small part of the text, whatever the length of the program. The first mistake ends it.
#[derive(Debug, Clone)]
pub struct Reading {
    name: String,
    source_hash: u64,
    execution: Execution,
    over: Option<Result<ProgramEnd, ProgramError>>,
}

/// How far a program was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// There may be more.
    More,
    /// It asks the machine: [`Reading::question`] says what, and nothing more comes before [`Reading::answer`].
    Asks,
    /// It is at its end.
    Ended(ProgramEnd),
}

impl Reading {
    /// Reads a text in memory, for a machine that is at rest at `start` (machine coordinates). `name` is shown in errors.
    ///
    /// # Errors
    /// A machine on which no program can run.
    pub fn of_text(
        name: &str,
        text: &str,
        setup: &Arc<Setup>,
        start: AxisVector,
    ) -> Result<Reading, ProgramError> {
        check_setup(name, setup, &start)?;
        let text = Text::of(text);
        let hash = text.hash().unwrap_or(hash_of(&[]));
        Ok(Self::of(name, text, hash, setup, start))
    }

    /// Reads a file, a small part of it at a time.
    ///
    /// # Errors
    /// What is no regular file or cannot be read, and a machine on which no program can run.
    pub fn open(
        file: &Path,
        setup: &Arc<Setup>,
        start: AxisVector,
    ) -> Result<Reading, ProgramError> {
        let name = file.display().to_string();
        check_setup(&name, setup, &start)?;
        let text = open_text(file)?;
        let hash = text_hash(file, &text)?;
        Ok(Self::of(&name, text, hash, setup, start))
    }

    fn of(name: &str, text: Text, hash: TextHash, setup: &Arc<Setup>, start: AxisVector) -> Self {
        let setup = &in_dialect(setup, text.dialect());
        let mut execution = Execution::new(Source::new(text, setup.dialect), setup, start);
        execution.interpreter.route.output.bound = Bound::Block {
            most: BLOCK_ELEMENTS_MAX,
            before: 0,
        };
        execution.looks_bit_by_bit = true;
        Self {
            name: name.to_owned(),
            source_hash: source_hash(hash, setup, &start),
            execution,
            over: None,
        }
    }

    /// Does at most so many lines more, fewer if they make many elements, and appends what they make to `piece`. Behind the end, or an
    /// error, nothing more comes.
    ///
    /// Before the first block that may go on elsewhere, the text is looked through for labels, once: some of it in the place of each
    /// block.
    ///
    /// # Errors
    /// The first mistake of the program; `piece` then holds everything that stands before the block that is refused.
    pub fn read(&mut self, blocks_max: usize, piece: &mut Piece) -> Result<Progress, ProgramError> {
        if let Some(over) = &self.over {
            return over.clone().map(Progress::Ended);
        }
        let output = &mut self.execution.interpreter.route.output.piece;
        // What an answer has made since.
        piece.elements.append(&mut output.elements);
        std::mem::swap(output, piece);
        let enough = self.elements_made() + PIECE_ELEMENTS;
        for _ in 0..blocks_max {
            if self.execution.interpreter.asked().is_some() {
                break;
            }
            self.over = self.line().transpose();
            if self.over.is_some() || self.elements_made() >= enough {
                break;
            }
        }
        let output = &mut self.execution.interpreter.route.output.piece;
        std::mem::swap(output, piece);
        match &self.over {
            Some(over) => over.clone().map(Progress::Ended),
            None if self.question().is_some() => Ok(Progress::Asks),
            None => Ok(Progress::More),
        }
    }

    /// What the program asks now, if it does. It stays so in a copy of this reading.
    pub fn question(&self) -> Option<&Question> {
        self.execution.interpreter.asked()
    }

    /// How many answers it has had.
    pub fn answers_taken(&self) -> usize {
        self.execution.interpreter.answers_taken()
    }

    /// What the machine answers; the program can be read on.
    ///
    /// # Errors
    /// It has not asked that, or cannot go on with this answer: the program ends here.
    pub fn answer(&mut self, answer: Answer) -> Result<(), ProgramError> {
        let result = self.execution.answer(&self.name, answer);
        if let Err(error) = &result {
            self.over = Some(Err(error.clone()));
        }
        result
    }

    /// Does a line; how the program ends if it does.
    fn line(&mut self) -> Result<Option<ProgramEnd>, ProgramError> {
        let output = &mut self.execution.interpreter.route.output;
        let mark = output.mark();
        output.begin_block();
        let ends = self.execution.does_line();
        self.execution.check_made();
        self.execution.refused(&self.name).inspect_err(|_| {
            self.execution.interpreter.route.output.take_back(&mark);
        })?;
        if !ends {
            return Ok(None);
        }
        self.execution.finish(&self.name)?;
        self.execution.interpreter.note_open();
        Ok(Some(self.execution.end))
    }

    /// What the interpreter knows between two blocks, for going on here in another process: some kB. Of a program that asks something
    /// there is none: whoever goes on asks itself.
    pub fn snapshot(&self) -> Vec<u8> {
        if self.question().is_some() {
            return Vec::new();
        }
        snapshot::pack(self.source_hash, &(&self.execution, &self.over))
    }

    /// Goes on from a snapshot of the same program on the same machine, with the same start.
    ///
    /// # Errors
    /// A snapshot that is damaged, or of something else; the reading is as it was then.
    pub fn resume(&mut self, snapshot: &[u8]) -> Result<(), ProgramError> {
        type Kept = (Execution, Option<Result<ProgramEnd, ProgramError>>);
        let (mut execution, over): Kept = snapshot::unpack(&self.name, self.source_hash, snapshot)?;
        execution
            .complete(&self.execution)
            .map_err(|error| ProgramError::of_text(&self.name, error))?;
        self.execution = execution;
        self.over = over;
        Ok(())
    }

    /// Its name, its hash and what does it.
    pub(crate) fn into_parts(self) -> (String, u64, Execution) {
        (self.name, self.source_hash, self.execution)
    }

    /// Hash of everything that the geometry depends on: text, axes, work offset, tools, start. Names it in path tags.
    pub fn source_hash(&self) -> u64 {
        self.source_hash
    }

    /// The parameters that outlive the run, as the blocks that were read so far leave them.
    pub fn kept_parameters(&self) -> KeptParameters {
        self.execution.interpreter.kept_parameters()
    }

    /// The modes that the next run begins with, as the words of a block.
    pub fn modes_left(&self) -> String {
        self.execution.interpreter.modes_left()
    }

    /// The state that the blocks that were read so far leave.
    pub fn modal(&self) -> Modal {
        self.execution.interpreter.modal()
    }

    /// The tools, as the blocks that were read so far leave them.
    pub fn tools(&self) -> &[Tool] {
        &self.execution.interpreter.state().tools().table
    }

    /// The line that was read last, counted from 1.
    pub fn line_read(&self) -> u32 {
        self.execution.interpreter.line
    }

    /// How many elements were made since the program's first block.
    pub fn elements_made(&self) -> u64 {
        self.execution.interpreter.route.output.elements_made()
    }

    /// What was accepted with a remark so far; one per kind, in the order of their first lines.
    pub fn notes(&self) -> Vec<Note> {
        self.execution.interpreter.route.output.notes.by_line()
    }
}
