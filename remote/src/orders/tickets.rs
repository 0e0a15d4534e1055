//! Tickets: what waited on its way for long moves nothing.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::{Duration, Instant};

/// So long after it was given an order counts with a ticket.
pub(super) const TICKET_LIFE: Duration = Duration::from_secs(3);
/// Tickets that wait for their orders; the oldest goes.
const TICKETS_MAX: usize = 16;

/// Tickets that were given and not used.
#[derive(Debug, Default)]
pub(super) struct Tickets {
    given: Vec<(u64, Instant)>,
}

impl Tickets {
    pub(super) fn give(&mut self, now: Instant) -> u64 {
        // Hash maps begin with a random number of the system's.
        let ticket = RandomState::new().build_hasher().finish().max(1);
        if self.given.len() >= TICKETS_MAX {
            self.given.remove(0);
        }
        self.given.push((ticket, now));
        ticket
    }

    /// Whether an order counts with this ticket, which is used up by it.
    pub(super) fn take(&mut self, ticket: u64, now: Instant) -> bool {
        let found = self.given.iter().position(|(given, _)| *given == ticket);
        let Some(index) = found else { return false };
        let (_, at) = self.given.remove(index);
        now.duration_since(at) <= TICKET_LIFE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ticket_counts_once_and_not_for_long() {
        let (mut tickets, now) = (Tickets::default(), Instant::now());
        let ticket = tickets.give(now);
        assert!(!tickets.take(ticket.wrapping_add(1), now));
        assert!(tickets.take(ticket, now + TICKET_LIFE));
        assert!(!tickets.take(ticket, now));
        let old = tickets.give(now);
        assert!(!tickets.take(old, now + TICKET_LIFE + Duration::from_millis(1)));
        let first = tickets.give(now);
        for _ in 0..TICKETS_MAX {
            tickets.give(now);
        }
        assert!(!tickets.take(first, now) && tickets.given.len() == TICKETS_MAX);
    }
}
