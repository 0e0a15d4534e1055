#!/usr/bin/env python3
"""Makes text of the EMPS measurements: DATA_EMPS.mat -> emps.csv, DATA_EMPS_PULSES.mat -> emps-pulses.csv.

The data are of A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Nonlinear System Identification
Benchmarks, 2019 (nonlinearbenchmark.org): the motor and ball screw of a real linear axis, 24.84 s at 1 kHz. They are not part of
this repository. Columns: time_s, position_m (qm), command_m (qg), force_n (vir * gtau: the control signal as force). The pulses
that the second file adds are in its control signal already.

    pip install scipy
    tests/foreign/emps/to_csv.py FOLDER_OF_THE_MAT_FILES OUTPUT_FOLDER
"""

import pathlib
import sys

import scipy.io


def main() -> None:
    source, target = map(pathlib.Path, sys.argv[1:3])
    target.mkdir(parents=True, exist_ok=True)
    for mat, csv in [("DATA_EMPS.mat", "emps.csv"), ("DATA_EMPS_PULSES.mat", "emps-pulses.csv")]:
        data = scipy.io.loadmat(source / mat)
        gain = float(data["gtau"].ravel()[0])
        columns = [data[name].ravel() for name in ("t", "qm", "qg", "vir")]
        with open(target / csv, "w", encoding="utf-8") as out:
            out.write("time_s,position_m,command_m,force_n\n")
            for time, position, command, control in zip(*columns):
                out.write(f"{time:.4f},{position:.12g},{command:.12g},{control * gain:.10g}\n")


if __name__ == "__main__":
    main()
