# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A sensor that stops for good: does memory stay flat, and what does the status say?

    python tools/silence.py --minutes 10

Eight seconds of a simulated recording are tracked; then the IMU stops, repeats its last reading, or
the camera stops, and the other one goes on for so many minutes of stamps, fed as fast as they are
taken, the last two seconds at their pace. Both interfaces are tried, each case by a worker of its
own. Resident memory is printed after the first minute and at the end; the exit code is 1 if it grew
by more than 5 %.
"""

import gc
import resource
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

import ruledgraph
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.simulation.options import simulation_from_options

CASES = ("IMU stops", "frozen IMU", "camera stops")
_MAX_GROWTH = 0.05
_PACED = 2_000_000_000
_TRACKED, _FRAME, _SAMPLE = 8.0, 33_000_000, 5_000_000


class Found(NamedTuple):
    """Of one case."""

    before: float
    """Resident memory after a minute of silence, MB."""
    after: float
    """At the end, MB."""
    status: str


def silence(case: str, minutes: float, start: int, last: ImuSample) -> Iterator[Frame | ImuSample]:
    """The sensor that is left, and the readings of a frozen one."""
    rng = np.random.default_rng(0)
    image = np.zeros((240, 320), np.uint8)
    for stamp in range(start, start + round(minutes * 60e9), _SAMPLE):
        if case == "frozen IMU":
            yield last._replace(stamp=stamp)
        elif case == "camera stops":
            noise = rng.normal(size=(2, 3)) * 0.01
            yield ImuSample(stamp, last.gyroscope + noise[0], last.accelerometer + noise[1])
        if case != "camera stops" and stamp % _FRAME < _SAMPLE:
            yield Frame(stamp, image + np.uint8(stamp // _FRAME % 250))


def try_case(case: str, live: bool, minutes: float) -> Found:
    """Track, then feed what is left."""
    simulation = simulation_from_options(
        "noncoplanar_cluttered", "free", resolution="320x240", rate=30.0, duration=_TRACKED
    )
    odometry = ruledgraph.Odometry(simulation.calibration)
    worker = ruledgraph.LiveOdometry(simulation.calibration) if live else None

    def add(m: Measurement) -> None:
        if worker is None:
            odometry.add(m)
            odometry.take_live(), odometry.take_smoothed(), odometry.take_lines()
        elif isinstance(m, Frame):
            while worker.waiting > 8 and case == "camera stops":
                time.sleep(0.001)
            worker.add_image(m.image, t_ns=m.stamp)
        elif isinstance(m, ImuSample):
            worker.add_imu(m.gyroscope, m.accelerometer, t_ns=m.stamp)

    last, stamp = ImuSample(0, np.zeros(3), np.zeros(3)), simulation.epoch
    for m in simulation.stream():
        if isinstance(m, ImuSample):
            last, stamp = m, m.stamp
        add(m)
        while worker is not None and worker.waiting > 8:
            time.sleep(0.001)
    before, minute, end = 0.0, stamp + 60 * 10**9, stamp + round(minutes * 60e9)
    for m in silence(case, minutes, stamp + _SAMPLE, last):
        if live and m.stamp > end - _PACED:
            time.sleep((m.stamp - stamp) * 1e-9)  # its status goes by the clock
        stamp = m.stamp
        add(m)
        if not before and m.stamp > minute:
            before = _resident()
    found = Found(before, _resident(), odometry.status if worker is None else worker.status)
    if worker is not None:
        worker.close()
    return found


def _resident() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


@click.command(help=__doc__)
@click.option("--minutes", default=10.0, show_default=True)
def main(minutes: float) -> None:
    """Command line."""
    grew = False
    for live in (False, True):
        work = partial(try_case, live=live, minutes=minutes)
        for case in CASES:
            # A worker for each: what a case leaves behind is not the next one's memory.
            ((_, found),) = in_parallel(work, [case], workers=1)
            grew = grew or found.after > (1.0 + _MAX_GROWTH) * found.before
            name = "LiveOdometry" if live else "Odometry"
            click.echo(
                f"{name}, {case}: {found.before:.1f} to {found.after:.1f} MB; {found.status}"
            )
    if grew:
        sys.exit(1)


if __name__ == "__main__":
    main()
