# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A recording small enough to smooth within a test: 320x240 at 30 Hz, a few seconds."""

import dataclasses
from functools import cache
from pathlib import Path

from ruledgraph.calibration import write_kalibr
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.recording import write_recording
from ruledgraph.simulation import D435I, Simulation, simulate

_CAMERA = D435I.camera
SMALL = dataclasses.replace(
    D435I,
    camera=CameraModel(
        320, 240, _CAMERA.fx / 2, _CAMERA.fy / 2, (_CAMERA.cx - 0.5) / 2, (_CAMERA.cy - 0.5) / 2
    ),
)


@cache
def small_simulation(seed: int = 0, moving: bool = False, duration: float = 4.5) -> Simulation:
    return new_small_simulation(seed, moving, duration)


def new_small_simulation(
    seed: int, moving: bool, duration: float = 4.5, readout: float = 0.0
) -> Simulation:
    return simulate(
        "noncoplanar_cluttered",
        "free",
        calibration=SMALL.with_readout(readout),
        rate=30.0,
        duration=duration,
        moving_start=moving,
        seed=seed,
    )


@cache
def small_stream(
    seed: int = 0, moving: bool = False, duration: float = 4.5
) -> tuple[tuple[Measurement, ...], Calibration]:
    simulation = small_simulation(seed, moving, duration)
    return tuple(simulation.stream()), simulation.calibration


def frames(measurements) -> list[Frame]:
    return [m for m in measurements if isinstance(m, Frame)]


def write_small_recording(folder: Path, duration: float = 4.5) -> Path:
    """`small_stream` as a bag, with `calib.yaml` beside it."""
    stream, calibration = small_stream(duration=duration)
    write_recording(stream, folder / "small.bag", "rosbag1")
    write_kalibr(calibration, folder / "calib.yaml")
    return folder / "small.bag"
