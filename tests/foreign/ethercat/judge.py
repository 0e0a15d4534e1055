#!/usr/bin/env python3
"""What a recorded session (segment.py --record) shows of each drive, as JSON.

    judge.py FILE [--from STEP] [--to STEP]

steps                    how often the drive moved on, in all AL states
steps_in_op              of them in OP; what follows counts those only
cycles_without_frame     steps that acted on outputs that had acted before: no frame came between
frames_overwritten       frames whose outputs never acted, because another came before the step (drives with a clock)
setpoints_repeated       outputs of a new frame that equal those before, while the ones around them differ: sent twice, or a
                         setpoint that happens to stay; at rest nothing is counted
second_difference_max    of the position, in its increments: of steps that follow one another, all in operation enabled
second_difference_at     the step of it
statuswords              their changes: [step, statusword], the first hundred
left_operation_enabled   [step, statusword] after it
"""

import argparse
import csv
import json
import sys

OP, ENABLED, STATE = 8, 0x27, 0x6F
CHANGES_TOLD = 100


def rows(path):
    frames, steps = {}, {}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            (frames if row["kind"] == "frame" else steps).setdefault(int(row["drive"]), []).append(row)
    return frames, steps


def enabled(row):
    return int(row["statusword"] or 0) & STATE == ENABLED


def repeated(outputs):
    return sum(
        before == here and earlier != before and later != here
        for earlier, before, here, later in zip(outputs, outputs[1:], outputs[2:], outputs[3:]))


def second_differences(steps):
    worst, at = 0, None
    for first, second, third in zip(steps, steps[1:], steps[2:]):
        if enabled(first) and enabled(second) and enabled(third):
            here = abs(int(first["position"]) - 2 * int(second["position"]) + int(third["position"]))
            if here > worst:
                worst, at = here, int(third["number"])
    return worst, at


def judged(steps, frames):
    running = [row for row in steps if int(row["al_state"]) == OP]
    acted = [row["frame"] for row in running]
    worst, at = second_differences(steps)
    words = [(int(row["number"]), int(row["statusword"] or 0)) for row in steps]
    changes = [list(words[0])] if words else []
    changes += [list(here) for before, here in zip(words, words[1:]) if before[1] != here[1]]
    firsts = [row for before, row in zip([None] + running, running) if before is None or before["frame"] != row["frame"]]
    in_op = [row for row in frames if int(row["al_state"]) == OP]
    # The frames between the first and the last that acted.
    between = [row for row in in_op if acted and int(acted[0]) <= int(row["number"]) <= int(acted[-1])]
    times = [int(row["time_ns"]) for row in running]
    return {
        "steps": len(steps), "steps_in_op": len(running), "frames_acted": len(firsts),
        "cycles_without_frame": len(running) - len(firsts),
        "frames_overwritten": len({row["number"] for row in between} - set(acted)),
        "setpoints_repeated": repeated([row["outputs"] for row in (between or firsts)]),
        "second_difference_max": worst, "second_difference_at": at,
        "gap_ns_max": max((b - a for a, b in zip(times, times[1:])), default=0),
        "position_first": int(steps[0]["position"]) if steps else None,
        "position_last": int(steps[-1]["position"]) if steps else None,
        "statusword_changes": len(changes), "statuswords": changes[:CHANGES_TOLD],
        "left_operation_enabled": [list(here) for before, here in zip(words, words[1:])
                                   if before[1] & STATE == ENABLED != here[1] & STATE],
    }


def judge(path, first=0, last=float("inf")):
    frames, steps = rows(path)
    return {str(drive): judged([row for row in steps[drive] if first <= int(row["number"]) <= last], frames.get(drive, []))
            for drive in sorted(steps)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--from", dest="first", type=int, default=0)
    parser.add_argument("--to", dest="last", type=float, default=float("inf"))
    options = parser.parse_args()
    print(json.dumps(judge(options.file, options.first, options.last), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
