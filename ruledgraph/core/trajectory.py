# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories, in memory and as TUM files: one `stamp x y z qx qy qz qw` a line."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.text_file import AppendOnlyFile
from ruledgraph.core.text_table import TableError, read_table

# Printed digits and float32 pass; other columns taken for a quaternion do not.
_UNIT = 0.1
_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


class TrajectoryError(RuledgraphError):
    """A trajectory, or a file of one, that is not what it should be."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses world_T_body over time.

    Quaternions are made unit, their signs those that keep neighbours close.

    Raises:
        TrajectoryError: for arrays that are empty, do not fit or are not finite, stamps that do
            not increase, and quaternions far from unit.
    """

    stamps: NDArray[np.int64]
    """ns, strictly increasing, (N,)."""
    positions: FloatArray
    """m, (N, 3)."""
    quaternions: FloatArray
    """x, y, z, w, (N, 4)."""

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps, dtype=np.int64)
        positions = np.array(self.positions, dtype=np.float64)
        quaternions = np.array(self.quaternions, dtype=np.float64)
        n = stamps.size
        if n == 0:
            raise TrajectoryError("a trajectory must have poses")
        if (stamps.shape, positions.shape, quaternions.shape) != ((n,), (n, 3), (n, 4)):
            raise TrajectoryError(
                f"stamps, positions and quaternions must have shapes (N,), (N, 3), (N, 4), not "
                f"{stamps.shape}, {positions.shape}, {quaternions.shape}"
            )
        if stamps[0] < 0 or np.any(stamps[1:] <= stamps[:-1]):
            raise TrajectoryError("stamps must increase strictly, from 0 on")
        if not (np.isfinite(positions).all() and np.isfinite(quaternions).all()):
            raise TrajectoryError("positions and quaternions must be finite")
        object.__setattr__(self, "stamps", stamps)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "quaternions", continuous(unit(quaternions)))

    def __len__(self) -> int:
        return len(self.stamps)

    @classmethod
    def from_poses(cls, stamps: ArrayLike, poses: Sequence[gtsam.Pose3]) -> "Trajectory":
        """The trajectory through poses, one a stamp (N,), ns."""
        positions = np.reshape([pose.translation() for pose in poses], (-1, 3))
        quaternions = np.reshape([quaternion_xyzw(pose) for pose in poses], (-1, 4))
        return cls(np.asarray(stamps), positions, quaternions)

    def poses(self) -> list[gtsam.Pose3]:
        """The poses, one a stamp."""
        return [
            gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), position)
            for (x, y, z, w), position in zip(self.quaternions, self.positions, strict=True)
        ]

    def at(self, stamps: ArrayLike) -> "Trajectory":
        """Interpolated at increasing stamps (M,), ns: positions linearly, rotations by slerp.

        Raises:
            TrajectoryError: for a stamp outside the trajectory.
        """
        wanted = np.array(stamps, dtype=np.int64)
        outside = wanted[(wanted < self.stamps[0]) | (wanted > self.stamps[-1])]
        if outside.size:
            raise TrajectoryError(
                f"stamp {seconds(outside[0])} is outside the trajectory, "
                f"{seconds(self.stamps[0])} to {seconds(self.stamps[-1])}"
            )
        if len(self) == 1:
            index = np.zeros(wanted.size, dtype=np.int64)
            return Trajectory(wanted, self.positions[index], self.quaternions[index])
        # Loaded here: it takes a third of a second, and those who only write need it not.
        from scipy.spatial.transform import Rotation, Slerp

        # Differences fit float64 exactly for 104 days.
        at = (wanted - self.stamps[0]).astype(np.float64)
        nodes = (self.stamps - self.stamps[0]).astype(np.float64)
        rotations = Slerp(nodes, Rotation.from_quat(self.quaternions))(at)
        positions = [np.interp(at, nodes, axis) for axis in self.positions.T]
        return Trajectory(wanted, np.stack(positions, axis=1), rotations.as_quat())

    def write_tum(self, path: str | Path) -> None:
        """Write a TUM file that reads back identically.

        Raises:
            TrajectoryError: when the file exists or cannot be written.
        """
        with TumWriter(path) as writer:
            for row in zip(self.stamps, self.positions, self.quaternions, strict=True):
                writer.append_row(*row)


def quaternion_xyzw(pose: gtsam.Pose3) -> FloatArray:
    """The rotation of a pose as a unit quaternion x, y, z, w, (4,)."""
    q: Any = pose.rotation().toQuaternion()  # GTSAM's stub does not know its type
    return np.array([q.x(), q.y(), q.z(), q.w()])


class TumWriter(Closing):
    """Writes a TUM file pose by pose; what was appended is on disk whatever comes after.

    Raises:
        TrajectoryError: when the file exists or cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._last_stamp = -1
        self._last_quaternion = _IDENTITY
        try:
            self._file = AppendOnlyFile(self.path)
        except FileExistsError:
            raise TrajectoryError(f"{path}: exists already, choose another name") from None
        except OSError as error:
            raise TrajectoryError(f"{path}: cannot be written: {error.strerror}") from None

    def append(self, stamp: int, pose: gtsam.Pose3) -> None:
        """Write world_T_body at a stamp, ns, later than the last; `MachineError` without space."""
        self.append_row(stamp, pose.translation(), quaternion_xyzw(pose))

    def append_row(self, stamp: int, position: FloatArray, quaternion: FloatArray) -> None:
        """Write a position (3,), m, and a unit quaternion x, y, z, w (4,)."""
        if stamp <= self._last_stamp:
            raise TrajectoryError(
                f"{self.path}: stamp {seconds(stamp)} is not after {seconds(self._last_stamp)}"
            )
        # As `continuous`: of q and -q the one nearer the last.
        q = -quaternion if quaternion @ self._last_quaternion < 0.0 else quaternion
        self._last_stamp, self._last_quaternion = int(stamp), q
        numbers = " ".join(repr(float(x)) for x in (*position, *q))
        self._file.write(f"{seconds(stamp)} {numbers}\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_tum(path: str | Path) -> Trajectory:
    """Read a TUM file.

    Raises:
        TrajectoryError: names the file and the line at fault.
    """
    try:
        table = read_table(Path(path))
        if table.width != 8:
            raise table.error(0, f"{table.width} columns, but TUM has 8: stamp x y z qx qy qz qw")
        numbers = table.numbers(range(1, 8))
        return Trajectory(table.stamps(0, "s"), numbers[:, :3], numbers[:, 3:])
    except TableError as error:
        raise TrajectoryError(str(error)) from None
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from None


def seconds(stamp: int) -> str:
    """A stamp in ns as seconds, exactly."""
    return f"{'-' if stamp < 0 else ''}{abs(stamp) // 10**9}.{abs(stamp) % 10**9:09d}"


def unit(quaternions: FloatArray) -> FloatArray:
    """Quaternions (N, 4) of unit length; ones that are so to rounding are left as they are.

    Raises:
        TrajectoryError: for one far from it.
    """
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    defect = np.abs(norms - 1.0)
    worst = int(np.argmax(defect))
    if defect[worst, 0] > _UNIT:
        raise TrajectoryError(
            f"quaternion {worst} has norm {norms[worst, 0]:.3g}, not 1; "
            "are the columns in this order?"
        )
    return np.where(defect < 1e-12, quaternions, quaternions / norms)


def continuous(quaternions: FloatArray) -> FloatArray:
    """The same rotations (N, 4), of q and -q the one nearer its predecessor.

    The first is the one nearer the identity.
    """
    before = np.concatenate([[_IDENTITY], quaternions[:-1]])
    flips = np.einsum("ij,ij->i", quaternions, before) < 0.0
    signs = np.cumprod(np.where(flips, -1.0, 1.0))
    return np.asarray(quaternions * signs[:, None])
