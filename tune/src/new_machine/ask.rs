//! The same numbers, asked for one after the other.

use std::io::{self, Write};

use anyhow::bail;

use super::axis::{LETTERS, NewAxis, is_rotary};

/// Asks for axes until an empty line; each as `--axis` takes it.
pub fn axes() -> anyhow::Result<Vec<String>> {
    println!(
        "Axes of the new machine. Enter alone takes what is in brackets; Ctrl-C writes nothing.\n"
    );
    let mut all: Vec<String> = Vec::new();
    loop {
        let enough = if all.is_empty() {
            ""
        } else {
            ", Enter if that is all"
        };
        let letter = answer(
            &format!("Letter of axis {} ({LETTERS}{enough})", all.len() + 1),
            "",
        )?;
        if letter.is_empty() && !all.is_empty() {
            return Ok(all);
        }
        match axis(&letter.to_uppercase()) {
            Ok(axis) => all.push(axis),
            Err(error) => println!("  {error:#}"),
        }
    }
}

/// Asks for one axis.
fn axis(letter: &str) -> anyhow::Result<String> {
    if letter.is_empty() || !LETTERS.split(' ').any(|known| known == letter) {
        bail!("{letter:?}: one of {LETTERS}");
    }
    let rotary = is_rotary(letter);
    let (unit, travel, moved) = if rotary {
        (
            "degrees",
            "-120..120",
            ("inertia", "Inertia that turns, kg·m²", "0.5"),
        )
    } else {
        ("mm", "-200..200", ("mass", "Mass that moves, kg", "100"))
    };
    let mut text = format!(
        "{letter}:travel={}",
        answer(&format!("  Travel, {unit}, LOW..HIGH"), travel)?
    );
    if rotary {
        text += &format!(
            ",gear={}",
            answer("  Turns of the motor for one of the axis", "90")?
        );
    } else {
        text += &format!(",{}", transmission()?);
    }
    let (key, question, otherwise) = moved;
    text += &format!(",{key}={}", answer(&format!("  {question}"), otherwise)?);
    for (key, question) in [
        ("speed", format!("  Highest speed, {unit}/s")),
        (
            "torque",
            "  Continuous torque of the motor, N·m".to_string(),
        ),
    ] {
        let given = answer(&question, "estimated")?;
        if given != "estimated" {
            text += &format!(",{key}={given}");
        }
    }
    NewAxis::read(&text)?;
    Ok(text)
}

fn transmission() -> anyhow::Result<String> {
    let kind = answer("  Driven by screw, rack or belt", "screw")?;
    let (first, otherwise) = match kind.as_str() {
        "screw" => {
            return Ok(format!(
                "lead={}",
                answer("  Lead of the screw, mm per turn", "10")?
            ));
        }
        "rack" => ("  Module and teeth of the pinion", "2x20"),
        "belt" => ("  Pitch in mm and teeth of the pulley", "5x24"),
        other => bail!("{other:?}: screw, rack or belt"),
    };
    let size = answer(first, otherwise)?;
    let ratio = answer("  Turns of the motor for one of the pinion or pulley", "5")?;
    Ok(format!("{kind}={size},ratio={ratio}"))
}

/// An answer, or what is taken without one.
fn answer(question: &str, otherwise: &str) -> anyhow::Result<String> {
    if otherwise.is_empty() {
        print!("{question}: ");
    } else {
        print!("{question} [{otherwise}]: ");
    }
    io::stdout().flush()?;
    let mut line = String::new();
    if io::stdin().read_line(&mut line)? == 0 {
        bail!("the input ended; nothing was written");
    }
    let line = line.trim();
    Ok(if line.is_empty() { otherwise } else { line }.to_string())
}
