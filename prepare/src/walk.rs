//! A program planned from its start to its end: one that is held whole, or one that is too long for that, which is planned as it is read,
//! and forgotten behind.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::bail;
use audit::{Ahead, ProgramWalk, Totals};
use launcher::check::Checked;
use path::path_part::PathPart;
use path::window::{PlannedSetpoint, WindowPlanner};
use planner::{ProgramText, Streamed, Survey};

/// Time between two words on the way.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// Plans the program as the planner process would, window by window, up to so many setpoints.
///
/// # Errors
/// The path cannot be planned within the limits; and what `each` says.
pub fn walk<A: Ahead>(
    checked: &Checked,
    ahead: &mut A,
    setpoints_max: u64,
    mut each: impl FnMut(&PathPart, &PlannedSetpoint) -> anyhow::Result<()>,
) -> anyhow::Result<Totals>
where
    anyhow::Error: From<A::Error>,
{
    let walk = ProgramWalk {
        feed_override: 1.0,
        setpoints_per_window: checked.machine.scan.interpolation_period_scans,
        setpoints_max,
    };
    let mut result = Ok(());
    let totals = walk.walk(ahead, |path, setpoint| {
        result = each(path, setpoint);
        match result {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    })?;
    if let Some(fault) = &totals.fault {
        bail!("the plan breaks its own limits: {fault}; this is a defect of quadrant");
    }
    result.map(|()| totals)
}

/// A long program, and when something was said of it last.
struct Long<'a> {
    file: &'a Path,
    streamed: Streamed,
    told: Instant,
}

impl Ahead for Long<'_> {
    type Error = anyhow::Error;

    fn windows(&mut self) -> &mut WindowPlanner {
        self.streamed.windows()
    }

    fn read_on(&mut self, element: u32) -> anyhow::Result<()> {
        self.streamed.read_on(element)?;
        if self.told.elapsed() > TELL_EVERY {
            self.told = Instant::now();
            tracing::info!("{}: planned up to element {element}", self.file.display());
        }
        Ok(())
    }
}

/// Plans all of a long program; what it comes to, and what was read.
///
/// # Errors
/// As [`walk`].
pub(crate) fn walk_long(
    checked: &Checked,
    file: &Path,
    each: impl FnMut(&PathPart, &PlannedSetpoint) -> anyhow::Result<()>,
) -> anyhow::Result<(Totals, Survey)> {
    let text = ProgramText::File(file.to_path_buf());
    let mut long = Long {
        file,
        streamed: Streamed::new(&checked.machine, &text, checked.start)?,
        told: Instant::now(),
    };
    let totals = walk(checked, &mut long, u64::MAX, each)?;
    Ok((totals, long.streamed.survey(text.name())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use launcher::check::{Depth, load};

    #[test]
    fn a_program_that_is_planned_as_it_is_read_is_the_same_in_every_setpoint() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
        for (machine, program) in [
            ("xy", "xy/programs/circle-r25-f3000.ngc"),
            ("xyz-mill", "xyz-mill/programs/drill-plate.ngc"),
        ] {
            let file = root.join(program);
            let checked = load(&root.join(machine), Some(&file), Depth::Whole).expect("good");
            let mut whole = Vec::new();
            let mut windows = checked.planner().expect("a planner");
            let totals = walk(&checked, &mut windows, u64::MAX, |_, setpoint| {
                whole.push(setpoint.position_increments);
                Ok(())
            });
            let mut read = Vec::new();
            let as_read = walk_long(&checked, &file, |_, setpoint| {
                read.push(setpoint.position_increments);
                Ok(())
            });
            let (as_read, _) = as_read.expect("planned");
            assert_eq!(as_read, totals.expect("planned"));
            assert!(whole.len() > 1_000 && read == whole, "{program}");
        }
    }
}
