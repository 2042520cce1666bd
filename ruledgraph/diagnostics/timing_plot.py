# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The timing of a recording as a picture."""

from pathlib import Path

import numpy as np

from ruledgraph.diagnostics.checks import Observations, rests
from ruledgraph.recording.errors import RecordingError


def check_empty(folder: Path) -> None:
    """Make sure that nothing will be overwritten, before anything is computed.

    Raises:
        RecordingError: when the folder holds something, or is none.
    """
    if folder.exists() and not folder.is_dir():
        raise RecordingError(f"{folder}: exists and is no folder; name another one")
    if folder.is_dir() and any(folder.iterdir()):
        raise RecordingError(f"{folder}: is not empty; name another folder")


def draw_timing(seen: Observations, folder: Path) -> Path:
    """Steps between stamps, and what the IMU measured, in `timing.png`.

    Raises:
        RecordingError: when the folder holds something, or cannot be written.
    """
    from matplotlib.figure import Figure

    check_empty(folder)
    figure = Figure(figsize=(10, 8), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    for panel, name, stamps in (
        (panels[0], "camera", seen.frame_stamps),
        (panels[1], "IMU", seen.imu_stamps),
    ):
        if len(stamps) > 1:
            times = seen.times(stamps)
            panel.plot(times[1:], 1e3 * np.diff(times), ".", markersize=2)
            panel.set_ylim(bottom=0.0)
        panel.set_ylabel(f"{name}, step (ms)")
    if len(seen.imu_stamps) > 1:
        times, imu = seen.times(seen.imu_stamps), seen.imu
        for panel, first, label in (
            (panels[2], 0, "gyroscope (rad/s)"),
            (panels[3], 3, "accelerometer (m/s$^2$)"),
        ):
            for axis in range(3):
                panel.plot(times, imu[:, first + axis], linewidth=0.8, label="xyz"[axis])
            panel.fill_between(
                times,
                *panel.get_ylim(),
                where=rests(times, imu).tolist(),
                color="0.85",
                label="at rest",
            )
            panel.set_ylabel(label)
            panel.legend(loc="upper right", ncols=4)
    for panel in panels:
        panel.grid(alpha=0.3)
    panels[-1].set_xlabel("time (s)")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(folder / "timing.png", dpi=100)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be written: {error.strerror}") from None
    return folder / "timing.png"
