"""Drives whose outputs act some frames later than they came, as where a bus coupler or a drive's own filter is on the way."""

from collections import deque


def add_option(parser):
    parser.add_argument("--delay-frames", action="append", default=[], metavar="[DRIVE:]N",
                        help="outputs act so many steps of a drive later than its model takes them")


def change(drives, options):
    for order in options.delay_frames:
        place, _, count = order.rpartition(":")
        for drive in [drives[int(place)]] if place else drives:
            drive.exchange = later(drive.exchange, int(count))
    return drives


def later(exchange, count):
    on_the_way = deque()

    def exchange_later(outputs):
        on_the_way.append(outputs)
        # Until the first ones arrive the drive has none: zeros, as before OP.
        return exchange(on_the_way.popleft() if len(on_the_way) > count else bytes(len(outputs)))

    return exchange_later
