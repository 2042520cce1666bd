# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A simulation from the words of the command line."""

import re
from dataclasses import replace
from pathlib import Path

from ruledgraph.calibration import read_calibration
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE, D435I_LIKE, ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation.imu import RecordedImu
from ruledgraph.simulation.measured import MeasuredMotion
from ruledgraph.simulation.motions import MOTIONS
from ruledgraph.simulation.scenes import SCENES
from ruledgraph.simulation.simulation import D435I, Simulation, simulate

_IMUS: dict[str, ImuNoise | None] = {"d435i": D435I_LIKE, "euroc": ADIS16448_LIKE, "none": None}


def simulation_from_options(
    scene: str,
    motion: str,
    *,
    calibration: Path | None = None,
    resolution: str | None = None,
    rate: float = 90.0,
    imu: str | None = None,
    imu_rate: float = 200.0,
    readout: float | None = None,
    start: float = 0.0,
    duration: float | None = None,
    moving_start: bool = False,
    seed: int = 0,
) -> Simulation:
    """Simulate what the options of `ruledgraph simulate` say.

    Args:
        scene: its name.
        motion: a name, or a file with a measured trajectory.
        calibration: a calibration file, by default that of a D435i.
        resolution: WIDTHxHEIGHT.
        rate: frames a second.
        imu: d435i, euroc, none, or EuRoC's file of a real IMU that goes with the measured motion.
            By default what the calibration says.
        imu_rate: samples a second.
        readout: from the first row to the last, s, instead of the calibration's.
        start: where in a measured motion to begin, s.
        duration: s, by default 12, or all of a measured motion.
        moving_start: a named motion starts at full speed.
        seed: of all randomness.

    Raises:
        RuledgraphError: for what makes no sense or cannot be read.
    """
    sensors = D435I if calibration is None else read_calibration(calibration)
    if resolution is not None:
        sensors = _resized(sensors, resolution)
    if readout is not None:
        sensors = sensors.with_readout(readout)
    path = Path(motion)
    measured = motion not in MOTIONS and path.is_file()
    chosen: str | MeasuredMotion = (
        MeasuredMotion.read(path, start, duration) if measured else motion
    )
    if measured and moving_start:
        raise RuledgraphError(
            "a measured motion starts as it was measured, not with --moving-start"
        )
    if not measured and start:
        raise RuledgraphError("--start chooses a stretch of a measured motion, not of a named one")
    inertial: ImuNoise | RecordedImu | None
    if imu is None:
        inertial = sensors.imu_noise
    elif imu in _IMUS:
        inertial = _IMUS[imu]
    elif measured and Path(imu).is_file():
        inertial = RecordedImu(imu)
    else:
        raise RuledgraphError(
            f"IMU {imu!r} is none of {', '.join(_IMUS)}, nor a file beside a measured motion"
        )
    return simulate(
        scene,
        chosen,
        calibration=sensors,
        rate=rate,
        imu=inertial,
        imu_rate=imu_rate,
        duration=12.0 if duration is None else duration,
        moving_start=moving_start,
        seed=seed,
    )


def catalogue() -> str:
    """All scenes and motions, a line each."""
    lines = ["Scenes:"]
    lines += [f"  {name:<30}{scene.description}" for name, scene in SCENES.items()]
    lines += ["Motions:"]
    lines += [f"  {name:<30}{motion.description}" for name, motion in MOTIONS.items()]
    lines += ["  FILE                          measured: a TUM file or EuRoC's CSV"]
    return "\n".join(lines)


def size_of(resolution: str) -> tuple[int, int]:
    """Width and height in px of WIDTHxHEIGHT.

    Raises:
        RuledgraphError: for another text.
    """
    match = re.fullmatch(r"(\d+)x(\d+)", resolution)
    if match is None:
        raise RuledgraphError(f"resolution {resolution!r} is not WIDTHxHEIGHT, such as 640x480")
    return int(match[1]), int(match[2])


def _resized(calibration: Calibration, resolution: str) -> Calibration:
    """The same field of view, as far as the shape allows, with other pixels."""
    camera, (width, height) = calibration.camera, size_of(resolution)
    # The same for x and y: pixels stay square. Pixel (0, 0) has its centre at 0, hence the halves.
    scale = max(width / camera.width, height / camera.height)
    resized = replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx + 0.5 - 0.5 * camera.width) * scale + 0.5 * width - 0.5,
        cy=(camera.cy + 0.5 - 0.5 * camera.height) * scale + 0.5 * height - 0.5,
    )
    return replace(calibration, camera=resized).with_readout(calibration.readout)
