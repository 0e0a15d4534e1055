//! The token of the page: whoever has it may give orders.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;

use anyhow::{Context, bail};
use bus::files::open_to_read;

/// Variable in which the launcher gives it to the page's process: nobody but the same user can read that of a process.
pub const TOKEN_VARIABLE: &str = "QUADRANT_WEB_TOKEN";
/// Random bytes of one that is made here: nobody guesses 128 bits.
const BYTES: usize = 16;
/// Fewer characters can be guessed.
const CHARACTERS_MIN: usize = 16;
const CHARACTERS_MAX: usize = 256;

/// A token; its text is never printed by accident.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// One that nobody can foresee.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn random() -> anyhow::Result<Token> {
        let mut bytes = [0u8; BYTES];
        let source = "/dev/urandom";
        let read = File::open(source).and_then(|mut file| file.read_exact(&mut bytes));
        read.context(source)?;
        Ok(Token(
            bytes.iter().map(|byte| format!("{byte:02x}")).collect(),
        ))
    }

    /// The one in this file; where there is no such file, a random one is written to it, readable by its owner alone.
    ///
    /// # Errors
    /// Others can read the file, what it holds is no token, or it can be neither read nor written.
    pub fn of_file(file: &Path) -> anyhow::Result<Token> {
        let shown = file.display();
        let made = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(file);
        match made {
            Ok(mut new) => {
                let token = Token::random()?;
                writeln!(new, "{}", token.0).with_context(|| format!("--token {shown}"))?;
                return Ok(token);
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error).with_context(|| format!("--token {shown}")),
        }
        let mut text = String::new();
        let old = open_to_read(file).with_context(|| format!("--token {shown}"))?;
        let mode = old.metadata()?.permissions().mode();
        if mode & 0o077 != 0 {
            bail!(
                "--token {shown}: others may read or write it (mode {:03o}): `chmod 600 {shown}`",
                mode & 0o777
            );
        }
        let limit = CHARACTERS_MAX as u64 + 2;
        let read = old.take(limit).read_to_string(&mut text);
        read.with_context(|| format!("--token {shown}"))?;
        Token::of_text(text.trim_end_matches(['\n', '\r']))
            .with_context(|| format!("--token {shown}"))
    }

    /// The one that the launcher has given to this process.
    ///
    /// # Errors
    /// There is none.
    pub fn of_environment() -> anyhow::Result<Token> {
        Token::of_text(&std::env::var(TOKEN_VARIABLE).context(TOKEN_VARIABLE)?)
    }

    fn of_text(text: &str) -> anyhow::Result<Token> {
        let count = text.len();
        if !(CHARACTERS_MIN..=CHARACTERS_MAX).contains(&count) {
            bail!(
                "a token has {CHARACTERS_MIN} to {CHARACTERS_MAX} characters, not {count}; name a file that is not there, and one is made"
            );
        }
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-._~".contains(c);
        if let Some(wrong) = text.chars().find(|c| !is_plain(*c)) {
            bail!("a token is of letters, digits and -._~, and has no {wrong:?}");
        }
        Ok(Token(text.into()))
    }

    /// Its text, for whoever may have it.
    pub fn text(&self) -> &str {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_not_there_is_made_for_its_owner_alone_and_read_the_next_time() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("token");
        let made = Token::of_file(&file).expect("a token");
        assert_eq!(made.text().len(), 2 * BYTES);
        let mode = std::fs::metadata(&file)
            .expect("the file")
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(Token::of_file(&file).expect("the same"), made);
        assert_ne!(Token::random().expect("another"), made);
        assert_eq!(format!("{made:?}"), "Token");
    }

    #[test]
    fn a_file_that_others_can_read_or_that_holds_no_token_is_refused_with_what_is_right() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("token");
        let refused = |text: &str, mode: u32| {
            std::fs::write(&file, text).expect("a file");
            let mode = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(&file, mode).expect("its mode");
            format!("{:#}", Token::of_file(&file).expect_err("refused"))
        };
        assert!(refused("0123456789abcdef", 0o640).contains("chmod 600"));
        assert!(refused("short", 0o600).contains("16 to 256 characters, not 5"));
        assert!(refused("0123456789 abcdef", 0o600).contains("has no ' '"));
        assert!(refused("", 0o600).contains("not 0"));
        // Nobody waits for a writer at a pipe.
        std::fs::remove_file(&file).expect("it was there");
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        let fifo = rustix::fs::FileType::Fifo;
        rustix::fs::mknodat(rustix::fs::CWD, &file, fifo, mode, 0).expect("a pipe");
        let refused = format!("{:#}", Token::of_file(&file).expect_err("refused"));
        assert!(refused.contains("no regular file"), "{refused}");
    }
}
