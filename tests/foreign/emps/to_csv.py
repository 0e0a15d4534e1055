#!/usr/bin/env python3
"""Makes text of the EMPS measurements: DATA_EMPS.mat -> emps.csv, DATA_EMPS_PULSES.mat -> emps-pulses.csv.

    tests/foreign/emps/to_csv.py FOLDER_OF_THE_MAT_FILES OUTPUT_FOLDER

The data are of A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Nonlinear System Identification
Benchmarks, 2019 (nonlinearbenchmark.org): the motor and ball screw of a real linear axis, 24.84 s at 1 kHz. They are not part of
this repository. Columns: time_s, position_m (qm), command_m (qg), force_n (vir times gtau: the control signal as force). The
control signal of the second file has its pulses in it.

Needs nothing but Python: reads the numeric matrices of a MAT file of version 5 (MathWorks, "MAT-File Format").
"""

import pathlib
import struct
import sys
import zlib

KINDS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 9: "d", 12: "q", 13: "Q"}
MATRIX, COMPRESSED = 14, 15


def elements(data: bytes):
    """Kind and content of each data element, one after the other."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        if kind >> 16:  # a small element: four bytes of content within the tag
            yield kind & 0xFFFF, data[at + 4 : at + 4 + (kind >> 16)]
            at += 8
            continue
        yield kind, data[at + 8 : at + 8 + size]
        at += 8 + size
        if kind != COMPRESSED:
            at += -size % 8


def matrices(data: bytes):
    """Name and values of each numeric matrix."""
    for kind, content in elements(data):
        if kind == COMPRESSED:
            yield from matrices(zlib.decompress(content))
        elif kind == MATRIX:
            _flags, _dimensions, (_, name), (kind, values) = list(elements(content))[:4]
            count = len(values) // struct.calcsize(KINDS[kind])
            yield name.decode(), struct.unpack_from(f"<{count}{KINDS[kind]}", values)


def main() -> None:
    source, target = map(pathlib.Path, sys.argv[1:3])
    target.mkdir(parents=True, exist_ok=True)
    for mat, csv in [("DATA_EMPS.mat", "emps.csv"), ("DATA_EMPS_PULSES.mat", "emps-pulses.csv")]:
        data = dict(matrices((source / mat).read_bytes()[128:]))
        gain = data["gtau"][0]
        with open(target / csv, "w", encoding="utf-8") as out:
            out.write("time_s,position_m,command_m,force_n\n")
            for time, position, command, control in zip(*(data[name] for name in ("t", "qm", "qg", "vir"))):
                out.write(f"{time:.4f},{position:.12g},{command:.12g},{control * gain:.10g}\n")


if __name__ == "__main__":
    main()
