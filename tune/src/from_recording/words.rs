//! What `quadrant identify` prints.

use std::path::Path;

use super::simulation::{Off, Simulated};
use crate::identify::{BREAK_UM, ForceError, Found, Lever};
use crate::laws;
use crate::recording::Recording;
use crate::write;
use console::output::joined;

/// What the file holds.
pub fn heading(path: &Path, recording: &Recording) -> String {
    let all = &recording.motor_mm;
    let low = all.iter().copied().fold(f64::INFINITY, f64::min);
    let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    format!(
        "{}: {} instants of {:.3} ms, {:.1} mm of travel, {}",
        path.display(),
        all.len(),
        recording.scan_s * 1e3,
        high - low,
        if recording.has_scale() {
            "with a scale"
        } else {
            "motor encoder only"
        }
    )
}

/// What was found.
pub fn found(found: &Found, lever: &Lever) -> String {
    let structure = found.whole_structure();
    let (coulomb_n, viscous) = (found.coulomb_n(), found.viscous_n_s_per_m());
    let by_direction = |mean: f64, half: f64, unit: &str| {
        format!(
            "{mean:9.2} {unit}: {:.2} forward, {:.2} back",
            mean + half,
            mean - half
        )
    };
    let mut text = format!(
        "  mass              {:9.3} kg\n  Coulomb friction  {}\n  viscous friction  {}\n  constant force    {:+9.3} N",
        found.mass_kg(),
        by_direction(coulomb_n, structure.constant_n, "N"),
        by_direction(viscous, structure.viscous_n_s_per_m, "N·s/m"),
        structure.constant_n
    );
    let pairs = laws::shares(&found.motor).into_iter().zip(BREAK_UM);
    let pairs = pairs.filter(|(share, _)| *share > 0.0);
    let curve = pairs.map(|(share, um)| format!("{:.0} % over {um} µm", 100.0 * share));
    text += &format!(
        "\n  turns round       {}\n  break-away        {:9.3} times Coulomb friction, gone above {:.2} mm/s",
        joined(curve, ", "),
        found.motor.static_ratio,
        found.motor.stribeck_mm_s
    );
    text += &match lever.lead_mm {
        Some(_) => format!(
            "\n  cogging           {:9.3} N, {} a turn",
            found.cogging_nm * lever.newtons_per_nm,
            found.cogging_per_turn
        ),
        None => "\n  cogging             not known: it needs --lead-mm".to_owned(),
    };
    if let Some(table) = &found.table {
        text += &format!(
            "\n  table             {:9.3} kg, {:.1} N, {:.1} N/µm, gap {:.2} µm, lost motion {:.2} µm",
            table.mass_kg,
            table.friction.coulomb_n(),
            table.stiffness_n_per_um,
            table.gap_um,
            found.lost_motion_um()
        );
    }
    text + &format!(
        "\n  noise             {:9.3} N of the {:.3} N that are left near reversals; torque {:.2} ms late",
        found.noise_n,
        found.residual_n,
        found.torque_late_s * 1e3
    )
}

/// How much of the force is explained.
pub fn force_error(what: &str, error: &ForceError) -> String {
    format!(
        "  unexplained       {:9.2} % {what} (one Coulomb and one viscous friction: {:.2} %; each by direction: {:.2} %)\n  \
         near reversals    {:9.2} N left; with Coulomb and viscous friction by direction {:.2} N",
        100.0 * error.relative,
        100.0 * error.relative_simple,
        100.0 * error.relative_by_direction,
        error.reversal_n,
        error.reversal_by_direction_n
    )
}

/// How far an open-loop simulation is off.
pub fn simulation(of: &Simulated) -> String {
    let line = |what: &str, off: &Off, unit: &str| {
        format!(
            "  simulated {what} {:9.4} {unit} root mean square off, {:.2} %, fit {:.2} %",
            off.rms,
            100.0 * off.relative,
            100.0 * off.fit
        )
    };
    line("position", &of.position, "mm  ") + "\n" + &line("speed   ", &of.velocity, "mm/s")
}

/// The model as a machine file has it.
pub fn model(found: &Found) -> String {
    format!(
        "For a machine file:\n{}",
        write::model_alone(found).trim_end()
    )
}
