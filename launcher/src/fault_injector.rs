//! The launcher's part of a fault script: it does to its processes what the master asks for.

use bus::sample::Job;
use bus::signal_page::{FaultRequest, FaultStep};
use plant_sim::script::faults::FaultScript;
use rustix::process::Signal;

use crate::group::{Death, Group};
use crate::supervisor::Supervisor;

/// What one request came to.
#[derive(Debug, Default)]
pub struct Served {
    /// Who was killed.
    pub death: Option<Death>,
    /// What was done, for the events file: scan, word, process.
    pub event: Option<(u64, &'static str, String)>,
}

/// Serves the request that waits, if there is one.
///
/// # Errors
/// A replacement cannot be started.
pub fn serve(
    script: &FaultScript,
    group: &mut Group,
    supervisor: &Supervisor,
) -> anyhow::Result<Option<Served>> {
    let Some(request) = group.page.launcher_request() else {
        return Ok(None);
    };
    let mut served = Served::default();
    let fault = script.faults.get(request.index);
    let place = fault.and_then(|f| group.place_of(f.process));
    if let (Some(fault), Some(place)) = (fault, place) {
        let replaces = supervisor.replaces(fault.process);
        served = act(group, &request, place, fault.process.job, replaces)?;
    } else {
        tracing::warn!("a fault names a process that this cell does not have");
    }
    group.page.launcher_done(request.ticket);
    Ok(Some(served))
}

fn act(
    group: &mut Group,
    request: &FaultRequest,
    place: usize,
    job: Job,
    replaces: bool,
) -> anyhow::Result<Served> {
    let scan = request.scan;
    let name = group.role_of(place).map(|role| role.name.clone());
    let mut death = None;
    let word = match request.step {
        FaultStep::Kill => {
            death = group.kill_one(place, scan);
            if let Some(death) = &mut death {
                death.replaced = replaces;
                if job == Job::Master && replaces {
                    // No scan passes without it: whoever takes its place is started at once.
                    group.replace(place, scan)?;
                }
            }
            "killed"
        }
        FaultStep::Restart => {
            if replaces && !group.takes_part(place) {
                group.replace(place, scan)?;
            }
            "restarted"
        }
        FaultStep::Stop => {
            group.set_stalled(place, true, scan);
            "stopped"
        }
        FaultStep::Readmit => {
            group.set_stalled(place, false, scan);
            "awaited"
        }
        FaultStep::Continue => {
            group.signal(place, Signal::CONT);
            "continued"
        }
    };
    let event = Some((scan, word, name.unwrap_or_default()));
    Ok(Served { death, event })
}
