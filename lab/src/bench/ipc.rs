//! `quadrant-lab bench ipc`: what a scan costs between processes alone, beside what the system and iceoryx2 take for the same.

mod bare;
mod game;
mod pipes;
mod pong;
mod table;

use bus::realtime;

use super::figures::Figures;
use crate::options::{Ball, IpcOptions, axis_counts};
use console::exit::{Kind, Outcome};
use console::output::say;
use console::signals::Signals;

pub(crate) use game::{Game, Played};
pub use pong::pong;

/// What is played, the floors first.
const BALLS: [Ball; 4] = [Ball::Ring, Ball::Pipe, Ball::Bare, Ball::Sample];

/// Where the processes are.
struct Placement {
    words: String,
    /// The processor of the master, then the processors of the servos in turn.
    cores: Vec<usize>,
}

fn placements(cores: &[usize]) -> Vec<Placement> {
    let first = cores.first().copied().unwrap_or(0);
    let mut placements = vec![Placement {
        words: "one core".into(),
        cores: vec![first],
    }];
    if cores.len() > 1 {
        placements.push(Placement {
            words: format!("across {} cores", cores.len()),
            cores: cores.to_vec(),
        });
    }
    placements
}

/// One scan, feedback to all servos and their commands back, for numbers of axes; the servos compute nothing.
///
/// # Errors
/// The other side cannot be had, or it is interrupted.
pub fn ipc(options: &IpcOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let mut counts = options.axes.clone();
    if counts.is_empty() {
        counts = axis_counts();
    }
    say(&format!(
        "ipc: a feedback to every servo and their commands back, {} scans of each in {} rounds; the servos compute nothing",
        options.scans, options.rounds
    ));
    let placements = placements(&realtime::processors());
    if placements.len() < 2 {
        say("one processor alone: nothing is measured across cores");
    }
    for placement in placements {
        table::head(&placement.words);
        for &axes in &counts {
            let mut played = Vec::new();
            for _ in 0..options.rounds {
                for (place, ball) in BALLS.into_iter().enumerate() {
                    let game = Game {
                        axes,
                        ball,
                        cores: &placement.cores,
                        awake: false,
                        scans: options.scans,
                    };
                    let of_round = game.play(&signals)?;
                    match played.get_mut(place) {
                        None => played.push(of_round),
                        Some(all) => Played::join(all, &of_round).environment()?,
                    }
                }
            }
            let rows: Vec<_> = BALLS.into_iter().zip(&played).collect();
            table::rows(axes, &placement.words, &rows, figures);
        }
    }
    Ok(())
}
