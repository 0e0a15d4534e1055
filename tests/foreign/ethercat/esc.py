"""An EtherCAT slave controller's data link: registers, SII, FMMUs, sync managers, AL states (ETG.1000.4, ETG.1000.6).

It serves one slave. What the slave is, an application says: `process_data_bytes()`, `exchange()`, `comms_lost()`. When
it moves on, a pace says (pace.py), what time it is, a clock (clock.py).
"""

import struct

from clock import ACTIVATION, OFFSET, RECEIVE_TIMES, SPEED_COUNTER, SYSTEM_TIME, Clock

INIT, PREOP, BOOT, SAFEOP, OP, ERROR = 1, 2, 3, 4, 8, 0x10

# Registers.
ADDRESS, DL_STATUS, AL_CONTROL, AL_STATUS, AL_CODE = 0x0010, 0x0110, 0x0120, 0x0130, 0x0134
WATCHDOG_DIVIDER, SM_WATCHDOG, WATCHDOG_STATUS = 0x0400, 0x0420, 0x0440
SII_CONTROL, SII_ADDRESS, SII_DATA = 0x0502, 0x0504, 0x0508
FMMU, SM = 0x0600, 0x0800
FMMUS, SMS = 4, 4
MAILBOX_OUT, MAILBOX_IN, OUTPUTS, INPUTS = range(SMS)
OFF = (0, 0, 0, False)

# AL status codes.
INVALID_TRANSITION, UNKNOWN_STATE, BAD_MAILBOX = 0x0011, 0x0012, 0x0016
SYNC_ERROR, WATCHDOG, BAD_OUTPUTS, BAD_INPUTS, NO_SYNC, SYNC_CYCLE = 0x001A, 0x001B, 0x001D, 0x001E, 0x002D, 0x0035


class Esc:
    """One slave. `managers`: start and length of its mailboxes, as its SII gives them; `mailbox`: None where it has none."""

    def __init__(self, position, sii, application, mailbox, pace, drift_ppm=0.0):
        self.position, self.sii, self.application, self.mailbox = position, sii, application, mailbox
        self.managers, self.pace = application.managers, pace
        self.out_sm, self.in_sm = (OUTPUTS, INPUTS) if mailbox else (0, 1)
        # Called after each step and each change of state: the slave, the outputs that acted (None: no step), the time.
        self.observer = lambda slave, outputs, now_ns: None
        self.drift_ppm, self.watchdog_fixed, self.behind = drift_ppm, False, 0
        self.frame_number, self.acting_frame = 0, 0
        self.power_on()

    def power_on(self):
        self.memory = bytearray(0x4000)
        self.clock = Clock(self.memory, self.position, self.drift_ppm)
        self.state, self.code = INIT, 0
        self.mailbox_full, self.answer = False, None
        self.outputs_written, self.output_ns, self.output_frames = False, 0, 0
        self.fmmus, self.sms = [], [OFF] * SMS
        if self.mailbox:
            self.mailbox.clear()
        # ESC type, revision, build, FMMUs, sync managers, kB of RAM, ports 0 and 1 MII, features: DC, 64 bits.
        struct.pack_into("<BBHBBBBH", self.memory, 0, 0x11, 1, 0, FMMUS, SMS, 8, 0x0F, 0x000C)
        struct.pack_into("<H", self.memory, WATCHDOG_DIVIDER, 2498)
        struct.pack_into("<H", self.memory, 0x0410, 1000)
        struct.pack_into("<H", self.memory, SM_WATCHDOG, 1000)
        struct.pack_into("<H", self.memory, WATCHDOG_STATUS, 1)
        self.show_link(self.behind)
        self.show_state()

    def show_link(self, behind):
        """`behind`: how many slaves answer on port 1."""
        self.behind = behind
        # Link and communication on ports 0 and 1, or 0 only; the loops of the others are closed.
        struct.pack_into("<H", self.memory, DL_STATUS, 0x5A31 if behind else 0x5611)

    # ---------------------------------------------------------------- registers and memory
    def word(self, at):
        return struct.unpack_from("<H", self.memory, at)[0]

    def read(self, at, length, now_ns):
        """What a datagram reads here, or None: a mailbox that holds nothing."""
        start, size, _, on = self.sms[MAILBOX_IN] if self.mailbox else OFF
        if on and start <= at < start + size:
            if self.answer is None:
                return None
            data = self.answer.ljust(size, b"\0")[at - start:at - start + length]
            if at + length >= start + size:
                self.answer = self.mailbox.next_answer()
                self.show_mailboxes()
            return data
        if at <= SYSTEM_TIME < at + length:
            self.clock.show(now_ns)
        if at + length > len(self.memory):
            return None
        return bytes(self.memory[at:at + length])

    def write(self, at, data, now_ns):
        """Whether a datagram could write here."""
        start, size, _, on = self.sms[MAILBOX_OUT] if self.mailbox else OFF
        if on and start <= at < start + size:
            if self.mailbox_full:
                return False
            self.memory[at:at + len(data)] = data
            if at + len(data) >= start + size:
                self.mailbox_full = True
            return True
        if at + len(data) > len(self.memory):
            return False
        if not self.is_own(at, data):
            self.memory[at:at + len(data)] = data
        start, size, _, on = self.sms[self.out_sm]
        if on and at < start + size and at + len(data) > start:
            self.outputs_written, self.output_ns = True, now_ns
        self.follow(at, data, now_ns)
        return True

    def is_own(self, at, data):
        """Registers that the slave writes itself."""
        if self.watchdog_fixed and WATCHDOG_DIVIDER <= at <= SM_WATCHDOG:
            return True
        return at in (AL_STATUS, AL_CODE, DL_STATUS, RECEIVE_TIMES, SYSTEM_TIME) and len(data) <= 8

    def follow(self, at, data, now_ns):
        """What a write to a register does."""
        end = at + len(data)
        if at <= AL_CONTROL < end:
            self.output_ns = now_ns
            self.request(self.word(AL_CONTROL), now_ns)
        if at <= SII_CONTROL + 1 < end:
            self.read_sii()
        if FMMU <= at < FMMU + 16 * FMMUS:
            self.fmmus = [self.fmmu(index) for index in range(FMMUS) if self.fmmu(index)]
        if SM <= at < SM + 8 * SMS:
            self.sms = [self.sync_manager(index) for index in range(SMS)]
            self.show_mailboxes()
        if RECEIVE_TIMES <= at < 0x0A00:
            self.follow_clock(at, data, now_ns)

    def follow_clock(self, at, data, now_ns):
        end = at + len(data)
        if at == RECEIVE_TIMES:
            self.clock.note_receive_times(now_ns, self.behind)
        elif at == SYSTEM_TIME:
            self.clock.follow(data, now_ns)
        elif at < OFFSET + 8 and end > OFFSET or at <= SPEED_COUNTER < end:
            self.clock.forget_speed()
        elif at <= ACTIVATION < end:
            self.clock.activate(self.clock.reached(now_ns))

    def fmmu(self, index):
        logical, length, first, last, physical, bit, kind, on = struct.unpack_from("<IHBBHBBB", self.memory, FMMU + 16 * index)
        return (logical, length, first, last, physical, bit, kind) if on & 1 and length else None

    def sync_manager(self, index):
        start, length, control, _, on = struct.unpack_from("<HHBBB", self.memory, SM + 8 * index)
        return start, length, control, bool(on & 1 and length)

    def read_sii(self):
        control = self.word(SII_CONTROL)
        if control & 0x0100:
            word = struct.unpack_from("<I", self.memory, SII_ADDRESS)[0]
            self.memory[SII_DATA:SII_DATA + 8] = self.sii[2 * word:2 * word + 8].ljust(8, b"\xff")
        # Reads of eight bytes, never busy, no error.
        struct.pack_into("<H", self.memory, SII_CONTROL, 0x0040)

    # ---------------------------------------------------------------- process data
    def logical(self, at, data, reads, writes, now_ns):
        """Reads and writes what is mapped of a logical datagram; how the working counter grows."""
        was_read = was_written = False
        before = bytes(data)
        for logical, length, first, last, physical, bit, kind in self.fmmus:
            if logical >= at + len(data) or logical + length <= at:
                continue
            if kind & 2 and writes:
                was_written |= self.map_out(before, logical - at, length, first, last, physical, bit)
            if kind & 1 and reads:
                was_read |= self.map_in(data, logical - at, length, first, last, physical, bit)
        if was_written:
            self.outputs_written, self.output_ns = True, now_ns
        return was_read + (2 if was_written and reads else was_written)

    def map_out(self, data, offset, length, first, last, physical, bit):
        if offset < 0 or offset + length > len(data):
            return False
        if (first, last, bit) == (0, 7, 0):
            self.memory[physical:physical + length] = data[offset:offset + length]
            return True
        bits = 8 * (length - 1) + last - first + 1
        value = int.from_bytes(data[offset:offset + length], "little") >> first & (1 << bits) - 1
        size = (bit + bits + 7) // 8
        here = int.from_bytes(self.memory[physical:physical + size], "little")
        here = here & ~((1 << bits) - 1 << bit) | value << bit
        self.memory[physical:physical + size] = here.to_bytes(size, "little")
        return True

    def map_in(self, data, offset, length, first, last, physical, bit):
        if offset < 0 or offset + length > len(data):
            return False
        if (first, last, bit) == (0, 7, 0):
            data[offset:offset + length] = self.memory[physical:physical + length]
            return True
        bits = 8 * (length - 1) + last - first + 1
        size = (bit + bits + 7) // 8
        value = int.from_bytes(self.memory[physical:physical + size], "little") >> bit & (1 << bits) - 1
        here = int.from_bytes(data[offset:offset + length], "little")
        here = here & ~((1 << bits) - 1 << first) | value << first
        data[offset:offset + length] = here.to_bytes(length, "little")
        return True

    def frame_passed(self, now_ns):
        """After a frame: a mailbox that is full is answered, outputs that came are shown to the pace."""
        if self.mailbox_full:
            start, size, _, _ = self.sms[MAILBOX_OUT]
            self.mailbox.take(bytes(self.memory[start:start + size]), self)
            self.mailbox_full = False
            if self.answer is None:
                self.answer = self.mailbox.next_answer()
            self.show_mailboxes()
        if self.outputs_written:
            self.outputs_written = False
            self.output_frames += 1
            self.acting_frame = self.frame_number
            self.pace.outputs_came(self, now_ns)

    def exchange(self, now_ns):
        """A step of the application; outputs act in OP only, inputs are there from SAFE-OP on."""
        start, size, _, on = self.sms[self.out_sm]
        if self.state == OP and on:
            outputs = bytes(self.memory[start:start + size])
        else:
            outputs = bytes(self.application.process_data_bytes()[0])
        inputs = self.application.exchange(outputs)
        start, size, _, on = self.sms[self.in_sm]
        if on and self.state & 0x0F in (SAFEOP, OP):
            self.memory[start:start + size] = inputs[:size]
        self.observer(self, outputs, now_ns)

    def watchdog_ns(self):
        _, _, control, on = self.sms[self.out_sm]
        if not on or not control & 0x40:
            return 0
        return (self.word(WATCHDOG_DIVIDER) + 2) * 40 * self.word(SM_WATCHDOG)

    def look_at_watchdog(self, now_ns):
        limit_ns = self.watchdog_ns()
        if self.state == OP and limit_ns and now_ns - self.output_ns > limit_ns:
            struct.pack_into("<H", self.memory, WATCHDOG_STATUS, 0)
            self.lose(SAFEOP | ERROR, WATCHDOG, now_ns)

    # ---------------------------------------------------------------- states
    def lose(self, state, code, now_ns):
        """The master is no longer there, or not in time."""
        self.application.comms_lost()
        self.enter(state, code, now_ns)

    def request(self, control, now_ns):
        wanted, now = control & 0x0F, self.state & 0x0F
        if self.state & ERROR and not control & ERROR:
            return
        if wanted not in (INIT, PREOP, SAFEOP, OP):
            self.enter(now | ERROR, UNKNOWN_STATE, now_ns)
        elif wanted <= now:
            if now == OP and wanted < OP:
                self.application.comms_lost()
            self.enter(wanted, 0, now_ns)
        elif (now, wanted) not in ((INIT, PREOP), (PREOP, SAFEOP), (SAFEOP, OP)):
            self.enter(now | ERROR, INVALID_TRANSITION, now_ns)
        else:
            code = self.hinders(wanted)
            self.enter(now | ERROR if code else wanted, code, now_ns)

    def hinders(self, wanted):
        """The AL status code of what stands against a state, or 0."""
        if wanted == PREOP:
            if not self.mailbox:
                return 0
            right = [self.sms[index][:2] == self.managers[index][:2] and self.sms[index][3] for index in (MAILBOX_OUT, MAILBOX_IN)]
            return 0 if all(right) else BAD_MAILBOX
        outputs, inputs = self.application.process_data_bytes()
        for index, size, code in ((self.out_sm, outputs, BAD_OUTPUTS), (self.in_sm, inputs, BAD_INPUTS)):
            _, length, _, on = self.sms[index]
            if (length if on else 0) != size:
                return code
        return self.pace.hinders(self, wanted)

    def enter(self, state, code, now_ns):
        before, self.state, self.code = self.state & 0x0F, state, code
        if state == OP:
            struct.pack_into("<H", self.memory, WATCHDOG_STATUS, 1)
        if state & 0x0F == INIT and self.mailbox:
            self.answer = None
            self.mailbox.clear()
        self.pace.entered(self, before, now_ns)
        self.show_state()
        self.observer(self, None, now_ns)

    def show_state(self):
        struct.pack_into("<H", self.memory, AL_STATUS, self.state)
        struct.pack_into("<H", self.memory, AL_CODE, self.code)

    def show_mailboxes(self):
        self.memory[SM + 8 * MAILBOX_OUT + 5] = 8 if self.mailbox_full else 0
        self.memory[SM + 8 * MAILBOX_IN + 5] = 8 if self.answer is not None else 0


LOGICAL = (10, 11, 12)
NOP, APRD, APWR, APRW, FPRD, FPWR, FPRW, BRD, BWR, BRW, LRD, LWR, LRW, ARMW, FRMW = range(15)


def datagram(slaves, command, position, offset, data, now_ns):
    """Passes a datagram through the slaves; data are changed in place. Position after them, and the working counter's growth."""
    count = 0
    if command in LOGICAL:
        at = position | offset << 16
        for slave in slaves:
            count += slave.logical(at, data, command != LWR, command != LRD, now_ns)
        return position, count
    for slave in slaves:
        ours = {
            APRD: position == 0, APWR: position == 0, APRW: position == 0, ARMW: position == 0,
            BRD: True, BWR: True, BRW: True,
        }.get(command, position == slave.word(ADDRESS))
        if command in (APRD, APWR, APRW, BRD, BWR, BRW, ARMW):
            position = position + 1 & 0xFFFF
        multiple = command in (ARMW, FRMW)
        written = bytes(data)
        if command in (APRD, FPRD, BRD, APRW, FPRW, BRW) and ours or multiple and ours:
            here = slave.read(offset, len(data), now_ns)
            if here is not None:
                if command in (BRD, BRW):
                    here = bytes(a | b for a, b in zip(data, here))
                data[:] = here
                count += 1
        if command in (APWR, FPWR, BWR) and ours or multiple and not ours:
            count += slave.write(offset, written, now_ns)
        elif command in (APRW, FPRW, BRW) and ours:
            count += 2 * slave.write(offset, written, now_ns)
    return position, count


def is_process_data(received):
    """Whether an Ethernet frame holds a logical datagram of EtherCAT."""
    at, end = 16, len(received)
    while at + 12 <= end:
        if received[at] in LOGICAL:
            return True
        length = received[at + 6] | received[at + 7] << 8
        if not length & 0x8000:
            return False
        at += 12 + (length & 0x07FF)
    return False


def frame(reached, received, now_ns):
    """An EtherCAT frame, from its Ethernet header on, as it comes back; None for one that is not whole.

    `reached` tells which slaves a datagram of the frame reaches, by its place in it from 0."""
    answer = bytearray(received)
    if len(answer) < 28 or answer[12:14] != b"\x88\xa4":
        return None
    header = struct.unpack_from("<H", answer, 14)[0]
    end = 16 + (header & 0x07FF)
    if header >> 12 != 1 or end > len(answer):
        return None
    at, more, place = 16, True, 0
    while more:
        if at + 12 > end:
            return None
        slaves, place = reached(place), place + 1
        command, _, position, offset, length = struct.unpack_from("<BBHHH", answer, at)
        more, size = bool(length & 0x8000), length & 0x07FF
        body = at + 10
        if body + size + 2 > end:
            return None
        data = answer[body:body + size]
        position, count = datagram(slaves, command, position, offset, data, now_ns)
        answer[body:body + size] = data
        if command in (APRD, APWR, APRW, BRD, BWR, BRW, ARMW):
            struct.pack_into("<H", answer, at + 2, position)
        before = struct.unpack_from("<H", answer, body + size)[0]
        struct.pack_into("<H", answer, body + size, before + count & 0xFFFF)
        at = body + size + 2
    for slave in reached(0):
        slave.frame_passed(now_ns)
    # The first slave marks what comes back.
    answer[6] |= 2
    return answer
