"""The logic of a machine under Quadrant, in Python (3.8 or later, the standard library alone).

A cell asks its logic once in so many periods, with what all signals show; the logic sets the signals that are its own and may ask the
machine to hold, to stop, not to start, or to trip:

    import quadrant_logic

    def update(io):
        io["chuck_valve"] = io["air_ok"] and io["chuck_button"]
        if not io["air_ok"]:
            io.inhibit()

    quadrant_logic.run(update)

What is said is JSON, a line each, on standard input and output (docs/howto/logic.md). Print to standard error: it comes into the cell's
messages.
"""

import json
import sys

PROTOCOL = 1


class Io:
    """What logic sees and says in one question."""

    def __init__(self, hello, index, question):
        self.hello = hello
        self.machine = question
        self._index = index
        self._said = {"scan": question["scan"], "set": {}}

    @property
    def time_s(self):
        """Time of the machine since the cell's first scan, in s: what delays are counted in."""
        return self.machine["time_s"]

    def __getitem__(self, name):
        """Value of a signal; of a switch True or False. What this answer has set counts already."""
        signal = self.hello["signals"][self._index[name]]
        value = self._said["set"].get(name, self.machine["values"][self._index[name]])
        return value != 0 if signal["kind"] == "bool" else value

    def __setitem__(self, name, value):
        """Sets a signal of the logic; it stays until it is set again."""
        if not self.hello["signals"][self._index[name]]["logic"]:
            raise KeyError(f"{name} is no signal of the logic")
        self._said["set"][name] = float(value)

    def hold(self):
        """Asks the machine to come to rest on the path, as long as this is said."""
        self._said["hold"] = True

    def stop(self):
        """Asks for the program to be stopped."""
        self._said["stop"] = True

    def inhibit(self):
        """Lets no program be started or resumed, as long as this is said."""
        self._said["inhibit"] = True

    def trip(self):
        """Has the machine brake at its limits and trip, as long as this is said."""
        self._said["trip"] = True

    def alarm(self, number):
        """Raises an alarm of the machine file, as long as this is said."""
        self._said.setdefault("alarms", []).append(number)


def run(update, begin=None):
    """Answers the cell until it ends: `update(io)` for each question; `begin(hello)` once, before the first."""
    hello = json.loads(sys.stdin.readline() or "null")
    if hello is None:
        return
    if hello["quadrant_logic"] != PROTOCOL:
        sys.exit(f"the cell speaks version {hello['quadrant_logic']}, not {PROTOCOL}")
    index = {signal["name"]: place for place, signal in enumerate(hello["signals"])}
    if begin is not None:
        begin(hello)
    _say({"ready": True})
    for line in sys.stdin:
        io = Io(hello, index, json.loads(line))
        update(io)
        _say(io._said)


def _say(what):
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()
