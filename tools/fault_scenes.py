# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings for the fault campaign: scenes and motions that do not show all that is wanted."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ruledgraph.calibration import read_calibration
from ruledgraph.calibration.rig import Calibration
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.recording import Recording, open_recording
from ruledgraph.simulation import D435I, Motion, Scene, Simulation, simulate
from ruledgraph.simulation.lighting import Lamp, light
from ruledgraph.simulation.materials import plain
from ruledgraph.simulation.motion import PathMotion
from ruledgraph.simulation.motions import MOTIONS, WORLD_R_CAM
from ruledgraph.simulation.paths import Legs, VelocityChange, standstill, to_and_fro
from ruledgraph.simulation.scene import Surface, panel, shell
from ruledgraph.simulation.scenes import make_scene
from ruledgraph.simulation.write import Files, write_simulation

# A hall so large that none of its corners comes into view: opposite corners, m.
_LOW, _HIGH = (-8.0, -8.0, -6.0), (1.8, 8.0, 6.0)
_LAMPS = (Lamp((-0.6, 1.0, 5.0), 50.0, 0.6),)
_TALL = 10.0
_RATE = 30.0
_REST = 12.0
_CORRIDOR_VELOCITY = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Source:
    """A stretch of a recording with its truth."""

    files: Files
    start: float | None = None
    duration: float | None = None

    def open(self) -> Recording:
        """To be read."""
        return open_recording(self.files.recording, start=self.start, duration=self.duration)

    @property
    def calibration(self) -> Calibration:
        """As it is."""
        return read_calibration(self.files.calibration)

    @property
    def truth(self) -> GroundTruth:
        """Of all of the recording."""
        return read_ground_truth(self.files.ground_truth)


class _LongRest(PathMotion):
    REST = _REST


def _hall(*things: Surface) -> Scene:
    wall = plain(0.6, 0.01)
    return light(
        [*things, *shell(_LOW, _HIGH, wall, wall, wall, texel=0.02)],
        _LAMPS,
        0.3,
        np.random.default_rng(0),
    )


def _slats(turn: float, places: list[tuple[float, float]]) -> Scene:
    """Parallel slats, seen from end to end; vertical ones turned by `turn`.

    Args:
        turn: in the plane of the image, rad.
        places: their distance and how far they are to the left, m.
    """
    along = np.array([0.0, -np.sin(turn), -np.cos(turn)])
    across = np.array([0.0, -np.cos(turn), np.sin(turn)])
    return _hall(
        *(
            panel(
                f"slat{i}", (x, 0, 0) - y * across, 0.05 * across, _TALL * along, plain(0.1, 0.02)
            )
            for i, (x, y) in enumerate(places)
        )
    )


_PLACES = [(1.7, -1.1), (1.2, -0.5), (1.7, -0.25), (1.4, 0.1), (1.1, 0.35), (1.7, 0.75), (1.5, 1.2)]


def _one_line() -> Scene:
    """A wall whose left half is dark."""
    return _hall(panel("half", (1.6, 4.0, 0), (0, -8.0, 0), (0, 0, -_TALL), plain(0.25, 0.02)))


def _free(seed: int, duration: float, kind: type[PathMotion] = PathMotion) -> Motion:
    paths = MOTIONS["free"].build(np.random.default_rng([seed, 1]))
    return kind(*paths, WORLD_R_CAM, D435I.body_T_cam.rotation().matrix(), duration)


def _pure_rotation(duration: float) -> Motion:
    """About the camera's centre, as of a camera on a tripod: the IMU moves a little."""
    paths = standstill(), to_and_fro([0.1, 0.25, 0.05], 3.0)
    return PathMotion(*paths, WORLD_R_CAM, D435I.body_T_cam.rotation().matrix(), duration)


def _constant_velocity(duration: float) -> Motion:
    """Along a corridor's lines, from the beginning, without a turn."""
    never = VelocityChange(2.0 * duration, 1.0, np.zeros(3))
    ahead = Legs(4.0 * duration, np.zeros(3), _CORRIDOR_VELOCITY, [never])
    mounting = D435I.body_T_cam.rotation().matrix()
    return PathMotion(ahead, standstill(), WORLD_R_CAM, mounting, duration, moving_start=True)


def make(name: str, seconds: float = 8.0) -> Simulation:
    """A recording by its name, one of `NAMES`."""
    scene = make_scene("noncoplanar_cluttered")
    motion = _free(0, seconds)
    if name == "vertical lines only":
        scene = _slats(0.0, _PLACES)
    elif name == "all lines parallel":
        scene = _slats(1.0, _PLACES)
    elif name == "one line":
        scene = _one_line()
    elif name == "pure rotation":
        motion = _pure_rotation(seconds)
    elif name == "long rest":
        motion = _free(0, _REST + seconds, _LongRest)
    elif name == "corridor at constant velocity":
        scene, motion = make_scene("corridor"), _constant_velocity(seconds)
    elif name == "start in motion":
        return simulate(scene, "free", rate=_RATE, duration=seconds, moving_start=True)
    return simulate(scene, motion, rate=_RATE)


NAMES = (
    "simulated",
    "start in motion",
    "long rest",
    "pure rotation",
    "vertical lines only",
    "all lines parallel",
    "one line",
    "corridor at constant velocity",
)


def cached(name: str, folder: Path) -> Source:
    """A recording by its name, rendered once into a folder."""
    out = folder / f"{name.replace(' ', '_')}.bag"
    files = Files.beside(out)
    if not all(path.exists() for path in files):
        for path in files:
            path.unlink(missing_ok=True)
        write_simulation(make(name), out, "rosbag1")
    return Source(files)


def right_camera(data: Path) -> Calibration | None:
    """The other camera of the real recording's rig, where its calibration is beside the data."""
    path = data.parent / "euroc_MH_01_stereo_30s" / "MH_01_stereo_30s.calib.yaml"
    return read_calibration(path, camera="cam1") if path.is_file() else None


def real(data: Path, start: float, duration: float) -> Source:
    """A stretch of the real recording."""
    bag = data / "MH_01_30s.bag"
    return Source(Files.beside(bag), start, duration)
