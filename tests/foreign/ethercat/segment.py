#!/usr/bin/env python3
"""A segment of foreign drives: one CiA 402 drive of PyPI's am-sdk for each slave, behind a data link, on a network interface.

    pip install am-sdk==0.2.0
    ip link add ec0 type veth peer name ec1; ip link set ec0 up; ip link set ec1 up
    segment.py ec1 --drives 3 --lockstep     # a master on ec0

Needs the right to open raw sockets (CAP_NET_RAW). A drive moves on by a cycle for each frame that brings it outputs. With
--lockstep its watchdogs are off, so that a master may take what time it likes and sees the same every time.
"""

import argparse
import socket
import struct
import sys
import time

from am_drive import AmDrive
from coe import Mailbox
from esc import MAILBOX_BYTES, OP, Esc, frame
import sii

ETHERTYPE = 0x88A4
# A packet that this host itself sends out on the interface is none that came in.
PACKET_OUTGOING = 4


def slaves(count, cycle_us):
    found = []
    for position in range(count):
        drive = AmDrive(position, cycle_us)
        image = sii.image(drive.identity, drive.name, *drive.default_mapping())
        found.append(Esc(position, position == count - 1, image, drive, Mailbox(drive, MAILBOX_BYTES)))
    return found


def serve(interface, drives, cycle_us, lockstep):
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
    port.bind((interface, ETHERTYPE))
    port.settimeout(0.005)
    segment = slaves(drives, cycle_us)
    print(f"{drives} drives on {interface}", flush=True)
    frames = 0
    while True:
        now_ns = frames * cycle_us * 1000 if lockstep else time.monotonic_ns()
        if not lockstep:
            for slave in segment:
                slave.look_at_watchdog(now_ns)
        try:
            received, source = port.recvfrom(2048)
        except TimeoutError:
            continue
        except InterruptedError:
            continue
        if source[2] == PACKET_OUTGOING:
            continue
        if not lockstep:
            now_ns = time.monotonic_ns()
        answer = frame(segment, received, now_ns)
        if answer is None:
            continue
        frames += any(slave.state == OP for slave in segment)
        port.send(answer)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("interface")
    parser.add_argument("--drives", type=int, default=1)
    parser.add_argument("--cycle-us", type=int, default=1000)
    parser.add_argument("--lockstep", action="store_true")
    options = parser.parse_args()
    try:
        serve(options.interface, options.drives, options.cycle_us, options.lockstep)
    except KeyboardInterrupt:
        return 0
    except OSError as error:
        print(f"segment.py: {options.interface}: {error.strerror}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
