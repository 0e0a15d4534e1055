//! Runs of a program over a segment of foreign drives, in lockstep, and what came of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::segment::{Network, machine};

/// A circle of R10 with F3000 from where the axes are.
const CIRCLE: &str = "G21 G90 G17\nG1 X10 Y0 F3000\nG3 X10 Y0 I-10 J0\nG2 X10 Y0 I-10 J0\nM2\n";

/// Writes it into a folder.
pub fn circle(folder: &Path) -> PathBuf {
    let path = folder.join("circle.ngc");
    fs::write(&path, CIRCLE).expect("writing");
    path
}

/// A fault script in which owner and standby of the bus are killed so many times each: the owner first in this scan, another one every 30.
pub fn kills_of_owners(first_scan: u32, times: u32) -> String {
    let each = [("fieldbus", first_scan), ("fieldbus-b", first_scan + 30)].map(|(process, scan)| {
        format!(
            "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\ndo = \"kill\"\nrestart_after_scans = 20\n\
             repeat = {{ times = {times}, every_scans = 60 }}\n"
        )
    });
    "[restart]\nrestarts_max = 1000\n".to_string() + &each.concat()
}

/// A run in lockstep that has ended.
pub struct Done {
    pub output: Output,
    pub report: serde_json::Value,
}

impl Done {
    /// A text of the report.
    pub fn text(&self, pointer: &str) -> String {
        let value = self.report.pointer(pointer);
        let value = value.and_then(serde_json::Value::as_str);
        value.unwrap_or_else(|| panic!("no {pointer}")).to_string()
    }

    /// A number of the report.
    pub fn number(&self, pointer: &str) -> f64 {
        let value = self.report.pointer(pointer);
        let value = value.and_then(serde_json::Value::as_f64);
        value.unwrap_or_else(|| panic!("no {pointer}"))
    }

    /// The program ran to its end.
    pub fn is_completed(&self) {
        let kind = self.text("/outcome/kind");
        assert_eq!(kind, "completed", "{}", self.printed());
    }

    /// What was printed, errors first.
    pub fn printed(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
            + &String::from_utf8_lossy(&self.output.stdout)
    }
}

/// Edits of a file: each text is replaced by the other.
pub type Edits<'a> = &'a [(&'a str, &'a str)];

/// A run of the circle.
#[derive(Default)]
pub struct Run<'a> {
    /// Options of the segment beside its three drives.
    pub segment: &'a [&'a str],
    /// Edits of the machine file.
    pub machine: Edits<'a>,
    /// Edits of the drive file.
    pub drive: Edits<'a>,
    /// A fault script.
    pub faults: Option<&'a str>,
    /// Options of `quadrant run`.
    pub options: &'a [&'a str],
}

impl Run<'_> {
    /// Runs it in lockstep, to its end.
    pub fn run(&self, network: &Network) -> Done {
        self.run_on(network, &machine(self.machine, self.drive))
    }

    /// The same on a machine that is there.
    pub fn run_on(&self, network: &Network, machine: &tempfile::TempDir) -> Done {
        let mut options = vec!["--drives", "3"];
        options.extend(self.segment);
        let _segment = network.segment(&options);
        self.run_there(network, machine)
    }

    /// The same on a segment that is there too.
    pub fn run_there(&self, network: &Network, machine: &tempfile::TempDir) -> Done {
        let program = circle(machine.path());
        let out = machine.path().join("run");
        let cell = crate::support::unique_cell();
        let shown = |path: &Path| path.to_string_lossy().into_owned();
        let (folder, program, out_name) = (shown(machine.path()), shown(&program), shown(&out));
        let mut arguments = vec![
            "run", &folder, &program, "--out", &out_name, "--cell", &cell,
        ];
        arguments.extend(self.options);
        let script = machine.path().join("script.toml");
        let script_name = shown(&script);
        if let Some(faults) = self.faults {
            fs::write(&script, faults).expect("writing");
            arguments.extend(["--faults", &script_name, "--with-drives"]);
        }
        let output = network.quadrant(&arguments);
        let report = fs::read_to_string(out.join("report.json"));
        let report =
            report.unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
        Done {
            output,
            report: serde_json::from_str(&report).expect("report.json"),
        }
    }
}

/// Runs the circle over a segment with these options.
pub fn run(network: &Network, segment: &[&str], faults: Option<&str>) -> Done {
    Run {
        segment,
        faults,
        ..Run::default()
    }
    .run(network)
}
