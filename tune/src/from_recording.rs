//! `quadrant identify`: the model of an axis from a recording that somebody else made, by the same equations as `quadrant tune`.

mod simulation;
mod table_file;
mod words;

use anyhow::{Context, anyhow};

use crate::identify::{self, Found, Lever};
use crate::judge;
use crate::options::IdentifyOptions;
use crate::recording::Recording;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;

/// Travel of the motor below which nothing is identified, in mm.
const TRAVEL_MM_MIN: f64 = 0.5;

/// Identifies an axis from files.
pub fn identify(options: &IdentifyOptions) -> Outcome {
    let lever = |file: &table_file::File| lever(options, file);
    let taught = table_file::read(&options.recording, options).input()?;
    let lever_of_taught = lever(&taught).input()?;
    moves(&taught.recording)
        .with_context(|| options.recording.display().to_string())
        .map_err(Failure::Stopped)?;
    let found = first(&taught.recording, &lever_of_taught)?;
    say(&words::heading(&options.recording, &taught.recording));
    say(&words::found(&found, &lever_of_taught));
    if let Some(why) = judge::refusal(None, &found) {
        return Err(Failure::Stopped(anyhow!(
            "{}: {why}",
            options.recording.display()
        )));
    }
    for remark in judge::remarks(&found) {
        say(&format!("  {remark}"));
    }
    // What a force predicts is the motor's motion: motor and table as one.
    let one = Recording {
        scale_mm: taught.recording.motor_mm.clone(),
        ..taught.recording.clone()
    };
    let as_one = first(&one, &lever_of_taught)?;
    let explains =
        |of: &Recording| identify::force_error(&as_one, &taught.recording, of, &lever_of_taught);
    say(&words::force_error(
        "of the force",
        &explains(&taught.recording),
    ));
    for path in &options.validate {
        let seen = table_file::read(path, options).input()?;
        if lever(&seen).input()?.newtons_per_nm != lever_of_taught.newtons_per_nm {
            return Err(Failure::Input(anyhow!(
                "{}: must have its torque or force in the same unit as {}",
                path.display(),
                options.recording.display()
            )));
        }
        say(&words::heading(path, &seen.recording));
        say(&words::force_error(
            "of the force",
            &explains(&seen.recording),
        ));
        let simulated = simulation::run(&as_one, &seen.recording, &lever_of_taught);
        say(&words::simulation(&simulated));
    }
    say(&words::model(&found));
    Ok(())
}

/// The model to prefer.
fn first(recording: &Recording, lever: &Lever) -> Result<Found, Failure> {
    let models = identify::models(&[], recording, lever);
    let first = models.into_iter().next();
    first
        .context("nothing to identify")
        .map_err(Failure::Stopped)
}

/// Newtons for a newton metre: 1 where the file has the force itself.
fn lever(options: &IdentifyOptions, file: &table_file::File) -> anyhow::Result<Lever> {
    let newtons_per_nm = if file.is_force {
        1.0
    } else {
        let lead_mm = options.lead_mm.with_context(|| {
            format!(
                "{}: has a torque: --lead-mm, the travel in a turn of the motor, must be given to make it a force",
                file.name
            )
        })?;
        crate::newtons_per_nm(lead_mm)
    };
    Ok(Lever {
        newtons_per_nm,
        lead_mm: options.lead_mm,
        smoothing_s: options.smoothing_ms * 1e-3,
    })
}

/// Whether there is a motion to learn from.
fn moves(recording: &Recording) -> anyhow::Result<()> {
    let all = &recording.motor_mm;
    let low = all.iter().copied().fold(f64::INFINITY, f64::min);
    let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if high - low >= TRAVEL_MM_MIN {
        return Ok(());
    }
    Err(anyhow!(
        "the motor moves by {:.3} mm: must be at least {TRAVEL_MM_MIN} mm, there and back, for mass and friction to show",
        high - low
    ))
}
