#!/usr/bin/env python3
"""Orders to a running segment: text over a Unix datagram socket, one order each, one line in answer.

    control.py PATH status                 # JSON
    control.py PATH drop 1 | restore 1     # the cable before drive 1; a drive's state is kept
    control.py PATH drop 1 2               # the same within the next frame: its first two datagrams still reach the drive
    control.py PATH drop-after 40          # the cable before drive 0, after so many frames without process data: in a start-up
    control.py PATH registers 1 0x0980 2   # what lies there in the memory of slave 1, in hex
    control.py PATH power-cycle 1          # drive 1 is off and on again: INIT, its position as its model keeps it
    control.py PATH away 1 0.5             # the same, and meanwhile somebody has turned it by so many radians
    control.py PATH reset 1                # somebody's tool sends slave 1 to INIT
    control.py PATH exchange 0 1           # these two are off, change places on the cable, and are on again
    control.py PATH fault 1 [CODE] | clear 1 | sto 1 on | sto 1 off
    control.py PATH input 3 0 off          # an input of the terminal at place 3
    control.py PATH outputs 3              # all that a terminal was sent, each change of it in hex
    control.py PATH mute 50                # no frame arrives for 50 ms
    control.py PATH trouble KIND COUNT     # late, duplicate, lost, damaged, stray, foreign: for so many frames
    control.py PATH at 5000 ORDER          # before process-data frame 5000; at enabled+100: counted from the frame
                                           # after which all drives were first in operation enabled
Drives are counted from 0. An order acts between two frames.
"""

import json
import os
import socket
import sys
import tempfile

from trouble import KINDS

FAULT_OVERCURRENT = 0x1001


class Control:
    def __init__(self, segment, path, planned):
        self.segment, self.path, self.port = segment, path, None
        self.planned = []
        for line in planned:
            self.plan(*line.split(None, 1))
        if path:
            if os.path.exists(path):
                os.unlink(path)
            self.port = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self.port.bind(path)
            self.port.setblocking(False)

    def plan(self, when, order):
        enabled = when.startswith("enabled+")
        self.planned.append((enabled, int(when.split("+")[-1]), order))

    def before_frame(self, number):
        """Orders that were planned for this process-data frame."""
        base = self.segment.enabled_frame
        due = [plan for plan in self.planned
               if (base is not None and number >= base + plan[1] if plan[0] else number >= plan[1])]
        for plan in due:
            self.planned.remove(plan)
            print(f"frame {number}: {plan[2]}: {self.order(plan[2])}", flush=True)

    def answer(self):
        try:
            order, sender = self.port.recvfrom(1024)
        except BlockingIOError:
            return
        line = self.order(order.decode(errors="replace"))
        if sender:
            try:
                self.port.sendto(line.encode(), sender)
            except OSError:
                # Who asked is gone.
                pass

    def order(self, text):
        words = text.split()
        act = getattr(self, "on_" + words[0].replace("-", "_"), None) if words else None
        if act is None:
            return f"error: {text.strip()}: no such order"
        try:
            return act(*words[1:]) or "ok"
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            return f"error: {text.strip()}: {error}"

    def slave(self, position):
        return self.segment.slaves[int(position)]

    # ---------------------------------------------------------------- orders
    def on_status(self):
        return json.dumps(self.segment.status())

    def on_drop(self, position, datagrams=None):
        if datagrams:
            self.segment.cut_within = int(datagrams), self.slave(position).position
            return
        self.segment.cut.add(self.slave(position).position)
        self.segment.link()

    def on_registers(self, position, address, count):
        at = int(address, 0)
        return self.slave(position).memory[at:at + int(count)].hex()

    def on_drop_after(self, frames):
        self.segment.start_up_frames = int(frames)

    def on_restore(self, position):
        self.segment.cut.discard(self.slave(position).position)
        self.segment.link()

    def on_power_cycle(self, position):
        self.segment.power_cycle(self.slave(position))

    def on_away(self, position, radians):
        self.slave(position).application.move(float(radians))
        self.segment.power_cycle(self.slave(position))

    def on_reset(self, position):
        self.segment.reset(self.slave(position))

    def on_exchange(self, one, other):
        self.segment.exchange_places(int(one), int(other))

    def on_fault(self, position, code=hex(FAULT_OVERCURRENT)):
        self.slave(position).application.fault(int(code, 0))

    def on_clear(self, position):
        self.slave(position).application.clear()

    def on_sto(self, position, way):
        self.slave(position).application.sto({"on": True, "off": False}[way])

    def on_input(self, position, bit, way):
        self.slave(position).application.set_input(int(bit), {"on": True, "off": False}[way])

    def on_outputs(self, position):
        return " ".join(self.slave(position).application.history) or "none"

    def on_mute(self, milliseconds):
        self.segment.mute(float(milliseconds))

    def on_trouble(self, kind, count):
        if kind not in KINDS:
            raise ValueError(f"one of {', '.join(KINDS)}")
        if int(count) > 0:
            self.segment.troubles.add(kind, int(count))

    def on_at(self, when, *order):
        self.plan(when, " ".join(order))

    def close(self):
        if self.port:
            self.port.close()
            os.unlink(self.path)


def main():
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as port:
        port.bind(os.path.join(folder, "answer"))
        port.settimeout(5)
        try:
            port.sendto(" ".join(sys.argv[2:]).encode(), sys.argv[1])
            line = port.recv(65536).decode()
        except OSError as error:
            print(f"control.py: {sys.argv[1]}: {error}", file=sys.stderr)
            return 1
    print(line)
    return 1 if line.startswith("error") else 0


if __name__ == "__main__":
    sys.exit(main())
