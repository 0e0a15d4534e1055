"""Logic of xyz-cell: a changer with eight places, a vice, lubrication and a lamp.

It remembers nothing that it could not read back: what must outlive it are signals that keep their values (spindle_tool, pocket, changing, taking).
"""

import quadrant_logic

PLACES = 8
# Longest time for one step of the changer, and times of the lubrication, in s of the machine.
STEP_S = 5.0
LUBE_EVERY_S, LUBE_FOR_S = 60.0, 2.0

# Steps of a change. The number is kept in the signal `changing`, so that a logic that is started again goes on where the last one was.
IDLE, TO_OLD, IN_OLD, OPEN_OLD, OUT_OLD, TO_NEW, IN_NEW, CLOSE_NEW, OUT_NEW = range(9)


class Changer:
    """Puts the tool in the spindle back into its place, and takes the one that is wanted."""

    def __init__(self):
        self.pulse = None
        self.since = None
        self.step = None

    def update(self, io):
        step, tool, wanted = int(io["changing"]), int(io["spindle_tool"]), int(io["tool_wanted"])
        self.count_places(io)
        # What was wanted when the change began: the program may be given up meanwhile, and another tool be wanted.
        taking = int(io["taking"])
        # Nothing moves but while the program waits for the change: not in hold, and not where nobody has asked for it.
        given_up = step != IDLE and io.machine["program"] != "running"
        moves = io["tool_change"] or given_up and io["finish_change"]
        if given_up:
            io.alarm(703)
            io.inhibit()
        # The drawbar is open from the step in which it opens until the one in which it closes.
        if not moves:
            pass
        elif step == IDLE:
            if wanted != tool and 0 <= wanted <= PLACES:
                io["taking"] = wanted
                step = TO_OLD if tool else OPEN_OLD
        elif step == TO_OLD and self.turns_to(io, tool):
            step = IN_OLD
        elif step == IN_OLD and io["arm_in"]:
            step = OPEN_OLD
        elif step == OPEN_OLD and not io["tool_clamped"]:
            step = OUT_OLD
        elif step == OUT_OLD and io["arm_out"]:
            # An empty spindle that was wanted is reported once the changer is back.
            if taking:
                io["spindle_tool"] = 0
            step = TO_NEW if taking else CLOSE_NEW
        elif step == TO_NEW and self.turns_to(io, taking):
            step = IN_NEW
        elif step == IN_NEW and io["arm_in"]:
            step = CLOSE_NEW
        elif step == CLOSE_NEW and io["tool_clamped"]:
            step = OUT_NEW
        elif step == OUT_NEW and io["arm_out"]:
            io["spindle_tool"] = taking
            step = IDLE
        io["changing"] = step
        io["arm_valve"] = step in (IN_OLD, OPEN_OLD, IN_NEW, CLOSE_NEW)
        io["drawbar_valve"] = step in (OPEN_OLD, OUT_OLD, TO_NEW, IN_NEW)
        if not moves or step not in (TO_OLD, TO_NEW):
            io["carousel_motor"] = False
        self.watch(io, step, moves)

    def count_places(self, io):
        """A rising pulse is a place further; place 8 is followed by place 1."""
        pulse = io["pocket_pulse"]
        if pulse and self.pulse is False:
            io["pocket"] = int(io["pocket"]) % PLACES + 1
        self.pulse = pulse

    def turns_to(self, io, place):
        there = int(io["pocket"]) == place
        io["carousel_motor"] = not there
        return there

    def watch(self, io, step, moves):
        """A step that lasts too long is an alarm."""
        if step != self.step or not moves:
            self.step, self.since = step, io.time_s
        if step != IDLE and io.time_s - self.since > STEP_S:
            io.alarm(701)


changer = Changer()
lube_since = None


def update(io):
    global lube_since
    changer.update(io)
    io["vice_valve"] = io["vice_wanted"]
    if lube_since is None or io.time_s - lube_since > LUBE_EVERY_S:
        lube_since = io.time_s
    lubricates = io.time_s - lube_since < LUBE_FOR_S
    io["lube_pump"] = lubricates
    if lubricates and io.time_s - lube_since > LUBE_FOR_S - 0.1 and not io["lube_pressure"]:
        io.alarm(702)
    io["lamp_red"] = io["tripped"]
    io["lamp_green"] = io["program_runs"]


quadrant_logic.run(update)
