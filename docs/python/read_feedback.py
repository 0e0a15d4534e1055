#!/usr/bin/env python3
"""Reads live samples of a running cell from shared memory: one line per sample of the feedback, the newest every 100 ms.

On the controller PC, as the user who runs the cell:

    pip install iceoryx2==0.10.0
    quadrant iceoryx-config > cell.toml
    python3 read_feedback.py cell.toml demo

It is an observer: its queue overwrites its oldest sample, and no process of the cell waits for it. The versions of iceoryx2 must be the same.
"""

import argparse
import sys

import iceoryx2 as iox2

from quadrant_samples import Feedback

MODES = ["disabled", "enabled", "stopping", "stopped", "tripped", "finished", "jogging", "ready"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", help="what `quadrant iceoryx-config` printed")
    parser.add_argument("cell", help="name of the cell")
    parser.add_argument("--samples", type=int, default=0, help="end after so many [default: never]")
    parser.add_argument("--increment-nm", type=float, default=1.0, help="of the axes, from the machine file")
    options = parser.parse_args()

    iox2.set_log_level(iox2.LogLevel.Error)
    config = iox2.config.from_file(iox2.FilePath.new(options.config))
    node = (
        iox2.NodeBuilder.new()
        .name(iox2.NodeName.new("python"))
        .config(config)
        .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        .create(iox2.ServiceType.Ipc)
    )
    # open, never open_or_create: the launcher alone creates services.
    service = (
        node.service_builder(iox2.ServiceName.new(f"{options.cell}/feedback"))
        .publish_subscribe(Feedback)
        .open()
    )
    subscriber = service.subscriber_builder().buffer_size(1).create()

    seen = 0
    try:
        while options.samples == 0 or seen < options.samples:
            sample = subscriber.receive()
            if sample is not None:
                feedback = sample.payload().contents
                mode = MODES[feedback.mode] if feedback.mode < len(MODES) else "?"
                axes = "  ".join(
                    f"{axis.motor_position * options.increment_nm * 1e-6:+.4f} mm {axis.torque_nm:+.3f} N·m"
                    for axis in feedback.axes[: feedback.axis_count]
                )
                print(f"scan {feedback.scan} {mode} override {feedback.override_percent} %  {axes}", flush=True)
                last = feedback.last
                # Frees its slot in the queue.
                sample.delete()
                seen += 1
                if last:
                    break
            node.wait(iox2.Duration.from_millis(100))
    except (KeyboardInterrupt, iox2.NodeWaitFailure):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
