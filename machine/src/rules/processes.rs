//! Rules of `[processes]`: a process goes before those that wait for it, and a processor is named once.

use bus::sample::Job;

use crate::machine::Machine;
use crate::settings_file::Rules;

pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    let jobs = machine.processes.jobs();
    let jobs = jobs.map(|(job, key, role, of_job)| {
        let level = of_job.priority.unwrap_or(role.level());
        (job, key, f64::from(level), &of_job.processors)
    });
    for (first, next) in jobs.iter().zip(jobs.iter().skip(1)) {
        let is_ordered = next.0 != Job::Logic;
        if is_ordered && (first.0 != Job::Fieldbus || machine.bus.is_some()) {
            let (path, low) = (
                ["processes", first.1, "priority"],
                format!("the priority of {}", next.1),
            );
            rules.at_least(&path, None, first.2, "", &low, next.2);
        }
    }
    for (_, key, _, processors) in jobs {
        let mut named = processors.clone();
        named.sort_unstable();
        if let Some([one, _]) = named.windows(2).find(|pair| pair.first() == pair.last()) {
            let what = format!("names processor {one} twice");
            rules.say(&["processes", key, "processors"], None, &what);
        }
    }
}
