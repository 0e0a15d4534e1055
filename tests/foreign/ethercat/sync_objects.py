"""Objects that tell of synchronisation (ETG.1020): 0x1C32, 0x1C33, 0x10F1. They show what is in force."""

import struct

from coe import LENGTH, NO_SUBINDEX, READ_ONLY, Abort

INDICES = (0x10F1, 0x1C32, 0x1C33)
ERROR_REACTION, ERROR_LIMIT = 1, 2
BY_FRAME, BY_CLOCK = 0x0002, 0x0005


def read(esc, index, sub):
    if index == 0x10F1:
        rows = {0: ("<B", 2), ERROR_REACTION: ("<I", 1), ERROR_LIMIT: ("<H", esc.pace.limit)}
    else:
        kind = esc.pace.kinds(esc)[index - 0x1C32]
        supported = BY_CLOCK if hasattr(esc.pace, "step") else BY_FRAME
        # Type, cycle in ns, shift, types that it can, shortest cycle, calculate and copy, delay, missed, too short, error.
        rows = {0: ("<B", 32), 1: ("<H", kind), 2: ("<I", esc.pace.cycle_us * 1000), 3: ("<I", 0), 4: ("<H", supported),
                5: ("<I", esc.pace.cycle_us * 1000), 6: ("<I", 0), 9: ("<I", 0), 11: ("<H", esc.pace.missed & 0xFFFF),
                12: ("<H", 0), 32: ("<B", esc.pace.errors > 0)}
    if sub not in rows:
        raise Abort(NO_SUBINDEX)
    form, value = rows[sub]
    return struct.pack(form, value)


def write(esc, index, sub, data):
    if (index, sub) != (0x10F1, ERROR_LIMIT):
        raise Abort(READ_ONLY)
    if len(data) != 2:
        raise Abort(LENGTH)
    esc.pace.limit = struct.unpack("<H", data)[0]
