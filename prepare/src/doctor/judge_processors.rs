//! Judges the processors: facts in, findings out.

use super::facts::Facts;
use super::finding::Finding;
use bus::realtime::list;

/// Processors from which on some can be given to a cell alone.
const ENOUGH_TO_ISOLATE: usize = 4;
/// Idle states that take longer to leave than this, in µs, are felt in a scan of 1 ms.
const IDLE_EXIT_US: u64 = 50;

/// Everything about processors.
pub fn judge(facts: &Facts) -> Vec<Finding> {
    let judges = [count, governor, idle, threads, isolated];
    judges.iter().filter_map(|judge| judge(facts)).collect()
}

fn count(facts: &Facts) -> Option<Finding> {
    let what = "processors";
    let count = facts.processors.len();
    if count >= 2 {
        return Some(Finding::fine(what, count.to_string()));
    }
    let why = "a cell in real time keeps one busy; nothing else of this PC would run beside it";
    let change =
        ["nproc; taskset -pc $$    # is it the PC that has one, or is this process kept on one?"];
    Some(Finding::better(what, count.to_string(), why, &change))
}

fn governor(facts: &Facts) -> Option<Finding> {
    let what = "CPU governor";
    if facts.governors.is_empty() {
        return Some(Finding::fine(
            what,
            "none: the kernel does not change the frequency",
        ));
    }
    let found = facts.governors.join(", ");
    if facts
        .governors
        .iter()
        .all(|governor| governor == "performance")
    {
        return Some(Finding::fine(what, found));
    }
    Some(Finding::better(
        what,
        found,
        "a processor that has slowed down takes its time to get quick again: a cell is busy for a small part of each scan",
        &[
            "apt install linux-cpupower && cpupower frequency-set --governor performance",
            "# for good: a unit that does it at every start, docs/howto/service.md",
        ],
    ))
}

fn idle(facts: &Facts) -> Option<Finding> {
    let what = "idle states";
    let (exit_us, name) = facts.idle_exit.as_ref()?;
    let found = format!("deepest {name}, left in {exit_us} µs");
    if *exit_us <= IDLE_EXIT_US {
        return Some(Finding::fine(what, found));
    }
    Some(Finding::better(
        what,
        found,
        "a processor that sleeps deeply between two scans wakes that much later",
        &[
            "cpupower idle-set --disable-by-latency 20",
            "# for good: processor.max_cstate=1 intel_idle.max_cstate=1 on the kernel's command line",
        ],
    ))
}

fn threads(facts: &Facts) -> Option<Finding> {
    let what = "SMT";
    if !facts.smt_active {
        return Some(Finding::fine(what, "off"));
    }
    Some(Finding::better(
        what,
        "on",
        "two processors share one core: what the neighbour does makes a scan longer",
        &[
            "echo off > /sys/devices/system/cpu/smt/control",
            "# for good: nosmt on the kernel's command line",
        ],
    ))
}

fn isolated(facts: &Facts) -> Option<Finding> {
    let what = "isolated processors";
    if facts.isolated.is_empty() {
        let cpus = &facts.processors;
        if cpus.len() < ENOUGH_TO_ISOLATE {
            return Some(Finding::fine(what, "none; there are none to spare"));
        }
        let spare = cpus.split_at(cpus.len() / 2).1;
        let spare = list(spare);
        return Some(Finding::better(
            what,
            "none",
            "whatever else runs, interrupts among it, runs on the processors of the cell too",
            &[
                &format!(
                    "# in GRUB_CMDLINE_LINUX of /etc/default/grub: isolcpus=managed_irq,domain,{spare}"
                ),
                &format!("#   nohz_full={spare} rcu_nocbs={spare} irqaffinity=0"),
                "update-grub && reboot",
                &format!(
                    "# then name them in [processes] of the machine file, or: taskset -c {spare} quadrant …"
                ),
            ],
        ));
    }
    let found = list(&facts.isolated);
    if facts.interrupts_on_isolated.is_empty() {
        return Some(Finding::fine(what, found));
    }
    let interrupts: Vec<String> = facts
        .interrupts_on_isolated
        .iter()
        .map(u32::to_string)
        .collect();
    let interrupts = interrupts.join(" ");
    Some(Finding::better(
        what,
        format!("{found}; interrupts {interrupts} go there"),
        "an interrupt goes before every process, whatever its priority",
        &[
            &format!("for i in {interrupts}; do echo 0 > /proc/irq/$i/smp_affinity_list; done"),
            "systemctl disable --now irqbalance    # else it puts them back",
        ],
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    fn eight() -> Facts {
        Facts {
            processors: (0..8).collect(),
            governors: vec!["performance".into()],
            idle_exit: Some((2, "C1".into())),
            isolated: vec![6, 7],
            ..Facts::default()
        }
    }

    fn finding(of: &str, facts: &Facts) -> Finding {
        let found = judge(facts).into_iter().find(|f| f.what == of);
        found.unwrap_or_else(|| panic!("no finding {of:?}"))
    }

    #[test]
    fn processors_that_are_kept_for_the_cell_have_nothing_to_change() {
        for finding in judge(&eight()) {
            assert_eq!(finding.grade, Grade::Fine, "{finding:?}");
        }
    }

    #[test]
    fn each_thing_that_could_be_better_says_why_and_what_to_change() {
        let mut facts = eight();
        facts.processors = vec![0];
        facts.governors = vec!["performance".into(), "powersave".into()];
        facts.idle_exit = Some((133, "C6".into()));
        facts.smt_active = true;
        facts.interrupts_on_isolated = vec![24, 31];
        for finding in judge(&facts) {
            assert_eq!(finding.grade, Grade::Better, "{finding:?}");
            assert!(!finding.why.is_empty() && !finding.change.is_empty());
        }
        let interrupts = finding("isolated processors", &facts);
        assert!(interrupts.change.iter().any(|line| line.contains("24 31")));
    }

    #[test]
    fn the_upper_half_is_proposed_for_the_cell_and_nothing_where_there_is_none_to_spare() {
        let mut facts = eight();
        facts.isolated.clear();
        let proposal = finding("isolated processors", &facts);
        assert!(proposal.change.iter().any(|line| line.contains("4,5,6,7")));
        facts.processors = vec![0, 1];
        assert_eq!(finding("isolated processors", &facts).grade, Grade::Fine);
    }
}
