#!/usr/bin/env python3
"""Reads a run's log with the packages of others, checks the file as `mcap doctor` does, and measures it anew.

    pip install 'mcap>=1.6' mcap-ros2-support
    read_mcap.py RUN_DIR/run.mcap

Knows nothing of Quadrant but the names of topics and fields. Prints one JSON object; exit status 1 if the file breaks a rule of
the format (https://mcap.dev/spec, profile ros2 of https://mcap.dev/spec/registry). A log whose recorder was killed has no
summary: it is read from its beginning as far as its last whole chunk.
"""

import json
import math
import sys

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Header, Message, Schema
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

# Mode::Disabled of the feedback: drives off.
DISABLED = 0
# Units that end a name, and names of counts, marks and places in lists, which have none.
UNITS = (
    "_mm", "_mm_s", "_um", "_nm", "_n", "_k", "_s", "_scans", "_percent", "_mm_s2",
)


class Log:
    """What stands in the file, in its order."""

    def __init__(self, path):
        self.problems = []
        self.schemas, self.channels = {}, {}
        self.messages, self.last_time = {}, {}
        self.ended, self.cut = False, None
        self.decoders, self.factory = {}, DecoderFactory()
        self.path = path

    def complain(self, what):
        if len(self.problems) < 20:
            self.problems.append(what)

    def samples(self):
        """(topic, log time in ns, sample) of every message; CRCs are checked."""
        with open(self.path, "rb") as file:
            records = StreamReader(file, emit_chunks=False, validate_crcs=True, record_size_limit=None).records
            while True:
                try:
                    record = next(records)
                except StopIteration:
                    return
                except (EndOfFile, McapError) as error:
                    self.cut = str(error) or type(error).__name__
                    return
                sample = self.take(record)
                if sample is not None:
                    yield sample

    def take(self, record):
        if isinstance(record, Header):
            if record.profile != "ros2":
                self.complain(f"profile {record.profile!r}: must be ros2")
        elif isinstance(record, Schema):
            if record.encoding != "ros2msg" or "/msg/" not in record.name:
                self.complain(f"schema {record.name}: encoding {record.encoding}: must be ros2msg, package/msg/Type")
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            if record.message_encoding != "cdr" or "offered_qos_profiles" not in record.metadata:
                self.complain(f"channel {record.topic}: profile ros2 asks for cdr and offered_qos_profiles")
            if record.schema_id not in self.schemas:
                self.complain(f"channel {record.topic}: its schema has not been told")
            self.channels[record.id] = record
        elif isinstance(record, DataEnd):
            self.ended = True
        elif isinstance(record, Message):
            return self.message(record)
        return None

    def message(self, record):
        channel = self.channels.get(record.channel_id)
        if channel is None:
            self.complain(f"message on channel {record.channel_id}, which has not been told")
            return None
        topic = channel.topic
        expected = self.messages.get(topic, 0)
        if record.sequence != expected:
            self.complain(f"{topic}: message {record.sequence} follows {expected - 1}")
        self.messages[topic] = expected + 1
        # A row for people that waited for a sample that never came is written when its place is needed.
        if record.log_time < self.last_time.get(topic, 0) and not topic.startswith("/axis/"):
            self.complain(f"{topic}: log time {record.log_time} is before that of the message before it")
        self.last_time[topic] = record.log_time
        decode = self.decoders.get(record.channel_id)
        if decode is None:
            decode = self.factory.decoder_for(channel.message_encoding, self.schemas[channel.schema_id])
            self.decoders[record.channel_id] = decode
        return topic, record.log_time, decode(record.data)


def column(sample, name):
    """A number of every row of a message: told for each, once for all, or as a first value and a step; of an export, of its one row."""
    told = getattr(sample, name)
    if not hasattr(sample, "rows"):
        return [told]
    rows = sample.rows
    if len(told) == rows:
        return told
    first, step = told[0], told[1] if len(told) == 2 else 0
    return [first + step * row for row in range(rows)]


def measure(log):
    """The numbers of report.json, from the samples alone."""
    scans, modes, errors = set(), {}, {}
    row_peak_um = {}
    for topic, _, sample in log.samples():
        if topic == "/feedback":
            of_message = column(sample, "scan")
            scans.update(of_message)
            modes.update(zip(of_message, column(sample, "mode")))
        elif topic.startswith("/command/") and not topic.endswith("/b"):
            of_message = zip(column(sample, "scan"), column(sample, "following_error_mm"))
            errors.setdefault(topic.rsplit("/", 1)[1], {}).update(of_message)
        elif topic.startswith("/axis/"):
            axis = topic.rsplit("/", 1)[1]
            rows = [abs(e) for e in column(sample, "following_error_um") if math.isfinite(e)]
            row_peak_um[axis] = max([row_peak_um.get(axis, 0.0), *rows])
    axes = {}
    for axis, of_axis in errors.items():
        counted = [abs(e) * 1e3 for scan, e in of_axis.items() if modes.get(scan, DISABLED) != DISABLED]
        axes[axis] = {
            "following_error_um_peak": max(counted, default=0.0),
            "following_error_um_rms": math.sqrt(sum(e * e for e in counted) / max(len(counted), 1)),
            "row_following_error_um_peak": row_peak_um.get(axis, 0.0),
        }
    return {
        "scans": max(scans) - min(scans) + 1 if scans else 0,
        "first_scan": min(scans, default=None),
        "last_scan": max(scans, default=None),
        "axes": axes,
        "row_following_error_um_peak": row_peak_um,
    }


def check_summary(log):
    """What the end of the file says must be what stands in it, and be found by its index."""
    with open(log.path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            log.complain("no summary at the end")
            return
        told = {summary.channels[id].topic: n for id, n in summary.statistics.channel_message_counts.items()}
        if told != log.messages:
            log.complain(f"statistics say {told}, the file has {log.messages}")
        if summary.statistics.chunk_count != len(summary.chunk_indexes):
            log.complain("not every chunk is in the index")
        last = summary.statistics.message_end_time
        # An export has no feedback.
        each_scan = [topic for topic in told if topic == "/feedback" or topic.startswith("/axis/")]
        late = reader.iter_messages(topics=each_scan, starting_at=last - 1_000_000_000)
        found = {channel.topic for _, channel, _ in late}
        if found != set(each_scan):
            log.complain(f"of {each_scan} the index finds {sorted(found)} in the last second")


def units(log):
    """Fields of the rows for people must say their unit."""
    for schema in log.schemas.values():
        if not schema.name.endswith(("/AxisRowColumns", "/AxisRow")):
            continue
        for line in schema.data.decode().splitlines():
            name = line.split()[1]
            if name != "rows" and not name.endswith(UNITS):
                log.complain(f"{schema.name}.{name} does not say its unit")


def main():
    log = Log(sys.argv[1])
    found = measure(log)
    if log.ended and log.cut is None:
        check_summary(log)
    units(log)
    found |= {"whole": log.ended and log.cut is None, "messages": log.messages, "problems": log.problems}
    print(json.dumps(found))
    return 1 if log.problems else 0


if __name__ == "__main__":
    sys.exit(main())
