# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Writes measurements as a recording others can read."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ruledgraph.measurements import Measurement
from ruledgraph.sensors import Calibration

Kind: TypeAlias = Literal["rosbag1", "rosbag2", "mcap", "asl"]


class GroundTruthPose(NamedTuple):
    """world_T_body at a stamp, ns: position (3,), m, and quaternion (4,) in x, y, z, w order."""

    stamp: int
    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]


def write_recording(
    measurements: Iterable[Measurement],
    out: Path,
    kind: Kind,
    *,
    calibration: Calibration | None = None,
    image_topic: str = "/cam0/image_raw",
    imu_topic: str = "/imu0",
    ground_truth: Iterable[GroundTruthPose] | None = None,
) -> None:
    """Write measurements, one pass, as they come.

    Args:
        measurements: in time order; gaps are not written, the missing samples say it all.
        out: the file (`rosbag1`, `mcap`) or folder (`rosbag2`, an sqlite3 bag, and `asl`) to make.
        kind: the format.
        calibration: written as CameraInfo beside the image topic, in `asl` as sensor.yaml.
        image_topic: mono8 `sensor_msgs/Image`; `asl` writes PNG files of `cam0` instead.
        imu_topic: `sensor_msgs/Imu`; `asl` writes `imu0`.
        ground_truth: in time order; `geometry_msgs/PoseStamped` on `/ground_truth`, in `asl`
            `state_groundtruth_estimate0/data.csv`.

    Raises:
        RecordingError: when `out` exists, or cannot be written.
    """
    raise NotImplementedError
