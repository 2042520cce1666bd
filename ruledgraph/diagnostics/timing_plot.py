# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The timing of a recording as a picture."""

from pathlib import Path

import numpy as np

from ruledgraph.core.config import DEFAULTS, RestConfig
from ruledgraph.core.new_folder import new_folder
from ruledgraph.diagnostics.checks import Observations, rests


def draw_timing(seen: Observations, folder: Path, rest: RestConfig = DEFAULTS.rest) -> Path:
    """Steps between stamps, what the IMU measured, and where it rests, in `timing.png`.

    Raises:
        FolderError: when the folder holds something, or cannot be written.
    """
    from ruledgraph.core import figure_style as style

    with style.figure_style(), new_folder(folder):
        figure = style.new_figure(11.0, 8.0)
        panels = figure.subplots(4, 1, sharex=True)
        for panel, name, stamps, color in (
            (panels[0], "camera", seen.frame_stamps, style.SERIES[0]),
            (panels[1], "IMU", seen.imu_stamps, style.SERIES[5]),
        ):
            if len(stamps) > 1:
                times = seen.times(stamps)
                steps = 1e3 * np.diff(times)
                panel.plot(times[1:], steps, ".", markersize=2.5, color=color)
                panel.set_ylim(0.0, 1.15 * steps.max())
            panel.set(title=f"{name}: step between stamps", ylabel="ms")
        if len(seen.imu_stamps) > 1:
            times, imu = seen.times(seen.imu_stamps), seen.imu
            resting = rests(times, imu, rest).tolist()
            for panel, first, name, unit in (
                (panels[2], 0, "gyroscope", "rad/s"),
                (panels[3], 3, "accelerometer", "m/s²"),
            ):
                for axis in range(3):
                    color = style.AXES[axis]
                    panel.plot(times, imu[:, first + axis], lw=0.8, color=color, label="xyz"[axis])
                limits = panel.get_ylim()
                panel.fill_between(times, *limits, where=resting, color="0.9", label="at rest")
                panel.set(title=name, ylabel=unit, ylim=limits)
                panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
        panels[-1].set_xlabel("time (s)")
        style.save_figure(figure, folder / "timing.png", 110)
    return folder / "timing.png"
