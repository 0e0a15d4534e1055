"""A slave's distributed clock (ETG.1000.4, registers 0x0900 to 0x09BF): local time, system time, its control, SYNC0.

The local clock may go wrong by some ppm. The system time is local time + offset. Each system time of the reference clock
that is written here pulls the local clock, as the time control loop of a slave controller does: a quarter of the
difference at once, a 64th of it as speed (critically damped), both bounded.
"""

import struct

RECEIVE_TIMES, SYSTEM_TIME, RECEIVE_TIME_64, OFFSET, DELAY, DIFFERENCE = 0x0900, 0x0910, 0x0918, 0x0920, 0x0928, 0x092C
SPEED_COUNTER, ACTIVATION, SYNC0_START, SYNC0_CYCLE = 0x0930, 0x0981, 0x0990, 0x09A0
CYCLIC_OPERATION, SYNC0 = 1, 2

WIRE_DELAY_NS = 300
STEP_NS_MAX, SPEED_MAX = 10_000, 500e-6
# The clocks of a segment begin at different times.
BASE_NS = 1_000_000_007


def signed(value, bits):
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> bits - 1 else value


class Clock:
    def __init__(self, memory, position, drift_ppm):
        self.memory, self.position = memory, position
        self.drift, self.correction = drift_ppm * 1e-6, 0.0
        self.anchor_ns, self.anchor_local_ns = 0, position * BASE_NS
        self.written_ns, self.pulse = None, None

    def number(self, at, form="<Q"):
        return struct.unpack_from(form, self.memory, at)[0]

    # ---------------------------------------------------------------- time
    def reached(self, now_ns):
        """When a frame that enters the segment now is here."""
        return now_ns + self.position * WIRE_DELAY_NS

    def local(self, now_ns):
        elapsed = now_ns - self.anchor_ns
        return self.anchor_local_ns + elapsed + round(elapsed * (self.drift + self.correction))

    def system(self, now_ns):
        return self.local(now_ns) + self.number(OFFSET) & 0xFFFFFFFFFFFFFFFF

    def show(self, now_ns):
        struct.pack_into("<Q", self.memory, SYSTEM_TIME, self.system(self.reached(now_ns)))

    def note_receive_times(self, now_ns, behind):
        """The times at which a frame went out through the ports; `behind`: how many slaves follow on port 1."""
        local = self.local(self.reached(now_ns))
        back = local + 2 * WIRE_DELAY_NS * behind
        struct.pack_into("<II", self.memory, RECEIVE_TIMES, local & 0xFFFFFFFF, back & 0xFFFFFFFF if behind else 0)
        struct.pack_into("<II", self.memory, RECEIVE_TIMES + 8, 0, 0)
        struct.pack_into("<Q", self.memory, RECEIVE_TIME_64, local & 0xFFFFFFFFFFFFFFFF)

    # ---------------------------------------------------------------- control
    def forget_speed(self):
        self.written_ns = None

    def follow(self, data, now_ns):
        """The reference clock's system time was written here."""
        now_ns = self.reached(now_ns)
        bits = 8 * min(8, len(data))
        wanted = int.from_bytes(data[:8], "little") + self.number(DELAY, "<I")
        difference = signed(self.system(now_ns) - wanted, bits)
        shown = min(abs(difference), 0x7FFFFFFF)
        struct.pack_into("<I", self.memory, DIFFERENCE, shown | (0x80000000 if difference < 0 else 0))
        local = self.local(now_ns)
        if self.written_ns is not None and now_ns > self.written_ns:
            speed = self.correction - difference / 64 / (now_ns - self.written_ns)
            self.correction = max(-SPEED_MAX, min(SPEED_MAX, speed))
        self.written_ns = self.anchor_ns = now_ns
        self.anchor_local_ns = local - max(-STEP_NS_MAX, min(STEP_NS_MAX, round(difference / 4)))

    # ---------------------------------------------------------------- SYNC0
    @property
    def sync0(self):
        """Whether SYNC0 is on (its first pulse may be to come)."""
        return self.memory[ACTIVATION] & (CYCLIC_OPERATION | SYNC0) == (CYCLIC_OPERATION | SYNC0)

    @property
    def cycle_ns(self):
        return self.number(SYNC0_CYCLE, "<I")

    def activate(self, now_ns):
        """The activation register was written. A start that is over already never comes."""
        start = self.number(SYNC0_START)
        self.pulse = start if self.sync0 and self.cycle_ns and start > self.system(now_ns) else None

    def pulse_due_ns(self):
        """When the next SYNC0 is, on the clock of the PC; None: never."""
        if self.pulse is None:
            return None
        local = signed(self.pulse - self.number(OFFSET), 64)
        return self.anchor_ns + round((local - self.anchor_local_ns) / (1 + self.drift + self.correction))

    def next_pulse(self):
        self.pulse += self.cycle_ns
