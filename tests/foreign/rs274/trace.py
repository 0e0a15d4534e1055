#!/usr/bin/python3
"""Runs part programs through LinuxCNC's interpreter and writes down what it asks of the machine.

    trace.py [--tools FILE] [--skip-marked] [--seconds S] [FILE...]

Needs Debian's package linuxcnc-uspace (its python module `gcode` is for Debian's own python, /usr/bin/python3) and a C++
compiler, which makes canon.cc into a library once.

Each line of the output is one command as a JSON array; lengths are in mm, positions are those of the axes X Y Z A B C U V W:

    ["rapid", LINE, [9 positions], feed in mm/min, feed as programmed, feed mode]      also "feed" and "probe"
    ["arc", LINE, [9], feed, feed as programmed, feed mode, [9: centre], [3: first direction of the plane], [3: second], turns]
    ["dwell", seconds]   ["speed", spindle, rpm]   ["clockwise", spindle]   ["flood", 0 or 1]   ["message", "text"]   ...

The last line of a program is ["done", status, line, "what is wrong"]; a status of 0 or below 5 means no error. Without
files, names are read from the standard input, one a line, and the output of each is flushed: one process for many programs.
A parameter file of zeros and an empty spindle are there at the start of each program; all probes trip at their end.
"""

import argparse
import atexit
import ctypes
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))
# Every parameter that LinuxCNC's interpreter wants in the file.
PARAMETERS = (
    [5161, 5162, 5163, 5164, 5165, 5166, 5167, 5168, 5169]
    + list(range(5181, 5190))
    + list(range(5210, 5221))
    + [base + i for base in range(5220, 5400, 20) for i in range(1, 11)]
)


def library(folder):
    """canon.cc as a library, made anew when it has changed."""
    source = os.path.join(HERE, "canon.cc")
    made = os.path.join(folder, f"canon-{int(os.stat(source).st_mtime_ns)}.so")
    if not os.path.exists(made):
        fresh = f"{made}.{os.getpid()}"
        subprocess.run(["c++", "-O1", "-fPIC", "-shared", "-o", fresh, source], check=True)
        os.replace(fresh, made)
    return made


class Canon:
    """What the module still asks of its caller."""

    def __init__(self, seconds, put):
        self.seconds, self.put, self.begun = seconds, put, 0.0

    def next_line(self, state):
        pass

    def check_abort(self):
        return time.monotonic() > self.begun + self.seconds

    def user_defined_function(self, number, p, q):
        self.put(f'["user", {100 + number}, {p!r}, {q!r}]')


class Interpreter:
    """LinuxCNC's interpreter, ready for one program after the other."""

    def __init__(self, options, output):
        self.output = output
        self.folder = tempfile.mkdtemp(prefix="rs274-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None)
        atexit.register(shutil.rmtree, self.folder, ignore_errors=True)
        # The tool table lives in a file of the home folder.
        os.environ["HOME"] = self.folder
        tools = ctypes.CDLL("libtooldata.so.0", mode=ctypes.RTLD_GLOBAL)
        tools["_Z17tool_mmap_creatorPK13EMC_TOOL_STATi"](None, 0)
        self.load_tools = tools["_Z13tooldata_loadPKcPPc"]
        self.load_tools.argtypes = [ctypes.c_char_p, ctypes.c_void_p]
        self.reset_tools = tools["_Z14tooldata_resetv"]
        kept = os.path.join(tempfile.gettempdir(), f"quadrant-rs274-{os.getuid()}")
        os.makedirs(kept, mode=0o700, exist_ok=True)
        self.canon = ctypes.CDLL(library(kept), mode=ctypes.RTLD_GLOBAL)
        self.canon.canon_reset.argtypes = [ctypes.c_char_p, ctypes.c_int]
        self.canon.canon_take.restype = ctypes.c_char_p
        import gcode

        self.gcode, self.options = gcode, options
        self.asked = Canon(options.seconds, self.put)
        self.parameters = os.path.join(self.folder, "rs274ngc.var")
        self.empty = "".join(f"{number}\t{1 if number == 5220 else 0}.000000\n" for number in PARAMETERS)
        self.beside = None

    def put(self, line):
        self.take()
        self.output.write(line + "\n")

    def take(self):
        self.output.write(self.canon.canon_take().decode("ascii", "replace"))

    def search_beside(self, folder):
        """Subroutines are looked for in the folder of the program."""
        if folder != self.beside:
            ini = os.path.join(self.folder, "interpreter.ini")
            with open(ini, "w") as file:
                file.write(f"[RS274NGC]\nSUBROUTINE_PATH = {folder}\n[DISPLAY]\nPROGRAM_PREFIX = {folder}\n")
            os.environ["INI_FILE_NAME"] = ini
            self.beside = folder

    def run(self, name):
        name = os.path.abspath(name)
        self.search_beside(os.path.dirname(name))
        with open(self.parameters, "w") as file:
            file.write(self.empty)
        self.reset_tools()
        if self.options.tools:
            self.load_tools(self.options.tools.encode(), None)
        self.canon.canon_reset(self.parameters.encode(), int(self.options.skip_marked))
        self.asked.begun = time.monotonic()
        try:
            status, line = self.gcode.parse(name, self.asked)
            wrong = self.gcode.strerror(status) if status >= self.gcode.MIN_ERROR else ""
        except BaseException as error:
            status, line, wrong = 1000, 0, f"{type(error).__name__}: {error}"
        self.take()
        self.output.write(json.dumps(["done", status, line, wrong]) + "\n")
        self.output.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tools", help="tool table, in LinuxCNC's format")
    parser.add_argument("--skip-marked", action="store_true", help="leave out the blocks that begin with /")
    parser.add_argument("--seconds", type=float, default=20.0, help="the longest time for one program")
    parser.add_argument("files", nargs="*")
    options = parser.parse_args()
    # What the interpreter itself prints does not belong in the output.
    output = os.fdopen(os.dup(1), "w", encoding="ascii", errors="replace")
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    kept_errors = os.dup(2)
    os.dup2(nothing, 2)
    try:
        interpreter = Interpreter(options, output)
    except BaseException:
        os.dup2(kept_errors, 2)
        raise
    for name in options.files or (line.rstrip("\n") for line in sys.stdin):
        interpreter.run(name)


if __name__ == "__main__":
    main()
