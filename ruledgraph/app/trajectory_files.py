# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories in the formats of KITTI and EuRoC, estimate by estimate."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.context import Closing
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.text_file import AppendOnlyFile
from ruledgraph.core.trajectory import seconds

TrajectoryFormat: TypeAlias = Literal["kitti", "euroc"]
"""Beside TUM's, which is always written."""

_EUROC_COLUMNS = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],"
    "q_RS_z [],v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],"
    "b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],"
    "b_a_RS_S_z [m s^-2]"
)


class KittiFiles(Closing):
    """`NAME_kitti.txt`, the upper three rows of world_T_body in a line, and `NAME_kitti_times.txt`,
    its stamps in s; as KITTI has them, but not counted from zero.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._poses = AppendOnlyFile(folder / f"{name}_kitti.txt")
        self._times = AppendOnlyFile(folder / f"{name}_kitti_times.txt")

    def append(self, estimate: Estimate) -> None:
        """Write a pose."""
        self._poses.write(" ".join(_texts(estimate.matrix[:3].ravel())) + "\n")
        self._times.write(f"{seconds(estimate.stamp)}\n")

    def close(self) -> None:
        """Close the files."""
        self._poses.close()
        self._times.close()


class EurocFile(Closing):
    """`NAME_euroc.csv`: pose, velocity and biases, as EuRoC's `state_groundtruth_estimate0`."""

    def __init__(self, folder: Path, name: str) -> None:
        self._file = AppendOnlyFile(folder / f"{name}_euroc.csv")
        self._file.write(f"{_EUROC_COLUMNS}\n")

    def append(self, estimate: Estimate) -> None:
        """Write a state."""
        x, y, z, w = estimate.quaternion_xyzw
        numbers = np.concatenate(
            [
                estimate.position,
                [w, x, y, z],
                estimate.velocity,
                estimate.gyroscope_bias,
                estimate.accelerometer_bias,
            ]
        )
        self._file.write(",".join([str(estimate.stamp), *_texts(numbers)]) + "\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


TRAJECTORY_FORMATS: dict[TrajectoryFormat, Callable[[Path, str], KittiFiles | EurocFile]] = {
    "kitti": KittiFiles,
    "euroc": EurocFile,
}


def _texts(numbers: FloatArray) -> list[str]:
    """Shortest digits that read back to the same."""
    return [repr(float(number)) for number in numbers]
