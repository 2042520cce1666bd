# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How much memory and time it takes to write and to read long recordings.

    python tools/benchmark_reading.py

Makes recordings of 1, 5 and 10 minutes (160x120 frames at 20 Hz, IMU at 200 Hz) in a temporary
folder and reads each in a process of its own. Memory is the peak resident set of that process,
less what it had before the recording was opened. Prints a Markdown table.
"""

import multiprocessing
import platform
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.recording import Kind, open_recording, write_recording

MINUTES = (1, 5, 10)
KINDS: tuple[Kind, ...] = ("rosbag1", "rosbag2", "mcap", "asl")
FRAME_RATE, IMU_RATE = 20, 200
HEIGHT, WIDTH = 120, 160


def measurements(minutes: int) -> Iterator[Measurement]:
    """Noise, frames and IMU samples in time order."""
    rng = np.random.default_rng(0)
    gravity = np.array([0.0, 0.0, 9.8])
    images = rng.integers(0, 256, (50, HEIGHT, WIDTH), dtype=np.uint8)
    for i in range(minutes * 60 * IMU_RATE):
        stamp = 1_700_000_000_000_000_000 + i * 1_000_000_000 // IMU_RATE
        yield ImuSample(stamp, rng.normal(size=3) * 0.1, rng.normal(size=3) + gravity)
        if i % (IMU_RATE // FRAME_RATE) == 0:
            yield Frame(stamp, images[i % len(images)])


def write(path: Path, kind: Kind, minutes: int) -> int:
    """Write a recording; returns how many measurements went into it."""
    count = 0

    def counted() -> Iterator[Measurement]:
        nonlocal count
        for measurement in measurements(minutes):
            count += 1
            yield measurement

    write_recording(counted(), path, kind)
    return count


def read(path: Path, _kind: Kind, _minutes: int) -> int:
    """Read it; returns how many measurements came out."""
    return sum(1 for _ in open_recording(path).stream())


def cost(task: Callable[[Path, Kind, int], int], *arguments: Any) -> tuple[int, float, float]:
    """What a task returns, seconds and MiB it takes, in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measure, (task, *arguments))


def _measure(task: Callable[..., int], *arguments: Any) -> tuple[int, float, float]:
    before, began = _peak(), time.perf_counter()
    result = task(*arguments)
    return result, time.perf_counter() - began, _peak() - before


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Print the table."""
    print(f"Python {platform.python_version()}, {platform.machine()}\n")
    print("| format | minutes | messages | write, s | write, MiB | read, s | read, MiB |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for kind in KINDS:
        for minutes in MINUTES:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder, "recording")
                written, write_seconds, write_memory = cost(write, path, kind, minutes)
                count, read_seconds, read_memory = cost(read, path, kind, minutes)
            if count != written:
                raise SystemExit(f"{kind}: {written} measurements written, {count} read")
            print(
                f"| {kind} | {minutes} | {count} | {write_seconds:.1f} | {write_memory:.0f} "
                f"| {read_seconds:.1f} | {read_memory:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
