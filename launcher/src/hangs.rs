//! Processes that live and do not answer: found by their last answers, in realtime. In lockstep the master waits for
//! everybody and says itself who does not answer.

use std::time::{Duration, Instant};

use bus::sample::Job;
use bus::service::RECORDER_DEPTH_SCANS;
use rustix::process::Signal;

use crate::group::Group;

/// So long without an answer a process counts as hung. The machine goes on without it long before: a standby takes over in
/// the same scan, windows end at rest, drives have their watchdog.
fn patience(job: Job) -> Duration {
    match job {
        Job::Servo => Duration::from_secs(1),
        Job::Monitor | Job::Master | Job::Fieldbus => Duration::from_secs(5),
        // It waits for its program as long as that may take.
        Job::Logic => Duration::from_secs(60),
        // It may be reading a long program.
        Job::Planner => Duration::from_secs(20),
    }
}

/// What a process was last seen to have done.
#[derive(Debug, Clone, Copy)]
struct Seen {
    scans: u64,
    since: Instant,
}

/// Watches the answers.
#[derive(Debug, Default)]
pub struct Hangs {
    seen: Vec<Option<Seen>>,
}

impl Hangs {
    /// Kills whoever hangs, so that another process can have its place; it is reaped as any other death. Returns the names.
    pub fn end(&mut self, group: &Group) -> Vec<String> {
        let mut hung = Vec::new();
        for place in 0..group.places() {
            let Some(role) = group.role_of(place) else {
                continue;
            };
            let scans = match role.process.job {
                Job::Master => Some(group.newest_scan()),
                Job::Monitor => Some(group.page.recorded_scans()),
                Job::Servo | Job::Planner | Job::Logic => group.page.answered_scan(place),
                // It answers the master alone; its standby sees when it hangs, and the drives have their watchdogs.
                Job::Fieldbus => None,
            };
            if self.seen.len() <= place {
                self.seen.resize(place + 1, None);
            }
            let Some(slot) = self.seen.get_mut(place) else {
                continue;
            };
            let Some(scans) = scans.filter(|_| group.takes_part(place)) else {
                *slot = None;
                continue;
            };
            let now = Instant::now();
            let seen = slot.get_or_insert(Seen { scans, since: now });
            if seen.scans != scans {
                *seen = Seen { scans, since: now };
            }
            // Who has answered the newest scan has nothing to do. The launcher may not have seen that one yet; what is further
            // ahead is no scan that anybody has answered.
            let ahead_max = RECORDER_DEPTH_SCANS as u64;
            let idle = role.process.job != Job::Master
                && (group.newest_scan()..=group.newest_scan().saturating_add(ahead_max))
                    .contains(&scans);
            if idle {
                seen.since = now;
            }
            if now.duration_since(seen.since) > patience(role.process.job) {
                tracing::error!("{} lives but does not answer: killed", role.name);
                group.signal(place, Signal::KILL);
                hung.push(role.name.clone());
                *slot = None;
            }
        }
        hung
    }
}
