"""PyPy translates what runs often while it runs, and a drive would not answer for milliseconds: so it runs before.

A segment like the one to be served, that nobody sees, gets some thousand frames and SDO requests.
"""

import struct
import sys

from coe import COE, REQUEST
from esc import FMMU, OP, SM

FRAMES, REQUESTS = 6000, 3000
FPRD, FPWR, LRW = 4, 5, 12
WALK = (0x06, 0x07, 0x0F)


def needed():
    return sys.implementation.name == "pypy"


def ethernet(*datagrams):
    body = b""
    for place, (command, address, data) in enumerate(datagrams):
        more = 0x8000 if place + 1 < len(datagrams) else 0
        body += struct.pack("<BBIHH", command, 0, address, len(data) | more, 0) + data + bytes(2)
    return bytes(12) + b"\x88\xa4" + struct.pack("<H", len(body) | 0x1000) + body


def configure(slave, place, at):
    """Its sync managers and FMMUs, written as a master does; where its process data end."""
    sizes = slave.application.process_data_bytes()
    rows = list(slave.managers)
    rows[-2], rows[-1] = ((rows[n][0], size, rows[n][2]) for n, size in zip((-2, -1), sizes))
    for index, (start, length, control) in enumerate(rows):
        # No watchdog.
        slave.write(SM + 8 * index, struct.pack("<HHBBH", start, length, control & ~0x40, 0, 1), 0)
    slave.write(0x0010, struct.pack("<H", 0x1001 + place), 0)
    for index, (row, kind) in enumerate(((rows[-2], 2), (rows[-1], 1))):
        if row[1]:
            slave.write(FMMU + 16 * index, struct.pack("<IHBBHBBB3x", at, row[1], 0, 7, row[0], 0, kind, 1), 0)
        at += row[1]
    slave.state = OP
    return at


def warm_up(segment):
    end = 0
    for place, slave in enumerate(segment.slaves):
        end = configure(slave, place, end)
    for number in range(FRAMES):
        control = WALK[min(number // 10, 2)].to_bytes(2, "little")
        data = (control + bytes([9, 0]) + struct.pack("<ii", 0, number % 400 - 200)).ljust(end, b"\0")[:end]
        logical = ethernet((LRW, 0, data), (FPRD, 0x0130 << 16 | 0x1001, bytes(6)))
        segment.take(logical, number * segment.cycle_ns)
        segment.take(ethernet((FPRD, 0x0805 << 16 | 0x1001, bytes(16))), number * segment.cycle_ns)
        if segment.by_clock:
            segment.run_until(number * segment.cycle_ns, number * segment.cycle_ns)
    for slave in segment.slaves:
        if slave.mailbox:
            request(slave, segment)


def request(slave, segment):
    address = slave.word(0x0010)
    out, answer = slave.managers[0], slave.managers[1]
    for number in range(REQUESTS):
        index = (0x603F, 0x2602, 0x1018, 0x1A00)[number % 4]
        body = struct.pack("<HBHBI", REQUEST << 12, 0x40, index, number // 4 % 2, 0)
        mail = (struct.pack("<HHBB", len(body), 0, 0, COE | 0x10) + body).ljust(out[1], b"\0")
        segment.take(ethernet((FPWR, out[0] << 16 | address, mail)), number)
        segment.take(ethernet((FPRD, answer[0] << 16 | address, bytes(answer[1]))), number)
