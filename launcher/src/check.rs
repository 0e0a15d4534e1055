//! Everything that can be known before anything starts.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use bus::sample::PATH_AXES;
use machine::{Axis, Dialect, Machine, MachineState, SignalSource, machine_file};
use path::limits::LimitsError;
use path::window::WindowPlanner;
use planner::{ProgramText, Survey};
use plant_sim::plant_file::PlantFile;
use program::{EventKind, Note, Program, SHORT_ELEMENTS};

use crate::user_codes;

/// Time between two words on a long check.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// What was checked.
#[derive(Debug)]
pub struct Checked {
    /// The machine.
    pub machine: Machine,
    /// The simulated machine; none where the drives are on a fieldbus.
    pub plant: Option<PlantFile>,
    /// What is at each place on the cable, and which signals that carries; nothing where the drives are simulated.
    pub places: Vec<(usize, String)>,
    /// What drive files give to think about, a line each.
    pub warnings: Vec<String>,
    /// The program, expanded from where the simulated machine is at the start; none of a long one.
    pub program: Option<Program>,
    /// What a program comes to that is too long to be held whole.
    pub long: Option<Survey>,
    /// Command positions that it is expanded from, in increments.
    pub start: [i64; PATH_AXES],
}

/// How much of a long program is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Its beginning: the rest is judged while it runs.
    Beginning,
    /// All of it.
    Whole,
}

impl Depth {
    /// So many elements take a second at most.
    fn elements_max(self) -> u64 {
        match self {
            Depth::Beginning => 100_000,
            Depth::Whole => u64::MAX,
        }
    }
}

/// Reads and checks machine, plant and program.
///
/// # Errors
/// Whatever is wrong with them, for people.
pub fn load(machine: &Path, program: Option<&Path>, depth: Depth) -> anyhow::Result<Checked> {
    load_in(machine, program, depth, None)
}

/// The same of a program in a language that the machine file does not say.
///
/// # Errors
/// As [`load`].
pub fn load_in(
    machine: &Path,
    program: Option<&Path>,
    depth: Depth,
    dialect: Option<Dialect>,
) -> anyhow::Result<Checked> {
    let checked = load_changed(machine, program, depth, |machine| {
        machine.program.dialect = dialect.unwrap_or(machine.program.dialect);
        Ok(())
    })?;
    checked.starts_within(&machine_file(machine))?;
    Ok(checked)
}

/// The same of a machine whose axes may stand where they should not: a cell that is up waits until somebody has jogged them inwards.
///
/// # Errors
/// As [`load`], but for the start.
pub fn load_wherever_it_stands(machine: &Path) -> anyhow::Result<Checked> {
    let checked = load_changed(machine, None, Depth::Whole, |_| Ok(()))?;
    if let Err(outside) = checked.starts_within(&machine_file(machine)) {
        tracing::warn!("{outside:#}; jog it inwards before a program");
    }
    Ok(checked)
}

/// The same of a machine that is changed before anything is made of it.
///
/// # Errors
/// As [`load`]; and what `change` says.
pub fn load_changed(
    machine: &Path,
    program: Option<&Path>,
    depth: Depth,
    change: impl FnOnce(&mut Machine) -> anyhow::Result<()>,
) -> anyhow::Result<Checked> {
    if let Some(program) = program {
        not_swapped(machine, program)?;
    }
    let path = machine_file(machine);
    if !path.exists() {
        bail!(
            "{}: is not there: a machine is a folder with machine.toml and plant.toml, or the path of a machine.toml",
            path.display()
        );
    }
    let mut machine = Machine::load(&path)?;
    change(&mut machine)?;
    let setups = fieldbus::setups::load(&machine, &path)?;
    let (plant, start) = match &setups {
        Some(_) => (None, presumed_start(&machine)),
        None => {
            let (plant, start) = simulated_start(&machine, &path)?;
            (Some(plant), start)
        }
    };
    if let Err(error) = planner::motion_limits(&machine) {
        bail!("{}: {}", path.display(), limits_in_words(&machine, &error));
    }
    let (mut short, mut long) = (None, None);
    if let Some(file) = program {
        short = program::load_if_short(&machine, &start, file, SHORT_ELEMENTS, &[])?;
        if short.is_none() {
            long = Some(survey_file(&machine, file, start, depth)?);
        }
    }
    if let (Some(folder), Some(program)) = (machine.user_code_folder(&path), &short) {
        user_codes::check(&folder, program)?;
    }
    if let Some(program) = &short {
        all_arrives(&machine, program)?;
    }
    let places = setups
        .as_ref()
        .map_or_else(Vec::new, |setups| setups.places_in_words(&machine));
    let mut warnings = setups.map_or_else(Vec::new, |setups| setups.warnings);
    warnings.extend(logic_that_is_missing(&machine, &path));
    let checked = Checked {
        machine,
        plant,
        places,
        warnings,
        program: short,
        long,
        start,
    };
    if checked.program.is_some() {
        checked.planner()?;
    }
    Ok(checked)
}

/// What is wrong with limits, with the name of the axis and the key in place of the axis's index.
fn limits_in_words(machine: &Machine, error: &LimitsError) -> String {
    let words = error.to_string();
    let Some((axis, key)) = error.about() else {
        return words;
    };
    let what = words.split_once(": ").map_or("", |(_, what)| what);
    format!("axis {} {key}: {what}", machine.axis_name(axis))
}

/// Whether a program can be started at a line, from these command positions.
pub fn start_line(
    machine: &Machine,
    file: &Path,
    start: [i64; PATH_AXES],
    line: u32,
) -> anyhow::Result<()> {
    let text = ProgramText::File(file.to_path_buf());
    let name = file.file_name().unwrap_or(file.as_os_str()).display();
    planner::start_place(machine, &text, start, line)
        .map(|_| ())
        .map_err(|error| at_line(&name.to_string(), &error.to_string()))
}

/// What is wrong with a program, with its line as every other message has it.
pub fn at_line(name: &str, words: &str) -> anyhow::Error {
    let line = words.strip_prefix("line ").and_then(|rest| {
        let (line, what) = rest.split_once(": ")?;
        line.parse::<u32>().is_ok().then_some((line, what))
    });
    match line {
        Some((line, what)) => anyhow!("{name}:{line}: {what}"),
        None => anyhow!("{name}: {words}"),
    }
}

/// A machine is a folder or a TOML file, a program neither.
fn not_swapped(machine: &Path, program: &Path) -> anyhow::Result<()> {
    let is_toml = |path: &Path| path.extension().is_some_and(|of| of == "toml");
    let is_machine = |path: &Path| path.is_dir() || is_toml(path);
    if is_machine(program) && !is_machine(machine) {
        bail!(
            "{} is a machine and {} a program: the machine comes first, then the program",
            program.display(),
            machine.display()
        );
    }
    Ok(())
}

/// The plant file beside a machine file, and where its axes are at the start.
fn simulated_start(
    machine: &Machine,
    path: &Path,
) -> anyhow::Result<(PlantFile, [i64; PATH_AXES])> {
    let plant_path = path.with_file_name("plant.toml");
    if !plant_path.exists() {
        bail!(
            "{}: is not there: it says what is true of the simulated machine; one with drives on a fieldbus has [bus] in machine.toml",
            plant_path.display()
        );
    }
    let plant = PlantFile::load(&plant_path)?;
    let start = plant
        .start(machine)
        .with_context(|| format!("{} and {}", path.display(), plant_path.display()))?;
    program::tool_at(machine, &start).with_context(|| plant_path.display().to_string())?;
    Ok((plant, start))
}

impl Checked {
    /// Whether every axis of the simulated machine starts within its travel.
    fn starts_within(&self, path: &Path) -> anyhow::Result<()> {
        let within = self
            .plant
            .as_ref()
            .map_or(Ok(()), |plant| plant.starts_within(&self.machine));
        let plant_path = path.with_file_name("plant.toml");
        within.with_context(|| format!("{} and {}", path.display(), plant_path.display()))
    }
}

/// Where real axes are nobody knows before the drives are asked: a program is checked from the machine's zero, or the end of the travel
/// nearest to it.
fn presumed_start(machine: &Machine) -> [i64; PATH_AXES] {
    let mut start = [0; PATH_AXES];
    for (place, axis) in start.iter_mut().zip(machine.program_axes()) {
        let at_mm = 0.0_f64.clamp(axis.travel_min_mm, axis.travel_max_mm);
        *place = (at_mm / axis.increment_mm()).round() as i64;
    }
    start
}

/// Reads a long program as far as is asked for, and says how far it is on the way.
fn survey_file(
    machine: &Machine,
    file: &Path,
    start: [i64; PATH_AXES],
    depth: Depth,
) -> anyhow::Result<Survey> {
    let text = ProgramText::File(file.to_path_buf());
    let mut told = Instant::now();
    let survey = planner::survey(machine, &text, start, depth.elements_max(), |elements| {
        if told.elapsed() > TELL_EVERY {
            told = Instant::now();
            tracing::info!("{}: {elements} elements are good so far", file.display());
        }
    })?;
    Ok(survey)
}

impl Checked {
    /// The simulated machine.
    ///
    /// # Errors
    /// The drives are on a fieldbus.
    pub fn simulated(&self) -> anyhow::Result<&PlantFile> {
        self.plant.as_ref().with_context(|| {
            format!(
                "machine {}: its drives are on a fieldbus ([bus]), and this works with simulated ones alone",
                self.machine.name
            )
        })
    }

    /// What of the program was accepted with a remark, in words.
    pub fn notes(&self) -> Vec<String> {
        let of_program = self.program.iter();
        let beside = of_program.filter_map(|program| without_spindle(&self.machine, program));
        let short = self.program.iter().flat_map(|program| &program.notes);
        let notes = short.chain(self.long.iter().flat_map(|survey| &survey.notes));
        beside.chain(notes.map(Note::shown)).collect()
    }

    /// What of the machine was accepted with a remark, in words.
    pub fn remarks(&self) -> Vec<String> {
        let plant = self.plant.iter();
        let differ = plant.flat_map(|plant| plant.disagreements(&self.machine));
        let fall = self.machine.axes.iter().filter_map(Axis::falls);
        let known = self.warnings.iter().cloned();
        known.chain(fall).chain(differ).collect()
    }

    /// Time of the program, about, in s; none of a long one.
    pub fn seconds(&self) -> Option<f64> {
        let mut windows = self.planner().ok()?;
        let start = windows.start_state();
        windows.time_to_end_s(&start, 1.0).ok()
    }

    /// A planner of windows along the program.
    ///
    /// # Errors
    /// The path cannot be planned within the limits.
    pub fn planner(&self) -> anyhow::Result<WindowPlanner> {
        let Some(program) = &self.program else {
            match &self.long {
                Some(survey) => bail!(
                    "{}: has more than {SHORT_ELEMENTS} elements: too long to be planned in advance",
                    survey.name
                ),
                None => bail!("no program was named"),
            }
        };
        self.planner_along(program.clone())
    }

    /// The same along this program.
    ///
    /// # Errors
    /// The path cannot be planned within the limits.
    pub fn planner_along(&self, program: Program) -> anyhow::Result<WindowPlanner> {
        let name = program.name.clone();
        let course = planner::course(&self.machine, program);
        Ok(course
            .map_err(|error| at_line(&name, &error.to_string()))?
            .0)
    }
}

/// The file of the machine's own logic that is not there, in words.
fn logic_that_is_missing(machine: &Machine, machine_file: &Path) -> Option<String> {
    let logic = machine.logic.as_ref()?;
    let folder = machine.logic_folder(machine_file)?;
    let names_file = |(index, word): &(usize, &String)| {
        *index == 0 && word.contains('/') || word.starts_with("./") || word.starts_with("../")
    };
    let mut files = logic.command.iter().enumerate().filter(names_file);
    let (_, missing) = files.find(|(_, word)| !folder.join(word).exists())?;
    Some(format!(
        "[logic] command names {missing}, which is not in {}: the cell would not start",
        folder.display()
    ))
}

/// On a fieldbus nothing but a signal carries what a program switches: one that goes nowhere is refused before it moves.
///
/// # Errors
/// The first output, coolant or spindle of the program that no signal comes from, with its line.
pub fn all_arrives(machine: &Machine, program: &Program) -> anyhow::Result<()> {
    let Some(bus) = &machine.bus else {
        return Ok(());
    };
    let comes = |is_it: &dyn Fn(&SignalSource) -> bool| {
        machine.signals.iter().any(|signal| is_it(&signal.from))
    };
    let encoder = machine.spindle.map_or(0, |of| of.encoder_counts_per_turn);
    let has_angle = bus.spindle.is_some() && encoder > 0;
    let by_state = |states: &[MachineState]| {
        comes(&|from| from.state.is_some_and(|state| states.contains(&state)))
    };
    for event in &program.events {
        let (what, key, arrives) = match event.kind {
            EventKind::DigitalOutput { index, .. } => (
                format!("digital output {index}"),
                format!("{{ output = {index} }}"),
                comes(&|from| from.output == Some(index)),
            ),
            EventKind::AnalogOutput { index, .. } => (
                format!("analogue output {index}"),
                format!("{{ analog_output = {index} }}"),
                comes(&|from| from.analog_output == Some(index)),
            ),
            EventKind::Flood(true) => (
                "coolant (M8)".into(),
                "{ state = \"flood\" }".into(),
                by_state(&[MachineState::Flood]),
            ),
            EventKind::Mist(true) => (
                "coolant (M7)".into(),
                "{ state = \"mist\" }".into(),
                by_state(&[MachineState::Mist]),
            ),
            EventKind::SpindleClockwise | EventKind::SpindleCounterClockwise
                if machine.spindle.is_some() =>
            {
                (
                    "the spindle".into(),
                    "{ state = \"spindle-speed\" }, and no [bus.spindle] drives it".into(),
                    bus.spindle.is_some()
                        || by_state(&[
                            MachineState::SpindleClockwise,
                            MachineState::SpindleCounterClockwise,
                            MachineState::SpindleSpeed,
                        ]),
                )
            }
            EventKind::SpindleOrient(_) if machine.spindle.is_some() => (
                "the angle of the spindle (M19)".into(),
                "{ state = \"spindle-orient\" }, and no [bus.spindle] with an encoder finds it"
                    .into(),
                by_state(&[MachineState::SpindleOrient, MachineState::SpindleAngle]) || has_angle,
            ),
            _ => continue,
        };
        if !arrives {
            bail!(
                "{}:{}: {what} goes nowhere: no [[signal]] has from = {key}",
                program.name,
                event.line
            );
        }
    }
    Ok(())
}

/// S and M3 to M5 where nothing obeys them, in words.
pub fn without_spindle(machine: &Machine, program: &Program) -> Option<String> {
    let mut events = program.events.iter();
    let event = events.find(|event| !planner::acts_on(machine, &event.kind))?;
    Some(format!(
        "line {}: S and M3 to M5 are read and not acted on: no spindle is driven",
        event.line
    ))
}
