#!/usr/bin/env python3
"""A segment of foreign drives behind a data link, on a network interface: CiA 402 drives of PyPI's am-sdk, or what ESI files say.

    pip install am-sdk==0.2.0
    ip link add ec0 type veth peer name ec1; ip link set ec0 up; ip link set ec1 up
    segment.py ec1 --drives 3                # a master on ec0; a drive moves on with each frame that brings it outputs
    segment.py ec1 --drives 3 --lockstep     # the same, watchdogs off, time counts frames: every run is the same
    segment.py ec1 --drives 3 --clock        # drives run by their own clock, by SYNC0 where a master activates it

Needs the right to open raw sockets (CAP_NET_RAW). control.py gives orders while it runs, judge.py reads what it recorded.
"""

import argparse
import gc
import signal
import sys

import delay
import sii
import warm_up
import wrong
from bus import Segment
from coe import Mailbox
from control import Control
from esc import Esc
from pace import ByClock, ByFrame
from port import serve
from record import Record


def am_drives(options):
    from am_drive import AmDrive, sim_options

    units = options.units.split(",")
    if options.dual or options.modular:
        from dual_drive import DualDrive
        from modular_drive import ModularDrive

        first = (ModularDrive if options.modular else DualDrive)(0, options.cycle_us, sim_options(0, options.sim, options.truth))
        return [first] + [AmDrive(position, options.cycle_us, units[0], sim_options(position, options.sim, options.truth))
                          for position in range(2, options.drives)]
    kind = AmDrive
    if options.touch is not None:
        from touch_drive import TouchDrive

        places = dict(row.split("=") for row in options.touch)

        def kind(position, cycle_us, unit, sim):
            at = (places.get(f"{position}:{what}") for what in ("switch", "contact"))
            return TouchDrive(position, cycle_us, unit, sim, *(None if place is None else int(place) for place in at))

    return [kind(position, options.cycle_us, units[position % len(units)], sim_options(position, options.sim, options.truth))
            for position in range(options.drives or (0 if options.esi else len(units)))]


def esi_devices(options):
    from esi_device import devices

    return devices(options.esi, options.cycle_us)


def drives(options):
    found = am_drives(options) + (esi_devices(options) if options.esi else [])
    return wrong.change(delay.change(found, options), options)


def slaves(drives, options):
    found = []
    for position, drive in enumerate(drives):
        image = sii.image(drive.identity, drive.name, drive.managers, *drive.default_mapping(), drive.coe)
        mailbox = Mailbox(drive, drive.managers[1][1]) if drive.coe else None
        pace = (ByClock if options.clock else ByFrame)(options.cycle_us)
        drift = options.drift_ppm[position % len(options.drift_ppm)]
        slave = drive.esc = Esc(position, image, drive, mailbox, pace, drift)
        slave.watchdog_fixed = getattr(drive, "watchdog_fixed", False)
        found.append(slave)
    return found


def add_options(parser):
    parser.add_argument("interface")
    parser.add_argument("--drives", type=int, default=0, help="how many drives of am-sdk (1)")
    parser.add_argument("--esi", action="append", help="in place of them, or after them: the drives of a vendor's ESI file, once for each file")
    parser.add_argument("--dual", action="store_true", help="the first two of them are one drive of two axes")
    parser.add_argument("--modular", action="store_true", help="the same, its axes in slots: it exchanges nothing before F030 says so")
    parser.add_argument("--touch", action="append", metavar="DRIVE:WHAT=PLACE",
                        help="they have inputs and a touch-probe unit; switch or contact of a drive is there, in its increments")
    parser.add_argument("--cycle-us", type=int, default=1000)
    parser.add_argument("--lockstep", action="store_true", help="time counts frames, no watchdog where frames arrive")
    parser.add_argument("--clock", action="store_true", help="the drives run by their own clock")
    parser.add_argument("--drift-ppm", type=lambda text: [float(part) for part in text.split(",")], default=[0.0],
                        metavar="PPM[,PPM…]", help="how much too fast the slaves' clocks go, by position")
    parser.add_argument("--control", metavar="PATH", help="a Unix datagram socket for orders (control.py)")
    parser.add_argument("--at", action="append", default=[], metavar="'FRAME ORDER'",
                        help="an order before that process-data frame; FRAME may be enabled+N")
    parser.add_argument("--record", metavar="FILE", help="CSV of what each drive got and did (judge.py)")
    parser.add_argument("--units", default="M", metavar="UNIT[,UNIT…]", help="am-sdk's units, by position: M, S-S, S-D, H-F, H-T, H-X")
    parser.add_argument("--sim", action="append", default=[], metavar="[DRIVE:]KEY=VALUE",
                        help="am-sdk's SimOptions: load_inertia_kgm2, friction_scale, q0_rad, bus_V …")
    parser.add_argument("--truth", action="append", default=[], metavar="[DRIVE:]KEY=VALUE",
                        help="am-sdk's TruthPlant in place of its plain one: coulomb_Nm, breakaway_Nm, stribeck_vel_rad_s …")
    delay.add_option(parser)
    wrong.add_options(parser)


def end(*_):
    raise KeyboardInterrupt


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    options = parser.parse_args()
    if options.clock and options.lockstep:
        parser.error("--clock and --lockstep exclude each other")
    if options.clock:
        # A pause for garbage is a late frame; nothing here makes rings of objects cycle by cycle.
        gc.disable()
    signal.signal(signal.SIGTERM, end)
    control = record = None
    try:
        if warm_up.needed():
            scratch = Segment(slaves(drives(options), options), options.cycle_us, options.lockstep, options.clock)
            scratch.control = Control(scratch, None, [])
            warm_up.warm_up(scratch)
        record = Record(options.record) if options.record else None
        segment = Segment(slaves(drives(options), options), options.cycle_us, options.lockstep, options.clock, record)
        control = segment.control = Control(segment, options.control, options.at)
        serve(options.interface, segment)
    except KeyboardInterrupt:
        return 0
    except (IndexError, ValueError) as error:
        print(f"segment.py: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"segment.py: {options.interface}: {error.strerror}", file=sys.stderr)
        return 3
    finally:
        if control:
            control.close()
        if record:
            record.close()


if __name__ == "__main__":
    sys.exit(main())
