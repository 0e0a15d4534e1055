#!/usr/bin/env python3
"""The segment itself on trial: what it does to a master on order must be as ordered, and its own clocks must be right.

    pip install pysoem am-sdk==0.2.0
    trials.py ec0 ec1                # ec0, ec1: the ends of a veth pair

SOEM is the master. Prints one line for each fact, and ends with 1 where something is wrong.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import pysoem

from judge import judge
from masters import CSV, RX_1600, TX_1A00, into_operation, say, walked

CYCLE_NS = 1_000_000
ORDERS = (
    "enabled+100 trouble duplicate 5", "enabled+120 trouble foreign 8", "enabled+140 trouble stray 12",
    "enabled+160 trouble damaged 8", "enabled+180 trouble lost 3", "enabled+190 trouble late 2",
    "enabled+300 drop 2", "enabled+420 restore 2", "enabled+500 fault 1", "enabled+520 clear 1",
    "enabled+700 sto 0 on", "enabled+720 sto 0 off", "enabled+850 mute 10", "enabled+900 power-cycle 2", "980 power-cycle 1")


class Trial:
    """A segment in a process of its own, and a master on it."""

    def __init__(self, ends, *options, count=3):
        self.folder = tempfile.TemporaryDirectory()
        self.socket, self.file = (os.path.join(self.folder.name, name) for name in ("control", "record"))
        here = os.path.dirname(os.path.abspath(__file__))
        python = os.environ.get("QUADRANT_SEGMENT_PYTHON", sys.executable)
        self.process = subprocess.Popen(
            [python, os.path.join(here, "segment.py"), ends[1], "--drives", "3", "--control", self.socket, "--record", self.file,
             *options], stdout=subprocess.PIPE, text=True)
        self.process.stdout.readline()
        self.control = [sys.executable, os.path.join(here, "control.py"), self.socket]
        self.master = pysoem.Master()
        self.master.open(ends[0])
        say(f"{self.master.config_init()} slaves, segment.py {' '.join(options[:1])}", len(self.master.slaves) == count)

    def ask(self, *order):
        return subprocess.run([*self.control, *order], capture_output=True, text=True).stdout.strip()

    def words(self):
        return [TX_1A00.unpack_from(slave.input)[0] for slave in self.master.slaves]

    def cycle(self, speed=500, timeout_us=20_000):
        """One frame; its working counter."""
        for slave, word in zip(self.master.slaves, self.words()):
            control = walked(word)
            if word & 0x4F == 0x08:
                control = self.reset = 0x80 - getattr(self, "reset", 0)
            slave.output = RX_1600.pack(control, CSV, 0, speed, 0, 0, 0)
        self.master.send_processdata()
        return self.master.receive_processdata(timeout_us)

    def end(self):
        """What was recorded, and what was judged of it."""
        self.master.close()
        self.process.terminate()
        self.process.wait()
        with open(self.file) as file:
            text = file.read()
        found = judge(self.file)
        self.folder.cleanup()
        return text, found


def troubled(ends):
    """All orders once, in lockstep: the working counter of each frame, the record, status."""
    trial = Trial(ends, "--lockstep", *[part for order in ORDERS for part in ("--at", order)])
    into_operation(pysoem, trial.master)
    while not all(word & 0x6F == 0x27 for word in trial.words()):
        trial.cycle()
    status = json.loads(trial.ask("status"))
    # The next frame has this number, counted from the one after which all were enabled.
    first = status["process_data_frames"] + 1 - status["enabled_frame"]
    counters, words = {}, {}
    for frame in range(first, 1000):
        counters[frame] = trial.cycle(500 + frame)
        words[frame] = trial.words()
    status = json.loads(trial.ask("status"))
    refused = trial.ask("trouble unheard-of 1")
    text, found = trial.end()
    return counters, words, status, text, found, refused


def orders_in_lockstep(ends):
    counters, words, status, text, found, refused = troubled(ends)
    full = [frame for frame in counters if counters[frame] == 9]
    say("duplicate and foreign frames beside the answers: no working counter is short",
        all(counters[frame] == 9 for frame in range(100, 140)))
    # SOEM knows an answer by its index alone.
    print(f"damaged frames beside the answers: SOEM takes {sum(counters[frame] != 9 for frame in range(140, 152))} of 12 for answers")
    wrong = sum(counters[frame] != 9 for frame in range(160, 168))
    say(f"damaged answers: SOEM sees it of {wrong} of 8; another command, another index, a wrong working counter are there",
        max(counters[164], counters[165]) <= 0 and (counters[166], counters[167]) == (10, 0))
    say("lost and late answers: no answer", all(counters[frame] <= 0 for frame in (180, 181, 182, 190, 191)))
    say("a cut cable: two thirds of the working counter from the very frame on, to the very frame",
        all(counters[frame] == 6 for frame in range(300, 420)) and 299 in full and 420 in full)
    drives = status["drives"]
    say("the drive behind the cut was stopped by its watchdog meanwhile", drives[2]["left"][0]["al_state"] == 0x14)
    say("am-sdk's own fault shows in the frame after", words[501][1] & 0x4F == 0x0F and words[500][1] & 0x6F == 0x27)
    say("with its cause it cannot be acknowledged, without it can", words[519][1] & 0x4F == 0x08 and words[600][1] & 0x6F == 0x27)
    say("safe torque off: switch-on disabled in the frame after, on again after it",
        words[701][0] & 0x804F == 0x8040 and words[800][0] & 0x6F == 0x27)
    say("mute: ten frames see nothing", [frame for frame in range(840, 880) if counters[frame] <= 0] == list(range(850, 860)))
    say("a drive that was off and on again is in INIT", drives[2]["al_state"] == 1 and counters[950] == 6)
    # Frame 980 of all is this one, counted from where all were enabled.
    frame = 980 - status["enabled_frame"]
    say("an order for a frame of all acts in that frame", (counters[frame - 1], counters[frame]) == (6, 3))
    say("an order that is none is refused", refused.startswith("error"))
    left = [drive["left_operation_enabled"] for drive in drives]
    say(f"left operation enabled: {left} times", left == [1, 2, 1])
    # What is off makes no step, and none is recorded.
    say("the judge counts the same in the record", [len(found[drive]["left_operation_enabled"]) for drive in "012"] == [1, 1, 1])
    say("in lockstep, with the same orders, the record is the same twice", troubled(ends)[3] == text)


def clock_without_sync(ends):
    trial = Trial(ends, "--clock")
    into_operation(pysoem, trial.master)
    begun = time.monotonic()
    for cycle in range(500):
        time.sleep(max(0, begun + cycle * CYCLE_NS * 1e-9 - time.monotonic()))
        trial.cycle()
    kinds = [trial.master.slaves[0].sdo_read(index, 1)[0] for index in (0x1C32, 0x1C33)]
    say("by the clock without SYNC0 the objects say free run", kinds == [0, 0])
    time.sleep(0.3)
    trial.master.read_state()
    say("silence: AL status code 0x1B of all", all((slave.state, slave.al_status) == (0x14, 0x1B) for slave in trial.master.slaves))
    _, found = trial.end()
    drive = found["0"]
    say(f"the drive ran on without frames for {drive['cycles_without_frame']} cycles, until its watchdog at 100 ms",
        90 <= drive["cycles_without_frame"] and drive["gap_ns_max"] == CYCLE_NS)


def deviations(master):
    return [int.from_bytes(slave._fprd(0x092C, 4), "little") & 0x7FFFFFFF for slave in master.slaves[1:]]


def clock_with_sync0(ends):
    trial = Trial(ends, "--clock", "--drift-ppm", "0,40,-25")
    master = trial.master
    master.config_map()
    say("distributed clocks found", master.config_dc())
    # SOEM wrote the time 0 to all at first; what the clocks say of themselves goes down from there.
    say("deviations before", min(deviations(master)) > 1_000_000)
    for slave in master.slaves:
        slave.dc_sync(True, CYCLE_NS)
        # A busy PC is forgiven a hundred cycles here.
        slave.sdo_write(0x10F1, 2, (300).to_bytes(2, "little"))
        slave.set_watchdog("processdata", 2000)
    into_operation(pysoem, master, mapped=True)
    begun = time.monotonic()
    for cycle in range(500):
        time.sleep(max(0, begun + cycle * CYCLE_NS * 1e-9 - time.monotonic()))
        trial.cycle()
    kinds = [slave.sdo_read(0x1C32, 1)[0] for slave in master.slaves]
    say("the objects say SYNC0", kinds == [2, 2, 2])
    away = deviations(master)
    delays = [int.from_bytes(slave._fprd(0x0928, 4), "little") for slave in master.slaves]
    say(f"delays found {delays} ns, deviation from the reference clock {away} ns (clocks wrong by 40 and -25 ppm)",
        delays == [0, 300, 600] and max(away) < 1000)
    time.sleep(0.3)
    master.read_state()
    say("three hundred cycles without a frame: AL status code 0x1A of all",
        all((slave.state, slave.al_status) == (0x14, 0x1A) for slave in master.slaves))
    trial.end()


def wrong_segments(ends):
    trial = Trial(ends, "--lockstep", "--units", "M,S-S,H-F", "--revision", "0:0x20000", "--product", "1:0x99", "--swap", "1:2",
                  "--lacks", "0:6077", "--short-map", "2", "--watchdog-fixed", "0", "--io", "1", count=4)
    first, io, second, third = trial.master.slaves
    say("a revision, a product, a swap and a slave of another kind in between",
        (first.rev, io.id, second.id, third.id) == (0x20000, 0x105, 4, 0x99))
    try:
        first.sdo_read(0x6077, 0)
        say("an object that it lacks could be read", False)
    except pysoem.SdoError as error:
        say("an object that it lacks: SDO abort 0x06020000", error.abort_code == 0x06020000)
    into_operation(pysoem, trial.master)
    lengths = [len(slave.output) for slave in trial.master.slaves]
    say("a map that lacks an entry, a slave without a mailbox: 20, 1, 16 and 20 bytes out", lengths == [20, 1, 16, 20])
    for slave in trial.master.slaves:
        slave._fpwr(0x0420, b"\x64\0")
    say("a watchdog that cannot be written", [slave._fprd(0x0420, 2)[0] for slave in (first, io)] == [1000 & 0xFF, 0x64])
    trial.end()


def sync0_of_another_cycle(ends):
    trial = Trial(ends, "--clock")
    trial.master.config_map()
    trial.master.config_dc()
    for slave in trial.master.slaves:
        slave.dc_sync(True, 2 * CYCLE_NS)
    trial.master.send_processdata()
    trial.master.receive_processdata(100_000)
    trial.master.state = pysoem.OP_STATE
    trial.master.write_state()
    trial.master.state_check(pysoem.OP_STATE, 50_000)
    trial.master.read_state()
    say("SYNC0 with another cycle than the drive's: AL status code 0x35",
        [(slave.state, slave.al_status) for slave in trial.master.slaves] == [(0x14, 0x35)] * 3)
    trial.end()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    for each in (orders_in_lockstep, clock_without_sync, clock_with_sync0, sync0_of_another_cycle, wrong_segments):
        each(sys.argv[1:])
