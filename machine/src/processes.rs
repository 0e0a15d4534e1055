//! `[processes]`: how the processes of the cell run in realtime.

use bus::realtime::{self, Priority, Settings};
use bus::sample::Job;
use schemars::JsonSchema;
use serde::Deserialize;

/// How the processes of the cell run in realtime.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Processes {
    /// Whether what the processes touch stays in memory; those with a priority touch the program before their first scan.
    #[schemars(extend("default" = Settings::DEFAULT.lock_memory))]
    pub lock_memory: bool,
    /// Stack that a process with a priority touches before its first scan, so that no page of it is missing there.
    #[schemars(extend("unit" = "KiB", "minimum" = 0, "maximum" = 1024, "default" = Settings::DEFAULT.touch_stack_kb))]
    pub touch_stack_kb: u32,
    /// The same of its heap.
    #[schemars(extend("unit" = "KiB", "minimum" = 0, "maximum" = 65_536, "default" = Settings::DEFAULT.touch_heap_kb))]
    pub touch_heap_kb: u32,
    /// How late the kernel may end a sleep to put wake-ups together; of no effect where SCHED_FIFO is granted.
    #[schemars(extend("unit" = "ns", "minimum" = 1, "maximum" = 1_000_000, "default" = Settings::DEFAULT.timer_slack_ns))]
    pub timer_slack_ns: u32,
    /// Longest time that a process with a priority may use a processor without a pause; then the kernel ends it, so that it does not
    /// keep the PC from everybody else, and it is a lost process ([what follows](faults.md)).
    #[schemars(extend("unit" = "ms", "minimum" = 50, "maximum" = 60_000, "default" = Settings::DEFAULT.busy_max_ms))]
    pub busy_max_ms: u32,
    /// The owner of the fieldbus and its standby: priority 65 where none is named.
    pub fieldbus: OfProcess,
    /// The master, which starts the scans: 60.
    pub master: OfProcess,
    /// The servos: 55.
    pub servo: OfProcess,
    /// The planner: 50.
    pub planner: OfProcess,
    /// The recorder: 0.
    pub monitor: OfProcess,
    /// What asks the machine's own logic, and the logic: 0.
    pub logic: OfProcess,
}

/// What one kind of process has for itself.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct OfProcess {
    /// SCHED_FIFO priority: a higher one goes before a lower one, and any before 0, an ordinary process. None may be below the next in
    /// this order: fieldbus, master, servo, planner, monitor.
    #[schemars(extend("minimum" = 0, "maximum" = 98))]
    pub priority: Option<u32>,
    /// Processors, as the kernel numbers them; none for all that the launcher may use.
    #[schemars(length(max = 64), extend("default" = []), inner(range(min = 0, max = 1023)))]
    pub processors: Vec<u32>,
}

impl Processes {
    /// Every kind of process with its key; none of them waits for one behind it, and the last is waited for by none.
    pub fn jobs(&self) -> [(Job, &'static str, Priority, &OfProcess); 6] {
        [
            (
                Job::Fieldbus,
                "fieldbus",
                Priority::Fieldbus,
                &self.fieldbus,
            ),
            (Job::Master, "master", Priority::Master, &self.master),
            (Job::Servo, "servo", Priority::Servo, &self.servo),
            (Job::Planner, "planner", Priority::Planner, &self.planner),
            (Job::Monitor, "monitor", Priority::Ordinary, &self.monitor),
            (Job::Logic, "logic", Priority::Ordinary, &self.logic),
        ]
    }

    /// How a process that does this runs in realtime, and its processors.
    pub fn of(&self, job: Job) -> (Settings, Vec<usize>) {
        let of_job = self.jobs().into_iter().find(|(one, ..)| *one == job);
        let settings = Settings {
            priority: of_job.and_then(|(.., of_job)| of_job.priority),
            lock_memory: self.lock_memory,
            touch_stack_kb: self.touch_stack_kb,
            touch_heap_kb: self.touch_heap_kb,
            timer_slack_ns: self.timer_slack_ns,
            busy_max_ms: self.busy_max_ms,
        };
        let processors = of_job.iter().flat_map(|(.., of_job)| &of_job.processors);
        (settings, processors.map(|&one| one as usize).collect())
    }

    /// Whether every process can be kept on its processors here.
    ///
    /// # Errors
    /// This PC has not all of them, or not for this user.
    pub fn check_here(&self) -> Result<(), String> {
        for (job, key, ..) in self.jobs() {
            let (_, wanted) = self.of(job);
            let missing = realtime::missing(&wanted);
            if !missing.is_empty() {
                let [wanted, missing, has] =
                    [wanted, missing, realtime::processors()].map(|list| realtime::list(&list));
                return Err(format!(
                    "processes.{key}.processors = [{wanted}]: this PC has no processor {missing} for it; it has {has}"
                ));
            }
        }
        Ok(())
    }
}
