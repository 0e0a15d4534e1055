"""Answers that are not as they should be: late, twice, lost, damaged, or among frames of others.

Each kind lasts for a number of process-data frames. What is damaged, and how, goes round in a fixed order.
"""

import struct

from esc import LOGICAL

LATE_CYCLES = 3
KINDS = ("late", "duplicate", "lost", "damaged", "stray", "foreign")
OTHER_MASTER = bytes.fromhex("0200000000aa")


def datagrams(frame):
    at = 16
    while True:
        length = struct.unpack_from("<H", frame, at + 6)[0]
        yield at, length & 0x07FF
        if not length & 0x8000:
            return
        at += 12 + (length & 0x07FF)


def with_counter(frame, change):
    for at, size in datagrams(frame):
        if frame[at] in LOGICAL:
            counter = struct.unpack_from("<H", frame, at + 10 + size)[0]
            struct.pack_into("<H", frame, at + 10 + size, change(counter))
    return frame


def flipped(frame, at, bit):
    frame[at] ^= 1 << bit
    return frame


DAMAGES = (
    lambda frame: frame[:max(14, len(frame) // 2)],
    lambda frame: frame[:15],
    # Longer in its header than it is; a datagram of another length; another command; another index.
    lambda frame: flipped(frame, 15, 2),
    lambda frame: flipped(frame, 22, 4),
    lambda frame: flipped(frame, 16, 6),
    lambda frame: flipped(frame, 17, 7),
    lambda frame: with_counter(frame, lambda counter: counter + 1),
    lambda frame: with_counter(frame, lambda counter: 0),
)
# A stray frame comes beside the true answer; with the right index it would be the answer, whatever it holds.
STRAYS = DAMAGES[:6]


def foreign(frame, turn):
    ours = bytes(frame[:6])
    if turn == 0:
        # Another master's broadcast read of the AL status.
        return ours + OTHER_MASTER + struct.pack("<HHBBHHHHHH", 0xA488, 0x100E, 7, 0x55, 3, 0x0130, 2, 0, 8, 3).ljust(46, b"\0")
    if turn == 1:
        # Network variables (EtherCAT type 4).
        return ours + OTHER_MASTER + struct.pack("<HH", 0xA488, 0x4000 | 32) + bytes(range(32))
    if turn == 2:
        return ours + OTHER_MASTER + b"\x08\x06" + bytes(46)
    return ours + OTHER_MASTER + struct.pack("<HH", 0xA488, 0x57FF) + bytes(range(40))


class Troubles:
    def __init__(self, cycle_ns, lockstep):
        self.cycle_ns, self.lockstep = cycle_ns, lockstep
        self.queue, self.held, self.turns, self.done = [], [], {}, dict.fromkeys(KINDS, 0)

    def add(self, kind, count):
        self.queue.append([kind, count])

    def turn(self, kind, of):
        turn = self.turns.get(kind, 0)
        self.turns[kind] = turn + 1
        return turn % of

    def answers(self, answer, number, now_ns):
        """What goes out for the process-data frame with this number."""
        first = self.released(number, now_ns)
        if not self.queue:
            return first + [answer]
        kind = self.queue[0][0]
        self.queue[0][1] -= 1
        if not self.queue[0][1]:
            self.queue.pop(0)
        self.done[kind] += 1
        if kind == "late":
            # In lockstep a time is a number of frames.
            self.held.append((number + LATE_CYCLES if self.lockstep else now_ns + LATE_CYCLES * self.cycle_ns, answer))
            return first
        if kind == "lost":
            return first
        if kind == "damaged":
            return first + [DAMAGES[self.turn(kind, len(DAMAGES))](bytearray(answer))]
        if kind == "stray":
            return first + [STRAYS[self.turn(kind, len(STRAYS))](bytearray(answer)), answer]
        if kind == "foreign":
            return first + [foreign(answer, self.turn(kind, 4)), answer]
        return first + [answer, answer]

    def released(self, number, now_ns):
        now = number if self.lockstep else now_ns
        due = [answer for when, answer in self.held if when <= now]
        if due:
            self.held = [(when, answer) for when, answer in self.held if when > now]
        return due

    def next_ns(self):
        """When the next late answer is due by the clock, or None."""
        return self.held[0][0] if self.held and not self.lockstep else None
