//! A second foreign segment: KickCAT's simulated slaves (github.com/leducp/KickCAT, CeCILL-C), each with its motor and its vendor's ESI
//! file. It is C++ and in no registry, so it runs where `QUADRANT_KICKCAT` names a source folder of it, built in `build`
//! (docs/developers/foreign-drives.md, "A second segment").

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use crate::runs::{Run, kills_of_owners};
use crate::segment::{DRIVES, MASTER, Network, machine};

/// Its folder; none, and why, where nobody has it.
fn kickcat() -> Option<PathBuf> {
    let folder = std::env::var_os("QUADRANT_KICKCAT").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("SKIPPED: QUADRANT_KICKCAT names no source folder of KickCAT");
    }
    folder
}

/// A simulator of three slaves.
struct Simulator(Child);

impl Simulator {
    fn new(network: &Network, folder: &Path) -> Simulator {
        let program = folder.join("build/simulation/network_simulator");
        let child = network
            .first_command("70", program)
            .args(["-i", DRIVES, "-s"])
            .args(["ecat402-drive.json"; 3])
            .current_dir(folder.join("simulation/slave_configs"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the simulator");
        let started = Instant::now();
        while !network.quadrant(&["bus", "scan", MASTER]).status.success() {
            let patient = started.elapsed() < Duration::from_secs(10);
            assert!(patient, "the simulator does not answer");
        }
        Simulator(child)
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The shipped machine with its slaves, as the drive file that one command makes has them.
fn machine_of(network: &Network, folder: &Path, [mode, drive_mode, advance]: [&str; 3]) -> TempDir {
    let made = machine(
        &[
            ("drives/am-m.toml", "drives/kickcat.toml"),
            (
                "drive_mode = \"velocity\"",
                &format!("drive_mode = \"{drive_mode}\""),
            ),
            ("dead_time_scans = 2", "dead_time_scans = 1"),
            ("advance_ms = 3.5", &format!("advance_ms = {advance}")),
            ("lead_mm = 62.83185307", "lead_mm = 10.0"),
            ("rated_torque_nm = 34.1", "rated_torque_nm = 1.0"),
            ("peak_torque_nm = 76.5", "peak_torque_nm = 3.0"),
            ("gain_per_s = 30.0", "gain_per_s = 40.0"),
        ],
        &[],
    );
    let esi = folder.join("simulation/slave_configs/ecat402-drive.xml");
    let file = made.path().join("drives/kickcat.toml");
    let [esi, out] = [&esi, &file].map(|path| path.to_string_lossy().into_owned());
    let done = network.quadrant(&["bus", "drive-file", &esi, "--mode", mode, "--out", &out]);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let mut text = fs::read_to_string(&file).expect("a drive file");
    for (open, filled) in [
        ("position_increments = 0 ", "position_increments = 65536 "),
        ("velocity_units = 0 ", "velocity_units = 65536 "),
        ("rated_torque_nm = 0.0 ", "rated_torque_nm = 1.0 "),
        ("direction = 0 ", "direction = 1 "),
        ("dead_time_scans = 0 ", "dead_time_scans = 1 "),
    ] {
        assert!(text.contains(open), "{open}: {text}");
        text = text.replace(open, filled);
    }
    fs::write(&file, text).expect("writing");
    made
}

#[test]
fn slaves_of_other_software_run_a_circle_by_their_esi_file_and_the_owner_of_the_bus_may_be_killed()
{
    let Some((network, folder)) = kickcat().and_then(|of| Some((Network::new()?, of))) else {
        return;
    };
    let kills = kills_of_owners(700, 20);
    for modes in [["csv", "velocity", "10.0"], ["csp", "position", "1.0"]] {
        let run = |faults, options| {
            let _simulator = Simulator::new(&network, &folder);
            let machine = machine_of(&network, &folder, modes);
            let run = Run {
                faults,
                options,
                ..Run::default()
            };
            run.run_there(&network, &machine)
        };
        let undisturbed = run(None, &[]);
        undisturbed.is_completed();
        let form_um = undisturbed.number("/ball_bar/0/counter_clockwise/circular_deviation_um");
        assert!(form_um < 5.0, "{modes:?}: {form_um} µm");
        let killed = run(Some(&kills), &[]);
        killed.is_completed();
        let killed_um = killed.number("/ball_bar/0/counter_clockwise/circular_deviation_um");
        assert!(
            (killed_um - form_um).abs() < 0.05,
            "{modes:?}: {killed_um} µm, {form_um} µm"
        );
        run(None, &["--pace", "realtime"]).is_completed();
        run(Some(&kills), &["--pace", "realtime"]).is_completed();
    }
}
