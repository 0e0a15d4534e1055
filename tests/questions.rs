//! What a program asks the machine, by the real processes: probe and inputs, whoever is killed around an answer.

use std::fmt::Write as _;
use std::path::Path;

use bus::sample::{AnswerOutcome, PATH_AXES};
use monitor::log::{RunLog, Sample};

use crate::size;
use crate::support::{Bench, Run, number, root, run_with};

/// Below the ball's centre when it touches.
const SURFACE_MM: f64 = -60.0;
const TIP_MM: f64 = 2.0;

/// `xyz-mill` with a probe over a plane, and an input that comes on 0.25 s after output 9; no work offset.
fn bench() -> Bench {
    let probe = "[program]\n";
    let offset = "X = 250.0\nY = 200.0\nZ = -100.0\n";
    let edits = [(probe, "[program]\nprobe = true\n"), (offset, "")];
    let bench = Bench::of("xyz-mill", &edits);
    let plant = root().join("machines/xyz-mill/plant.toml");
    let mut plant = std::fs::read_to_string(plant).expect("a plant");
    let _ = write!(
        plant,
        "\n[probe]\ntip_radius_mm = {TIP_MM:?}\novertravel_mm = 5.0\nrepeatability_um = 0.0\n\n\
         [[probe.plane]]\npoint_mm = [0.0, 0.0, {SURFACE_MM:?}]\nnormal = [0.0, 0.0, 1.0]\n\n\
         [[input]]\ndigital = 3\nvalue = 1.0\nat_s = 0.25\nafter_output = 9\n"
    );
    bench.file("plant.toml", &plant);
    bench
}

/// Touches three places, moves by what it has found, waits for an input twice, once in vain.
const PROGRAM: &str = "\
G21 G90 G94
G0 X255 Z-55
#1=0
#2=0
o1 while [#1 LT 3]
G91 G0 X3
M64 P4
G90 G38.2 Z-70 F600
#2=[#2+#5063]
M62 P1
G38.4 Z-50 F300
M63 P1
G0 Z-55
G38.3 Z-56
o2 if [#5070 EQ 1]
G0 X0
o2 endif
M65 P4
#1=[#1+1]
o1 endwhile
M64 P9
M66 P3 L3 Q5
G0 Y[200+#5399*7] Z-50
M66 P3 L4 Q0.1
G0 X[260+#5399]
G1 Z[#2/3+10] F2000
(PRINT, has found #2)
M2
";

/// What the log of a run says of the questions.
#[derive(Debug, Default, PartialEq)]
struct Seen {
    /// Number, outcome and tripped place of each answer.
    answers: Vec<(u32, u32, [i64; PATH_AXES])>,
    /// Scans in which they were first shown.
    scans: Vec<u64>,
    /// Digital outputs, every time they changed.
    outputs: Vec<u64>,
    /// Events that were undone.
    undone: usize,
    end: [i64; PATH_AXES],
}

fn seen(run_dir: &Path) -> Seen {
    let mut seen = Seen::default();
    let (mut outputs, mut done) = (0, 0);
    for sample in RunLog::open(run_dir).expect("a log") {
        let Ok(Sample::Feedback(feedback)) = sample else {
            continue;
        };
        let answer = feedback.answer;
        let known = answer.outcome >= AnswerOutcome::Given as u32;
        let last = seen
            .answers
            .last()
            .map(|(number, outcome, _)| (*number, *outcome));
        if known && last != Some((answer.number, answer.outcome)) {
            let of = (answer.number, answer.outcome, answer.tripped);
            seen.answers.push(of);
            seen.scans.push(feedback.scan);
        }
        let levels = feedback.auxiliary.levels.digital;
        if levels != std::mem::replace(&mut outputs, levels) {
            seen.outputs.push(levels);
        }
        let before = std::mem::replace(&mut done, feedback.auxiliary.events_done);
        seen.undone += usize::from(before > done);
        seen.end = feedback.path_positions();
    }
    seen
}

/// Orders that bring the machine on again, whenever somebody was lost; elsewhere they change nothing.
fn going_on() -> String {
    let mut orders = String::new();
    for scan in (400..30_000).step_by(400) {
        let _ = write!(orders, "[[order]]\nscan = {scan}\norder = \"enable\"\n");
        let resume = scan + 60;
        let _ = write!(orders, "[[order]]\nscan = {resume}\norder = \"resume\"\n");
    }
    orders
}

fn run(bench: &Bench, faults: Option<&str>) -> Run {
    let program = bench.file("asks.ngc", PROGRAM);
    let orders = bench.file("orders.toml", &going_on()).display().to_string();
    let faults = faults.map(|text| bench.file("faults.toml", text).display().to_string());
    let mut more = vec!["--orders", &orders];
    if let Some(faults) = &faults {
        more.extend(["--faults", faults]);
    }
    run_with(bench.path(), &program, &more)
}

#[test]
fn the_report_measures_the_way_that_the_machine_took_behind_its_answers() {
    let bench = bench();
    let run = run(&bench, None);
    let report = run.good_report();
    let seen = seen(&run.out);
    let (given, missed) = (AnswerOutcome::Given as u32, AnswerOutcome::Missed as u32);
    let mut expected = [given, given, missed].repeat(3);
    expected.extend([given, missed]);
    let outcomes: Vec<u32> = seen.answers.iter().map(|answer| answer.1).collect();
    assert_eq!(outcomes, expected);
    let [x_mm, y_mm, z_mm] = [0, 1, 2].map(|axis| seen.end[axis] as f64 * 1e-6);
    // The input showed 1, then did not go off in time: −1.
    assert_eq!((x_mm, y_mm), (259.0, 207.0));
    assert!(
        (z_mm - (SURFACE_MM + TIP_MM + 10.0)).abs() < 0.02,
        "{z_mm} mm"
    );
    // As if the probe had tripped at the end of its motions it would be millimetres; rapids alone are 0.12 mm off their path.
    let peak_um = number(&report, "/contour_error_um/peak");
    assert!(peak_um < 200.0, "{peak_um} µm");
}

#[test]
fn whoever_is_killed_around_an_answer_the_program_goes_on_with_it_and_does_nothing_twice() {
    let bench = bench();
    let undisturbed = run(&bench, None);
    undisturbed.good_report();
    let undisturbed = seen(&undisturbed.out);
    assert_eq!(undisturbed.undone, 0);
    let kinds = |seen: &Seen| -> Vec<_> { seen.answers.iter().map(|a| (a.0, a.1)).collect() };
    let mut worst_um = 0.0f64;
    let deaths = [
        ("planner", -1i64),
        ("planner", 9),
        ("planner", 0),
        ("plant-sim", -1),
        ("plant-sim", 1),
        ("planner", 1),
        ("servo-Z", 0),
        ("plant-sim", 0),
    ];
    for (who, offset) in size::one_in(2, deaths) {
        let mut faults =
            String::from("[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n");
        // Two touches, a miss and a touch, or both inputs. A death makes all that follows later.
        let answer = match offset.rem_euclid(3) {
            0 => 0,
            1 => 2,
            _ => 9,
        };
        for index in [answer, answer + 1] {
            let scan = undisturbed.scans[index].saturating_add_signed(offset);
            let _ = write!(
                faults,
                "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\n"
            );
        }
        let run = run(&bench, Some(&faults));
        let what = format!("{faults}{}", run.stderr());
        let report = run.good_report();
        let seen = seen(&run.out);
        assert_eq!(kinds(&seen), kinds(&undisturbed), "{what}");
        assert_eq!(seen.outputs, undisturbed.outputs, "{what}");
        assert_eq!(seen.undone, 0, "{what}");
        for (now, then) in seen.answers.iter().zip(&undisturbed.answers) {
            worst_um = worst_um.max((now.2[2] - then.2[2]).abs() as f64 * 1e-3);
        }
        for (now, then) in seen.end.iter().zip(undisturbed.end) {
            worst_um = worst_um.max((now - then).abs() as f64 * 1e-3);
        }
        assert!(worst_um < 20.0, "{worst_um} µm: {what}");
        let peak_um = number(&report, "/contour_error_um/peak");
        assert!(peak_um < 1000.0, "{peak_um} µm: {what}");
        let said = std::fs::read_to_string(run.out.join("messages.jsonl")).expect("messages");
        let said = said.matches("has found").count();
        assert_eq!(said, 1, "{what}");
    }
    println!("at most {worst_um:.2} µm apart");
}

/// Behind a touch the program is long: a planner that comes later goes on from a place that was kept behind the answer.
#[test]
fn a_planner_killed_deep_behind_an_answer_moves_again_within_150_scans() {
    let bench = bench();
    let text = "\
G21 G90 G17 F9000
G0 X250 Y200 Z-55
G38.2 Z-70 F600
G0 Z-55 F9000
#10 = 0
o1 while [#10 LT 24000]
#3 = [#10 * 0.6]
#4 = [#3 + 1]
#4 = [#3 + 2]
#4 = [#3 + 3]
#4 = [#3 + 4]
#4 = [#3 + 5]
#4 = [#3 + 6]
G1 X[12 * COS[#3] + 238] Y[12 * SIN[#3] + 200 + #5063 + 58] F9000
#10 = [#10 + 1]
o1 endwhile
M2
";
    let program = bench.file("long.ngc", text);
    let faults = deep_kills(&bench);
    let report = run_with(bench.path(), &program, &["--faults", &faults]).good_report();
    for fault in 0..2 {
        let of = |key: &str| number(&report, &format!("/faults/{fault}/{key}"));
        let moves_after = of("resumed_at_scan") - of("scan");
        assert!(
            moves_after <= 150.0,
            "moves again after {moves_after} scans"
        );
    }
}

fn deep_kills(bench: &Bench) -> String {
    let kills = [9_000, 16_000].map(|scan| {
        format!("[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"planner\"\ndo = \"kill\"\n\n")
    });
    bench
        .file("deep.toml", &kills.concat())
        .display()
        .to_string()
}
