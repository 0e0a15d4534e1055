"""Two drives of am-sdk behind one data link: a drive of two axes, whose second has its objects 0x800 above those of the first and its
PDOs 0x10 above (ETG.6010)."""

import struct

import am_drive
import sii
import sync_objects
from coe import NO_OBJECT, NO_SUBINDEX, READ_ONLY, STATE, Abort
from esc import PREOP

ABOVE, VENDORS_ABOVE, PDOS_ABOVE = 0x800, 0x100, 0x10
AXES_FROM, AXES_END = 0x6000, 0x7000
RECEIVE, TRANSMIT = 0x1C12, 0x1C13
FIXED = {RECEIVE: [0x1600, 0x1610], TRANSMIT: [0x1A00, 0x1A10]}
PRODUCT = 0x2A


class DualDrive:
    """Its mapping is fixed; states, faults and objects are those of each axis."""

    managers = am_drive.MANAGERS
    coe = sii.SDO | sii.COMPLETE

    def __init__(self, position, cycle_us, options):
        self.axes = [am_drive.AmDrive(position + axis, cycle_us, "M", options) for axis in range(2)]
        vendor, _, revision, serial = self.axes[0].identity
        self.identity, self.name, self.esc = (vendor, PRODUCT, revision, serial), "two AM M (sim)", None

    def entries(self, pdo):
        axis = (pdo & 0xFF) // PDOS_ABOVE
        own = am_drive.PDOS[pdo - axis * PDOS_ABOVE]
        above = lambda index: axis * (ABOVE if index >= AXES_FROM else VENDORS_ABOVE if index else 0)
        return [(index + above(index), sub, bits) for (index, sub), bits in own]

    def default_mapping(self):
        return tuple([(pdo, self.entries(pdo)) for pdo in FIXED[way]] for way in (RECEIVE, TRANSMIT))

    # ---------------------------------------------------------------- what a tester may do to it
    @property
    def statusword(self):
        """Of the axis that is furthest from operation: what one lacks, the drive lacks."""
        return min((axis.statusword for axis in self.axes), key=lambda word: word & 0x6F == 0x27)

    @property
    def position(self):
        return self.axes[0].position

    def fault(self, code):
        self.axes[1].fault(code)

    def clear(self):
        self.axes[1].clear()

    def sto(self, on):
        for axis in self.axes:
            axis.sto(on)

    def power_cycle(self):
        for axis in self.axes:
            axis.power_cycle()

    # ---------------------------------------------------------------- process data
    def process_data_bytes(self):
        return tuple(2 * size for size in self.axes[0].process_data_bytes())

    def exchange(self, outputs):
        size = len(outputs) // 2
        return b"".join(axis.exchange(outputs[at * size:(at + 1) * size]) for at, axis in enumerate(self.axes))

    def comms_lost(self):
        for axis in self.axes:
            axis.comms_lost()

    # ---------------------------------------------------------------- objects
    def of(self, index):
        """The axis of an object, and its number there."""
        axis = (index - AXES_FROM) // ABOVE if AXES_FROM <= index < AXES_END else 0
        return self.axes[axis], index - axis * ABOVE

    def read(self, index, sub):
        if index in sync_objects.INDICES:
            return sync_objects.read(self.esc, index, sub)
        if index == 0x1018:
            return struct.pack("<I", self.identity[sub - 1]) if sub else bytes([4])
        rows = FIXED.get(index)
        if rows is None and index in sum(FIXED.values(), []):
            rows = [entry << 16 | at << 8 | bits for entry, at, bits in self.entries(index)]
        if rows is not None:
            if sub > len(rows):
                raise Abort(NO_SUBINDEX)
            return struct.pack("<H" if index in FIXED else "<I", rows[sub - 1]) if sub else bytes([len(rows)])
        axis, own = self.of(index)
        axis.esc = self.esc
        return axis.read(own, sub)

    def read_complete(self, index):
        raise Abort(NO_OBJECT)

    def write(self, index, sub, data, state):
        if index in FIXED:
            if state & 0x0F != PREOP:
                raise Abort(STATE)
            raise Abort(READ_ONLY)
        axis, own = self.of(index)
        axis.esc = self.esc
        axis.write(own, sub, data, state)

    def write_complete(self, index, data, state):
        raise Abort(READ_ONLY)
