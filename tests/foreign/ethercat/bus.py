"""The slaves of a segment on one cable: which of them a frame reaches, in what order things happen, what is told of it."""

from esc import INIT, OP, frame, is_process_data
from trouble import Troubles

ENABLED, STATE = 0x27, 0x6F


class Segment:
    def __init__(self, slaves, cycle_us, lockstep, by_clock, record=None):
        self.slaves, self.cycle_ns, self.lockstep, self.by_clock = slaves, cycle_us * 1000, lockstep, by_clock
        self.record, self.control = record, None
        self.troubles = Troubles(self.cycle_ns, lockstep)
        self.number, self.frames, self.duplicates, self.output_frames = 0, 0, 0, 0
        self.before, self.enabled_frame = b"", None
        self.muted, self.mute_until = 0, None
        self.now_ns = 0
        self.cut, self.reached, self.cut_within = set(), slaves, None
        # How many more frames without process data come through before the cable breaks before all drives.
        self.start_up_frames = None
        self.was_enabled = [False] * len(slaves)
        self.left = [[] for _ in slaves]
        for slave in slaves:
            slave.observer = self.observe
        self.link()

    # ---------------------------------------------------------------- the cable
    def link(self):
        """After a cable was cut or put back."""
        count = len(self.slaves)
        for position, slave in enumerate(self.slaves):
            end = min([cut for cut in self.cut if cut > position], default=count)
            slave.show_link(end - 1 - position)
        self.reached = self.slaves[:min(self.cut, default=count)]

    def reached_by(self, datagram):
        """Which slaves a datagram of the frame reaches: the cable may be cut while the frame is on it."""
        if self.cut_within and datagram >= self.cut_within[0]:
            return self.reached[:self.cut_within[1]]
        return self.reached

    def power_cycle(self, slave):
        slave.application.power_cycle()
        slave.power_on()
        self.observe(slave, None, self.now_ns)

    def exchange_places(self, one, other):
        """Somebody puts the cables back in another order: the slaves were without power meanwhile."""
        slaves = self.slaves
        slaves[one], slaves[other] = slaves[other], slaves[one]
        for place in (one, other):
            slaves[place].position = place
            self.power_cycle(slaves[place])
        self.link()

    def reset(self, slave):
        """Somebody's tool sends it to INIT."""
        slave.lose(INIT, 0, self.now_ns)

    def mute(self, milliseconds):
        """Frames do not arrive; in lockstep a time is a number of frames."""
        self.mute_until = milliseconds * 1e6, None

    def is_muted(self, now_ns):
        if self.mute_until is None:
            return False
        length_ns, begun_ns = self.mute_until
        if begun_ns is None:
            begun_ns = now_ns
            self.mute_until = length_ns, begun_ns
        if now_ns - begun_ns >= length_ns:
            self.mute_until = None
            return False
        return True

    # ---------------------------------------------------------------- frames
    def take(self, received, now_ns):
        """A frame from the master; in lockstep the time is that of its number. Returns what goes back."""
        data = is_process_data(received)
        self.number += data
        if self.lockstep:
            now_ns = self.number * self.cycle_ns
        self.now_ns = now_ns
        if data:
            self.control.before_frame(self.number)
        if not data:
            self.count_start_up()
        if self.is_muted(now_ns):
            self.muted += 1
            return []
        for slave in self.reached:
            slave.frame_number = self.number
        written = sum(slave.output_frames for slave in self.reached)
        answer = frame(self.reached_by, received, now_ns) if self.reached else None
        if answer is None:
            return []
        self.frames += 1
        if not data:
            return [answer]
        if sum(slave.output_frames for slave in self.reached) > written:
            self.count_outputs(received, now_ns)
        if self.lockstep:
            self.pass_time_behind_cut(now_ns)
        if self.cut_within:
            self.cut.add(self.cut_within[1])
            self.cut_within = None
            self.link()
        return self.troubles.answers(answer, self.number, now_ns)

    def count_start_up(self):
        if self.start_up_frames == 0:
            self.start_up_frames = None
            self.cut.add(0)
            self.link()
        elif self.start_up_frames:
            self.start_up_frames -= 1

    def count_outputs(self, received, now_ns):
        self.output_frames += 1
        self.duplicates += received[16:] == self.before
        self.before = received[16:]
        if self.record and self.by_clock:
            for slave in self.reached:
                if slave.acting_frame == self.number:
                    self.record.frame(slave, self.number, now_ns)
        if self.enabled_frame is None and self.all_enabled():
            self.enabled_frame = self.number

    def pass_time_behind_cut(self, now_ns):
        """What no frame reaches goes on with what it was told last, and its watchdog is in force."""
        for slave in self.slaves[len(self.reached):]:
            slave.exchange(now_ns)
            slave.look_at_watchdog(now_ns)

    def all_enabled(self):
        words = [slave.application.statusword for slave in self.reached]
        return all(word is None or word & STATE == ENABLED for word in words)

    # ---------------------------------------------------------------- time
    def look_at_watchdogs(self, now_ns):
        for slave in self.slaves:
            slave.look_at_watchdog(now_ns)

    def next_due_ns(self, now_ns):
        return min(slave.pace.due_ns(slave, now_ns) for slave in self.slaves)

    def run_until(self, until_ns, now_ns):
        """By the clock: all steps that are due up to a time, in their order."""
        while True:
            due_ns, slave = min(((slave.pace.due_ns(slave, now_ns), slave) for slave in self.slaves), key=lambda due: due[0])
            if due_ns > until_ns:
                return
            slave.pace.step(slave, due_ns, now_ns)
            slave.look_at_watchdog(due_ns)

    # ---------------------------------------------------------------- what is told
    def observe(self, slave, outputs, now_ns):
        """After each step and change of state."""
        word = slave.application.statusword
        enabled = word is not None and word & STATE == ENABLED
        place = slave.position
        if enabled != self.was_enabled[place]:
            self.was_enabled[place] = enabled
            if not enabled:
                self.left[place].append({"frame": self.number, "time_ns": now_ns, "statusword": word, "al_state": slave.state})
        if self.record and outputs is not None:
            self.record.step(slave, outputs, now_ns)

    def status(self):
        return {
            "frames": self.frames, "process_data_frames": self.number, "output_frames": self.output_frames,
            "duplicates": self.duplicates, "muted": self.muted, "enabled_frame": self.enabled_frame, "cut": sorted(self.cut),
            "troubles": self.troubles.done, "drives": [self.status_of(slave) for slave in self.slaves]}

    def status_of(self, slave):
        left = self.left[slave.position]
        return {
            "name": slave.application.name, "reached": slave in self.reached, "al_state": slave.state, "al_code": slave.code,
            "operational": slave.state == OP, "statusword": slave.application.statusword,
            "position": slave.application.position, "output_frames": slave.output_frames,
            "sync": slave.pace.kinds(slave)[0], "sync_missed": slave.pace.missed, "sync_errors": slave.pace.errors,
            "steps_skipped": slave.pace.skipped, "left_operation_enabled": len(left), "left": left[-3:]}
