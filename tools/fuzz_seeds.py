# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Small good files of every kind that is read, to be mutated by `fuzz.py`.

Each function writes its files into an empty folder and returns the one to mutate.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ruledgraph.calibration import write_kalibr
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.core.settings import config_text
from ruledgraph.recording import Kind, write_recording
from ruledgraph.simulation import D435I

_EPOCH = 1_700_000_000 * 10**9
_NOISE = """\
accelerometer_noise_density: 0.002
accelerometer_random_walk: 3e-3
gyroscope_noise_density: 1.6e-04
gyroscope_random_walk: 2e-05
"""
_POSE = "[0.0, 0.0, 1.0, 0.1, -1.0, 0.0, 0.0, 0.2, 0.0, -1.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]"
_ASL_CAMERA = f"""\
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
T_BS:
  cols: 4
  rows: 4
  data: {_POSE}
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.5, 457.25, 367.0, 248.0] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 2e-05]
"""
_ASL_IMU = f"""\
%YAML:1.0
---
sensor_type: imu
T_BS: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]
rate_hz: 200
{_NOISE}"""
_CAMERA_INFO = """\
image_width: 640
image_height: 480
camera_name: d435i
camera_matrix: {rows: 3, cols: 3, data: [610.5, 0, 322.25, 0, 611.5, 239.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0.1, 0.001, 0.001, 0.0]}
"""


def _text(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def _kalibr(folder: Path) -> Path:
    path = folder / "kalibr.yaml"
    write_kalibr(D435I, path)
    return path


def _asl(folder: Path, mutate: int) -> Path:
    files = [_text(folder, "cam.yaml", _ASL_CAMERA), _text(folder, "imu.yaml", _ASL_IMU)]
    return files[mutate]


def _camera_info(folder: Path) -> Path:
    _kalibr(folder)
    return _text(folder, "info.yaml", _CAMERA_INFO)


CALIBRATIONS: dict[str, Callable[[Path], Path]] = {
    "calibration, kalibr": _kalibr,
    "calibration, asl camera": partial(_asl, mutate=0),
    "calibration, asl imu": partial(_asl, mutate=1),
    "calibration, camera info": _camera_info,
}


def config(folder: Path) -> Path:
    """All settings."""
    return _text(folder, "config.yaml", config_text(Config()))


def _poses(rows: int = 6) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    rng = np.random.default_rng(0)
    quaternions = rng.normal(size=(rows, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.hstack([rng.normal(size=(rows, 3)), quaternions])


def tum(folder: Path) -> Path:
    """A trajectory."""
    rows = (
        f"{1.7e9 + 0.1 * i:.9f} " + " ".join(f"{x:.6f}" for x in row)
        for i, row in enumerate(_poses())
    )
    return _text(folder, "a.tum", "# stamp x y z qx qy qz qw\n" + "\n".join(rows) + "\n")


def euroc(folder: Path) -> Path:
    """States of the EuRoC dataset."""
    head = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y []\n"
    rows = (
        f"{_EPOCH + i * 10**8}," + ",".join(f"{x:.6f}" for x in [*row, *range(9)])
        for i, row in enumerate(_poses())
    )
    return _text(folder, "data.csv", head + "\n".join(rows) + "\n")


def kitti(folder: Path) -> Path:
    """Poses, and their times beside them."""
    _text(folder, "times.txt", "\n".join(f"{0.1 * i:.6e}" for i in range(6)) + "\n")
    row = "1 0 0 {} 0 1 0 0.5 0 0 1 0"
    return _text(folder, "00.txt", "\n".join(row.format(0.1 * i) for i in range(6)) + "\n")


def markers_csv(folder: Path) -> Path:
    """Points."""
    return _text(folder, "m.csv", "name,x,y,z\ntop/1,0.1,0.2,0.3\ntop/2,1e-3,2,3\nb/1,4,5,6\n")


def markers_yaml(folder: Path) -> Path:
    """Points."""
    return _text(folder, "m.yaml", "top/1: [0.1, 0.2, 0.3]\ntop/2: [1e-3, 2, 3]\n")


def _measurements() -> list[Measurement]:
    rng = np.random.default_rng(0)
    found: list[Measurement] = []
    for i in range(40):
        rate, force = rng.normal(size=(2, 3))
        found.append(ImuSample(_EPOCH + i * 10**7, rate, force))
        if i % 8 == 4:
            image = rng.integers(0, 256, (12, 16), dtype=np.uint8)
            found.append(Frame(_EPOCH + i * 10**7 + 1, image))
    return found


def _recording(folder: Path, kind: Kind, pattern: str) -> Path:
    out = folder / {"rosbag1": "a.bag", "mcap": "a.mcap"}.get(kind, "a")
    write_recording(_measurements(), out, kind)
    return next(iter(sorted(out.glob(pattern)))) if pattern else out


RECORDINGS: dict[str, Callable[[Path], Path]] = {
    "recording, rosbag1": partial(_recording, kind="rosbag1", pattern=""),
    "recording, mcap": partial(_recording, kind="mcap", pattern=""),
    "recording, sqlite3": partial(_recording, kind="rosbag2", pattern="*.db3"),
    "recording, metadata.yaml": partial(_recording, kind="rosbag2", pattern="metadata.yaml"),
    "recording, asl images": partial(_recording, kind="asl", pattern="mav0/cam0/data.csv"),
    "recording, asl imu": partial(_recording, kind="asl", pattern="mav0/imu0/data.csv"),
    "recording, png": partial(_recording, kind="asl", pattern="mav0/cam0/data/*.png"),
}
