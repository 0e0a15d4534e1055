"""What the drives got and did, one CSV row for each of their steps, for a judge (judge.py).

In a segment whose drives run by their own clock there is a row for each process-data frame and drive as well (kind
`frame`); `frame` of a step says which frame's outputs acted.
"""

COLUMNS = ("kind", "number", "frame", "time_ns", "drive", "al_state", "outputs", "statusword", "position")


class Record:
    def __init__(self, path):
        self.file = open(path, "w", buffering=1 << 16)
        self.file.write(",".join(COLUMNS) + "\n")
        self.steps = {}

    def step(self, slave, outputs, now_ns):
        drive = slave.position
        number = self.steps[drive] = self.steps.get(drive, 0) + 1
        application = slave.application
        word = "" if application.statusword is None else application.statusword
        self.file.write(f"step,{number},{slave.acting_frame},{now_ns},{drive},{slave.state},{outputs.hex()},"
                        f"{word},{application.position}\n")

    def frame(self, slave, number, now_ns):
        start, size, _, _ = slave.sms[slave.out_sm]
        outputs = slave.memory[start:start + size].hex()
        self.file.write(f"frame,{number},{number},{now_ns},{slave.position},{slave.state},{outputs},,\n")

    def close(self):
        self.file.close()
