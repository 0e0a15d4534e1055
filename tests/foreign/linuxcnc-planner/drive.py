#!/usr/bin/env python3
"""Stands where LinuxCNC's screen would: runs the programs of programs.txt, one after the other, and writes to times.txt in how many
scans of 1 ms the axes moved. Scans in which they do not move, while the interpreter reads or between programs, are not counted."""
import os
import subprocess
import time

import linuxcnc

FOLDER = os.path.dirname(os.path.abspath(__file__))
LIMIT_S = 60.0

command, status = linuxcnc.command(), linuxcnc.stat()


def rests():
    status.poll()
    return status.interp_state == linuxcnc.INTERP_IDLE and status.inpos


def wait_for_rest():
    time.sleep(0.5)
    end = time.time() + LIMIT_S
    while time.time() < end:
        if rests():
            return True
        time.sleep(0.02)
    return False


def do(what, *arguments):
    what(*arguments)
    command.wait_complete(LIMIT_S)


def moving_s(samples):
    """Scans whose position differs from that of the scan before."""
    moving, before = 0, None
    for row in open(samples):
        position = row.split()[:3]
        if len(position) < 3 or "overrun" in row:
            continue
        if before is not None and position != before:
            moving += 1
        before = position
    return moving * 1e-3


def run(program, times):
    do(command.mode, linuxcnc.MODE_MDI)
    do(command.mdi, "G90 G21 G0 X0 Y0 Z0")
    wait_for_rest()
    do(command.mode, linuxcnc.MODE_AUTO)
    do(command.program_open, program)
    samples = os.path.join(FOLDER, "samples.txt")
    with open(samples, "w") as out:
        sampler = subprocess.Popen(["halsampler"], stdout=out)
        time.sleep(0.3)
        command.auto(linuxcnc.AUTO_RUN, 0)
        ended = wait_for_rest()
        time.sleep(0.3)
        sampler.terminate()
        sampler.wait()
    if not ended:
        do(command.abort)
    name = os.path.basename(program)
    times.write("%s %s\n" % (name, "%.3f" % moving_s(samples) if ended else "too long"))
    times.flush()


time.sleep(2)
do(command.state, linuxcnc.STATE_ESTOP_RESET)
do(command.state, linuxcnc.STATE_ON)
do(command.mode, linuxcnc.MODE_MANUAL)
do(command.home, -1)
time.sleep(1)
with open(os.path.join(FOLDER, "times.txt"), "w") as times:
    for line in open(os.path.join(FOLDER, "programs.txt")):
        if line.strip():
            run(line.strip(), times)
