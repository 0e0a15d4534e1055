//! Orders from the page: those of the command line, word for word.
//!
//! Each is given by the command itself, in a process of its own, so that every check, every word of its answer and every limit of
//! time is the command's. `hold`, `stop`, `estop` and `disable` need no process: nothing that this PC lacks, and no other order, may
//! keep them back.

use std::num::NonZero;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use bus::sample::Order;
use operator::{Click, Given, click_numbered};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::token::TOKEN_VARIABLE;
use crate::live::words::failure_words;

/// A command that has not ended by then is ended: each has its own limits, and they are shorter.
const LIMIT: Duration = Duration::from_secs(30);
const LOOK: Duration = Duration::from_millis(3);

/// What may be ordered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "order", rename_all = "kebab-case", deny_unknown_fields)]
pub enum WebOrder {
    /// Feed hold.
    Hold,
    /// On after a hold or a stop.
    Resume,
    /// To rest on the path.
    Stop,
    /// All axes brake at their limits.
    Estop,
    /// Begin the program that is loaded.
    Start,
    /// Drives on.
    Enable,
    /// Drives off.
    Disable,
    /// Feed override.
    Override {
        /// In percent.
        percent: f64,
    },
    /// Whether M1 stops.
    OptionalStop {
        /// It does.
        on: bool,
    },
    /// Give up the rest of the program.
    Reset,
    /// All alarms are acknowledged.
    Acknowledge,
    /// Whether the machine rests behind each block.
    SingleBlock {
        /// It does.
        on: bool,
    },
    /// Override of rapids.
    RapidOverride {
        /// In percent.
        percent: f64,
    },
    /// The axis reads 0 where it is.
    Zero {
        /// Its letter.
        axis: String,
    },
    /// One axis by hand.
    Jog {
        /// Its letter.
        axis: String,
        /// In mm (degrees), signed.
        distance: f64,
        /// Of a numbered click, which counts once: who gives it.
        session: Option<NonZero<u32>>,
        /// Its number in the session, going up.
        click: Option<NonZero<u32>>,
        /// The newest scan that was known when it was given.
        seen: Option<u64>,
    },
    /// Override of jogs.
    JogOverride {
        /// In percent.
        percent: f64,
    },
    /// Home axes.
    Home {
        /// Their letters; none for all that have to be homed.
        #[serde(default)]
        axes: Vec<String>,
    },
}

/// What an order has to look like.
const EXAMPLES: &str = r#"{"order":"hold"}, "resume", "stop", "estop", "start", "reset", "enable", "disable", "acknowledge"; {"order":"override","percent":80}, "rapid-override", "jog-override"; {"order":"single-block","on":true}, "optional-stop"; {"order":"zero","axis":"X"}; {"order":"jog","axis":"X","distance":-0.1}; {"order":"home","axes":["X"]}"#;

/// Reads an order.
///
/// # Errors
/// It is none; in words.
pub fn parse(body: &[u8]) -> Result<WebOrder, String> {
    let order: WebOrder = serde_json::from_slice(body)
        .map_err(|error| format!("no order: {error}; an order is one of {EXAMPLES}\n"))?;
    let is_name = |axis: &String| {
        let number = axis.strip_prefix(|letter: char| letter.is_ascii_alphabetic());
        number.is_some_and(|of| of.len() <= 2 && of.chars().all(|digit| digit.is_ascii_digit()))
    };
    let axes: &[String] = match &order {
        WebOrder::Jog { axis, .. } | WebOrder::Zero { axis } => std::slice::from_ref(axis),
        WebOrder::Home { axes } => axes,
        _ => &[],
    };
    if axes.len() > bus::sample::MAX_AXES || !axes.iter().all(is_name) {
        return Err("an axis is named by its letter, as X, or as P7\n".into());
    }
    if let WebOrder::Jog {
        session,
        click,
        seen,
        ..
    } = &order
    {
        let has = [session.is_some(), click.is_some(), seen.is_some()];
        if has.contains(&true) && has.contains(&false) {
            return Err("a click has `session` and `click`, numbers above 0, and `seen`, a scan; a jog that is no click has none of them\n".into());
        }
    }
    Ok(order)
}

impl WebOrder {
    /// The words of the command line.
    fn arguments(&self) -> Vec<String> {
        if *self == WebOrder::Acknowledge {
            return vec!["alarms".into(), "acknowledge".into()];
        }
        let order = serde_json::to_value(self).unwrap_or_default();
        let word = order.get("order").and_then(Value::as_str);
        let mut words = vec![word.unwrap_or_default().to_owned()];
        words.extend(match self {
            WebOrder::Override { percent }
            | WebOrder::RapidOverride { percent }
            | WebOrder::JogOverride { percent } => vec![percent.to_string()],
            WebOrder::OptionalStop { on } | WebOrder::SingleBlock { on } => {
                vec![if *on { "on" } else { "off" }.to_owned()]
            }
            WebOrder::Zero { axis } => vec![axis.clone()],
            WebOrder::Jog { axis, distance, .. } => vec![axis.clone(), distance.to_string()],
            WebOrder::Home { axes } => axes.clone(),
            _ => Vec::new(),
        });
        words
    }

    /// As an order that waits for no other.
    pub fn urgent(&self) -> Option<Order> {
        match self {
            WebOrder::Hold => Some(Order::Hold),
            WebOrder::Stop => Some(Order::Stop),
            WebOrder::Estop => Some(Order::EmergencyStop),
            WebOrder::Disable => Some(Order::Disable),
            _ => None,
        }
    }

    /// A numbered increment, given by the rules of the monitor's keys; none of other orders.
    fn click(&self, cell: &str) -> Option<Outcome> {
        let WebOrder::Jog {
            axis,
            distance,
            session: Some(session),
            click: Some(click),
            seen: Some(seen),
        } = self
        else {
            return None;
        };
        let number = (session.get(), click.get(), *seen);
        Some(match click_numbered(cell, axis, *distance, number) {
            Ok((Click::NotTaken, words)) => Err(words),
            Ok((_, words)) => Ok(words),
            Err(failure) => Err(failure_words(&failure)),
        })
    }

    /// Gives it to the cell of this name: what came of it, in words; or why nothing did.
    pub fn give(&self, cell: &str) -> Outcome {
        let arguments = self.arguments();
        let outcome = match self.click(cell) {
            Some(outcome) => outcome,
            None => command(&arguments, cell),
        };
        told(&arguments.join(" "), outcome)
    }
}

/// What came of an order, in words; or why nothing did.
pub type Outcome = Result<String, String>;

/// Gives an urgent order to the cell of this name, at once; what is returned waits for what comes of it.
pub fn give_urgently(order: Order, cell: &str) -> impl Future<Output = Outcome> + Send + use<> {
    let given = Given::give(Some(cell), order);
    async move {
        let outcome = match given {
            Ok(given) => loop {
                if let Some(outcome) = given.outcome() {
                    break outcome;
                }
                tokio::time::sleep(LOOK).await;
            },
            Err(failure) => Err(failure),
        };
        told(
            order.word(),
            outcome.map_err(|failure| failure_words(&failure)),
        )
    }
}

fn told(order: &str, outcome: Outcome) -> Outcome {
    let (Ok(words) | Err(words)) = &outcome;
    tracing::info!("from the page: {order}: {words}");
    outcome
}

/// Runs the command; what it prints, and whether it was obeyed.
fn command(arguments: &[String], cell: &str) -> Outcome {
    let child = Command::new("/proc/self/exe")
        .args(arguments)
        .args(["--cell", cell])
        .env_remove(TOKEN_VARIABLE)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = child.map_err(|error| format!("the order could not be given: {error}"))?;
    let since = Instant::now();
    while matches!(child.try_wait(), Ok(None)) {
        if since.elapsed() > LIMIT {
            let _ = child.kill();
        }
        std::thread::sleep(LOOK);
    }
    let ended = child.wait_with_output();
    let ended = ended.map_err(|error| format!("what came of the order is not known: {error}"))?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_string();
    if ended.status.success() {
        return Ok(text(&ended.stdout));
    }
    let words = text(&ended.stderr);
    Err(words
        .strip_prefix("quadrant: ")
        .map_or(words.clone(), str::to_string))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_those_of_the_command_line_word_for_word() {
        let words = |body: &str| parse(body.as_bytes()).expect(body).arguments().join(" ");
        assert_eq!(words(r#"{"order":"hold"}"#), "hold");
        assert_eq!(words(r#"{"order":"override","percent":80}"#), "override 80");
        assert_eq!(
            words(r#"{"order":"jog","axis":"X","distance":-0.01}"#),
            "jog X -0.01"
        );
        assert_eq!(words(r#"{"order":"home"}"#), "home");
        let acknowledged = words(r#"{"order":"acknowledge"}"#);
        assert_eq!(acknowledged, "alarms acknowledge");
        assert_eq!(words(r#"{"order":"home","axes":["X","Z"]}"#), "home X Z");
        assert_eq!(
            words(r#"{"order":"optional-stop","on":false}"#),
            "optional-stop off"
        );
        assert_eq!(
            words(r#"{"order":"single-block","on":true}"#),
            "single-block on"
        );
        assert_eq!(
            words(r#"{"order":"rapid-override","percent":25}"#),
            "rapid-override 25"
        );
        assert_eq!(words(r#"{"order":"zero","axis":"Z"}"#), "zero Z");
        assert_eq!(words(r#"{"order":"reset"}"#), "reset");
    }

    #[test]
    fn what_is_no_order_is_refused_with_what_is_right() {
        for body in [
            "",
            "hold",
            r#"{"order":"down"}"#,
            r#"{"order":"load","program":"/etc/passwd"}"#,
            r#"{"order":"override"}"#,
            r#"{"order":"override","percent":"80"}"#,
            r#"{"order":"override","percent":1e999}"#,
            r#"{"order":"jog","axis":"X"}"#,
            r#"{"order":"jog","axis":"X","distance":1,"cell":"other"}"#,
        ] {
            let words = parse(body.as_bytes()).expect_err(body);
            assert!(words.contains(r#"{"order":"jog","axis":"X""#), "{words}");
        }
        for axis in ["", "--wait", "XYZ", "X 1", "/", "7", "P123"] {
            let body = format!(r#"{{"order":"jog","axis":"{axis}","distance":1}}"#);
            let words = parse(body.as_bytes()).expect_err(axis);
            assert!(words.contains("by its letter"), "{axis}: {words}");
        }
    }
}
