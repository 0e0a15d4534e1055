"""Segments that are not what a master expects: the options for it, and what they do to the drives."""

from io_device import IoDevice
from io_terminal import IoTerminal


def number(text):
    return int(text, 0)


def add_options(parser):
    group = parser.add_argument_group("what is wrong with the segment (drives are counted from 0)")
    group.add_argument("--revision", action="append", default=[], metavar="DRIVE:NUMBER", help="its revision is this")
    group.add_argument("--product", action="append", default=[], metavar="DRIVE:NUMBER", help="its product code is this")
    group.add_argument("--swap", action="append", default=[], metavar="DRIVE:DRIVE", help="these two stand in each other's place")
    group.add_argument("--lacks", action="append", default=[], metavar="DRIVE:OBJECT", help="it has no such object (6060, hex)")
    group.add_argument("--short-map", action="append", default=[], type=int, metavar="DRIVE", help="its RxPDO lacks the last entry")
    group.add_argument("--watchdog-fixed", action="append", default=[], type=int, metavar="DRIVE",
                       help="writing its watchdog registers has no effect")
    group.add_argument("--io", action="append", default=[], type=int, metavar="POSITION",
                       help="a slave without a mailbox stands here")
    group.add_argument("--terminal", action="append", default=[], type=int, metavar="POSITION",
                       help="a terminal with inputs and outputs, without a mailbox, stands here")
    group.add_argument("--input", action="append", default=[], metavar="POSITION:BIT", help="this input of a terminal is on from the start")


def change(drives, options):
    """The drives as they stand on the cable."""
    for order in options.revision:
        drive, value = map(number, order.split(":"))
        drives[drive].identity = (*drives[drive].identity[:2], value, drives[drive].identity[3])
    for order in options.product:
        drive, value = map(number, order.split(":"))
        drives[drive].identity = (drives[drive].identity[0], value, *drives[drive].identity[2:])
    for order in options.lacks:
        drive, index = order.split(":")
        drives[int(drive)].lack(int(index, 16))
    for drive in options.short_map:
        drives[drive].shorten_map()
    for drive in options.watchdog_fixed:
        drives[drive].watchdog_fixed = True
    for order in options.swap:
        one, other = map(number, order.split(":"))
        drives[one], drives[other] = drives[other], drives[one]
    for position in sorted(options.io):
        drives.insert(position, IoDevice())
    for position in sorted(options.terminal):
        drives.insert(position, IoTerminal())
    for order in options.input:
        position, bit = map(number, order.split(":"))
        drives[position].set_input(bit, True)
    return drives
