"""A drive of am-sdk with inputs, a touch-probe unit and homing in front of the vendor's model, which has none of them: 60FD, 60B8 to 60BC
and mode 6 as CiA 402 (IEC 61800-7-201) describes them. Its encoder has an index at each turn of the motor; a home switch and a touch probe
are where the command line says, in the drive's own millionths of a radian. Homing goes to the switch, where the position becomes 0."""

import math
import struct

import am_drive

TURN = 2e6 * math.pi
HOME_SWITCH, PROBE = 1 << 2, 1 << 16
ENABLE, AT_INDEX, RISING, FALLING = 1, 1 << 2, 1 << 4, 1 << 5
STORED = {RISING: 1 << 1, FALLING: 1 << 2}


HOMING, CSV = 6, 9
START, REACHED, ATTAINED = 1 << 4, 1 << 10, 1 << 12
HOMING_MRAD_S = -2000


class Latch:
    """One of the two: it stores the first edge after it is enabled, and forgets when it is not."""

    def __init__(self):
        self.status, self.stored = 0, {RISING: 0, FALLING: 0}

    def step(self, function, edges, indices):
        if not function & ENABLE:
            self.status = 0
            return
        # In the cycle in which it is enabled it sees nothing yet.
        seen = (indices if function & AT_INDEX else edges) if self.status & ENABLE else []
        self.status |= ENABLE
        for edge, position in seen:
            if function & edge and not self.status & STORED[edge]:
                self.status |= STORED[edge]
                self.stored[edge] = position


class TouchDrive(am_drive.AmDrive):
    def __init__(self, position, cycle_us, unit, options, switch=None, contact=None):
        super().__init__(position, cycle_us, unit, options)
        self.switch, self.contact = switch, contact
        self.latches = Latch(), Latch()
        self.home, self.attained = 0, False
        self.pdos[0x1600] = self.pdos[0x1600] + [((0x60B8, 0), 16)]
        self.pdos[0x1A00] = self.pdos[0x1A00] + [((0x60FD, 0), 32), ((0x60B9, 0), 16)] + [
            ((index, 0), 32) for index in (0x60BA, 0x60BB, 0x60BC)]

    def towards_switch(self, outputs):
        """What the model is told while the drive homes: a velocity, until the switch is reached."""
        starts = struct.unpack_from("<H", outputs)[0] & START
        if not starts:
            self.attained = False
        elif not self.attained and self.position <= self.switch:
            self.home, self.attained = self.position, True
        speed = HOMING_MRAD_S if starts and not self.attained else 0
        return outputs[:2] + bytes([CSV]) + outputs[3:8] + struct.pack("<i", speed) + outputs[12:]

    def as_homed(self, inputs, position, homes):
        """The position counts from the switch; while the drive homes it shows so."""
        word = struct.unpack_from("<H", inputs)[0]
        if homes:
            word = word & ~(REACHED | ATTAINED) | (REACHED | ATTAINED if self.attained else 0)
        mode = bytes([HOMING]) if homes else inputs[2:3]
        return struct.pack("<H", word) + mode + inputs[3:4] + struct.pack("<i", position - self.home) + inputs[8:]

    def exchange(self, outputs):
        before = self.position
        homes = len(outputs) > 12 and outputs[2] == HOMING
        inputs = super().exchange(self.towards_switch(outputs[:-2]) if homes else outputs[:-2])
        now = self.position
        inputs = self.as_homed(inputs, now, homes)
        function = int.from_bytes(outputs[-2:], "little")
        edges = []
        if self.contact is not None and (before >= self.contact) != (now >= self.contact):
            edges = [(RISING if now >= self.contact else FALLING, self.contact)]
        turns = math.floor(before / TURN), math.floor(now / TURN)
        indices = [(RISING, round(max(turns) * TURN))] if turns[0] != turns[1] else []
        first, second = self.latches
        first.step(function & 0xFF, edges, indices)
        second.step(function >> 8, [], indices)
        shown = HOME_SWITCH if self.switch is not None and now <= self.switch else 0
        shown |= PROBE if self.contact is not None and now >= self.contact else 0
        status = first.status | second.status << 8
        positions = first.stored[RISING], first.stored[FALLING], second.stored[RISING]
        return (inputs + shown.to_bytes(4, "little") + status.to_bytes(2, "little")
                + b"".join(value.to_bytes(4, "little", signed=True) for value in positions))
