//! The processes of a cell by what they do, and their names in logs, reports and fault scripts.

use bus::sample::{Job, Participant};
use bus::service::ROLES;

use crate::Machine;

/// A process of the cell by what it does, whoever does it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Process {
    /// What it does.
    pub job: Job,
    /// Axis of a servo, 0 of others.
    pub axis: u32,
    /// Role of a servo or of a fieldbus process (0 drives, 1 stands by), 0 of others.
    pub role: u32,
}

impl From<Job> for Process {
    /// The only one that does this.
    fn from(job: Job) -> Process {
        Process {
            job,
            axis: 0,
            role: 0,
        }
    }
}

impl Process {
    /// The servo of an axis in a role.
    pub fn servo(axis: usize, role: usize) -> Process {
        Process {
            job: Job::Servo,
            axis: axis as u32,
            role: role as u32,
        }
    }

    /// That of a participant; none of an unused entry.
    pub fn of(participant: &Participant) -> Option<Process> {
        Some(Process {
            job: Job::from_wire(participant.job)?,
            axis: participant.axis,
            role: participant.role,
        })
    }

    /// The first that does this, as the roster names it.
    pub fn first(self) -> Participant {
        Participant {
            death_scan: u64::MAX,
            job: self.job as u32,
            axis: self.axis,
            role: self.role,
            incarnation: 1,
            live: 1,
            ..Participant::default()
        }
    }

    /// The servos of a machine: of each axis one, and its standby if it has one.
    pub fn servos(machine: &Machine) -> impl Iterator<Item = Process> {
        let axes = machine.axes.iter().enumerate();
        axes.flat_map(|(axis, settings)| {
            (0..=usize::from(settings.standby)).map(move |role| Process::servo(axis, role))
        })
    }

    /// The fieldbus processes of a machine: none where its drives are simulated.
    pub fn fieldbus(machine: &Machine) -> impl Iterator<Item = Process> {
        let count = machine
            .bus
            .as_ref()
            .map_or(0, |bus| 1 + u32::from(bus.standby));
        (0..count).map(|role| Process {
            job: Job::Fieldbus,
            axis: 0,
            role,
        })
    }

    /// All that a cell of this machine can have.
    pub fn all(machine: &Machine) -> Vec<Process> {
        let mut all = vec![Job::Planner.into()];
        all.extend(Process::servos(machine));
        all.extend(Process::fieldbus(machine));
        all.extend(machine.logic.as_ref().map(|_| Process::from(Job::Logic)));
        all.extend([Job::Master, Job::Monitor].map(Process::from));
        all
    }

    /// Its name; that of a standby has the role's letter behind it.
    pub fn name(self, machine: &Machine) -> String {
        match self.job {
            Job::Master if machine.bus.is_some() => "master".into(),
            Job::Master => "plant-sim".into(),
            Job::Fieldbus => match ROLES.get(self.role as usize) {
                Some(word) if self.role > 0 => format!("fieldbus-{word}"),
                _ => "fieldbus".into(),
            },
            Job::Planner => "planner".into(),
            Job::Monitor => "monitor".into(),
            Job::Logic => "logic".into(),
            Job::Servo => {
                let axis = machine.axis_name(self.axis as usize);
                match ROLES.get(self.role as usize) {
                    Some(word) if self.role > 0 => format!("servo-{axis}-{word}"),
                    _ => format!("servo-{axis}"),
                }
            }
        }
    }

    /// The process of this name. A servo's role may stand behind a slash too.
    ///
    /// # Errors
    /// The machine has none of that name: what it may be.
    pub fn parse(name: &str, machine: &Machine) -> Result<Process, String> {
        let others = [Job::Planner, Job::Master, Job::Monitor].map(Process::from);
        let logic = machine.logic.as_ref().map(|_| Process::from(Job::Logic));
        let others = others.into_iter().chain(logic);
        let mut others = others.chain(Process::fieldbus(machine));
        if let Some(process) = others.find(|one| one.name(machine) == name) {
            return Ok(process);
        }
        let Some(servo) = name.strip_prefix("servo-") else {
            let master = Process::from(Job::Master).name(machine);
            let fieldbus: String = Process::fieldbus(machine)
                .map(|process| format!("{}, ", process.name(machine)))
                .collect();
            return Err(format!(
                "must be planner, {master}, {fieldbus}monitor, servo-X (X: letter of an axis) or servo-X/b"
            ));
        };
        let (letter, word) = servo.split_once(['/', '-']).unwrap_or((servo, "a"));
        let role = ROLES.iter().position(|known| *known == word);
        let role = role.ok_or_else(|| format!("role {word:?} must be a or b"))?;
        let axis = machine.axis_index(letter)? as usize;
        let standby = machine.axes.get(axis).is_some_and(|a| a.standby);
        if role > 0 && !standby {
            return Err(format!(
                "axis {letter} has no standby (standby = true in the machine file)"
            ));
        }
        Ok(Process::servo(axis, role))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_process_is_found_by_its_name_and_by_what_the_roster_says_of_it() {
        let text = include_str!("../../machines/xy/machine.toml");
        let mut machine = Machine::parse("machine.toml", text).unwrap();
        machine.axes[0].standby = true;
        let all = Process::all(&machine);
        let names: Vec<String> = all.iter().map(|process| process.name(&machine)).collect();
        assert!(names.contains(&"servo-X-b".into()), "{names:?}");
        for (process, name) in all.into_iter().zip(&names) {
            assert_eq!(Process::parse(name, &machine), Ok(process), "{name}");
            assert_eq!(Process::of(&process.first()), Some(process), "{name}");
        }
    }
}
