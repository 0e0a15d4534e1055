"""A drive of am-sdk with inputs and a touch-probe unit in front of the vendor's model, which has neither: 60FD, and 60B8 to 60BC as CiA 402
(IEC 61800-7-201) describes them. Its encoder has an index at each turn of the motor; a home switch and a touch probe are where the
command line says, in the drive's own millionths of a radian."""

import math

import am_drive

TURN = 2e6 * math.pi
HOME_SWITCH, PROBE = 1 << 2, 1 << 16
ENABLE, AT_INDEX, RISING, FALLING = 1, 1 << 2, 1 << 4, 1 << 5
STORED = {RISING: 1 << 1, FALLING: 1 << 2}


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
        self.pdos[0x1600] = self.pdos[0x1600] + [((0x60B8, 0), 16)]
        self.pdos[0x1A00] = self.pdos[0x1A00] + [((0x60FD, 0), 32), ((0x60B9, 0), 16)] + [
            ((index, 0), 32) for index in (0x60BA, 0x60BB, 0x60BC)]

    def exchange(self, outputs):
        before = self.position
        inputs = super().exchange(outputs[:-2])
        now = self.position
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
