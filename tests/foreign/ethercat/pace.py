"""When a drive takes its outputs and moves on by a cycle: with the frame that brings them, or by its own clock.

By its own clock it runs on where a frame is missing, with the outputs that came last, as a real drive does: at SYNC0 where
the master has activated it, else free, in the middle between the first outputs that came in OP and the next ones.
"""

from esc import ERROR, NO_SYNC, OP, PREOP, SAFEOP, SYNC_CYCLE, SYNC_ERROR

FREE_RUN, BY_SM, BY_SM2, BY_SYNC0 = 0, 1, 0x22, 2
# ETG.1020: a cycle without process data counts three, one with them takes one back; above the limit the drive alarms.
MISSED, CAME, LIMIT = 3, 1, 9
# A stalled PC is made up for by this many steps; frames that waited meanwhile keep their place between them.
STEPS_BEHIND_MAX = 50


class ByFrame:
    missed = errors = skipped = 0
    limit = LIMIT

    def __init__(self, cycle_us):
        self.cycle_us = cycle_us

    def kinds(self, esc):
        """Types of synchronisation in force, of outputs and inputs (0x1C32:1, 0x1C33:1)."""
        return BY_SM, BY_SM2

    def hinders(self, esc, wanted):
        return 0

    def entered(self, esc, before, now_ns):
        if esc.state & 0x0F == SAFEOP and before == PREOP:
            esc.exchange(now_ns)

    def outputs_came(self, esc, now_ns):
        if esc.state & 0x0F in (SAFEOP, OP):
            esc.exchange(now_ns)


class ByClock:
    def __init__(self, cycle_us):
        self.cycle_us, self.cycle_ns = cycle_us, cycle_us * 1000
        self.free_ns, self.waits_for_outputs = None, False
        self.fresh, self.missed, self.errors, self.skipped = False, 0, 0, 0
        self.limit = LIMIT

    def kinds(self, esc):
        return (BY_SYNC0, BY_SYNC0) if esc.clock.sync0 else (FREE_RUN, FREE_RUN)

    def hinders(self, esc, wanted):
        if not esc.clock.sync0:
            return 0
        if esc.clock.cycle_ns != self.cycle_ns:
            return SYNC_CYCLE
        return NO_SYNC if wanted == OP and esc.clock.pulse is None else 0

    def entered(self, esc, before, now_ns):
        self.errors = self.missed = 0
        self.waits_for_outputs = esc.state == OP

    def outputs_came(self, esc, now_ns):
        self.fresh = True
        if self.waits_for_outputs:
            self.waits_for_outputs = False
            if not self.at_sync0(esc):
                self.free_ns = now_ns + self.cycle_ns // 2

    def at_sync0(self, esc):
        return esc.clock.sync0 and esc.clock.pulse is not None

    def due_ns(self, esc, now_ns):
        """When the next step is due; now_ns is the first time that it is asked."""
        due = esc.clock.pulse_due_ns() if self.at_sync0(esc) else self.free_ns
        if due is None:
            due = self.free_ns = now_ns + self.cycle_ns
        return due

    def step(self, esc, due_ns, now_ns):
        judged = self.at_sync0(esc) and esc.state == OP and not self.waits_for_outputs
        esc.exchange(due_ns)
        behind = max(0, (now_ns - due_ns) // self.cycle_ns - STEPS_BEHIND_MAX)
        self.skipped += behind
        self.free_ns = due_ns + round(self.cycle_ns * (1 + behind) / (1 + esc.clock.drift))
        for _ in range(1 + behind if self.at_sync0(esc) else 0):
            esc.clock.next_pulse()
        if judged:
            self.judge(esc, due_ns)
        self.fresh = False

    def judge(self, esc, now_ns):
        if self.fresh:
            self.errors = max(0, self.errors - CAME)
            return
        self.errors += MISSED
        self.missed += 1
        if self.errors > self.limit:
            esc.lose(SAFEOP | ERROR, SYNC_ERROR, now_ns)
