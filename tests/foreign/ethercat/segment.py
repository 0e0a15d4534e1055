#!/usr/bin/env python3
"""A segment of foreign drives behind a data link, on a network interface: CiA 402 drives of PyPI's am-sdk, or what ESI files say.

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

import sii
from coe import Mailbox
from esc import OP, Esc, frame

ETHERTYPE = 0x88A4
# A packet that this host itself sends out on the interface is none that came in.
PACKET_OUTGOING = 4


def am_drives(options):
    from am_drive import AmDrive

    return [AmDrive(position, options.cycle_us) for position in range(options.drives)]


def esi_devices(options):
    from esi_device import devices

    return devices(options.esi)


def slaves(drives):
    found = []
    for position, drive in enumerate(drives):
        image = sii.image(drive.identity, drive.name, drive.managers, *drive.default_mapping(), drive.coe)
        mailbox = Mailbox(drive, drive.managers[1][1])
        found.append(Esc(position, position == len(drives) - 1, image, drive.managers, drive, mailbox))
    return found


def serve(interface, drives, cycle_us, lockstep):
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
    port.bind((interface, ETHERTYPE))
    port.settimeout(0.005)
    segment = slaves(drives)
    print(f"{', '.join(drive.name for drive in drives)} on {interface}", flush=True)
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
    parser.add_argument("--esi", action="append", help="in place of them: the drives of a vendor's ESI file, once for each file")
    parser.add_argument("--cycle-us", type=int, default=1000)
    parser.add_argument("--lockstep", action="store_true")
    options = parser.parse_args()
    try:
        drives = esi_devices(options) if options.esi else am_drives(options)
        serve(options.interface, drives, options.cycle_us, options.lockstep)
    except KeyboardInterrupt:
        return 0
    except OSError as error:
        print(f"segment.py: {options.interface}: {error.strerror}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
