# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth from files (TUM, EuRoC CSV, KITTI) and from topics of a recording."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.text_table import Table, TableError, read_table
from ruledgraph.core.trajectory import Trajectory, TrajectoryError, continuous, unit

if TYPE_CHECKING:  # loads the decoders of images and bags
    from ruledgraph.recording.recording import Recording

POSITIONS = {
    "geometry_msgs/msg/PointStamped": "point",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "geometry_msgs/msg/TransformStamped": "transform",
    "nav_msgs/msg/Odometry": "pose.pose",
}
"""Message type -> where in it the position is, and the orientation if it has one."""

_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
# Of the rows of KITTI's matrices, which have seven printed digits.
_ORTHONORMAL = 1e-2
# Trackers report a lost body as the quaternion 0, 0, 0, 0.
_NO_ORIENTATION = 1e-6


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Measured positions, and orientations where there are any, in the order of their stamps."""

    stamps: NDArray[np.int64]
    """ns, strictly increasing, (N,), N >= 1."""
    positions: FloatArray
    """m, (N, 3)."""
    quaternions: FloatArray | None
    """x, y, z, w, (N, 4), unit and sign-continuous; None where positions alone were measured."""
    dropped: int = 0
    """Poses left out: not finite, or without a valid orientation or stamp."""
    repeated: int = 0
    """Poses left out: of a stamp that came before."""

    @property
    def trajectory(self) -> Trajectory:
        """As poses.

        Raises:
            TrajectoryError: when there are no orientations.
        """
        if self.quaternions is None:
            raise TrajectoryError("the ground truth has positions alone, no orientations")
        return Trajectory(self.stamps, self.positions, self.quaternions)


def read_ground_truth(source: str | Path, recording: "Recording | None" = None) -> GroundTruth:
    """Read ground truth from a file, whose format its content tells, or a recording's topic.

    Files: TUM; EuRoC and TUM-VI CSV, with orientations and without; KITTI poses, with their
    `times.txt` beside them or named after a comma, `poses.txt,times.txt`.

    Topics: PoseStamped, PoseWithCovarianceStamped, TransformStamped, PointStamped, Odometry, and
    TFMessage, of which a child frame is named after a colon, `/tf:vicon/body`. Stamps are those
    of the headers.

    Args:
        source: the file or topic.
        recording: where to look for a topic.

    Raises:
        TrajectoryError: names the file and line, or topic, at fault.
        RecordingError: when the recording cannot be read.
    """
    path = Path(source)
    poses, comma, times = str(source).partition(",")
    try:
        if comma and Path(poses).is_file() and not path.is_file():
            return _kitti(read_table(Path(poses)), Path(times))
        if recording is None or path.is_file():
            return _from_file(path)
    except TableError as error:
        raise TrajectoryError(str(error)) from None
    return _from_topic(str(source), recording)


def _from_file(path: Path) -> GroundTruth:
    table = read_table(path)
    if table.width == 12 and not table.commas:
        return _kitti(table, path.with_name("times.txt"))
    if table.width != 4 and not (table.width == 8 or (table.width > 8 and table.commas)):
        raise table.error(
            0,
            f"{table.width} columns; ground truth has 8 (stamp, position, quaternion), "
            "4 without the quaternion, 17 in EuRoC's states, 12 in KITTI's poses",
        )
    # EuRoC's stamps are whole nanoseconds, TUM's have a point.
    whole = table.commas and all(row[0].isdecimal() for row in table.rows)
    stamps = table.stamps(0, "ns" if whole else "s")
    if table.width == 4:
        return _cleaned(str(path), stamps, table.numbers(range(1, 4)), None)
    numbers = table.numbers(range(1, 8))
    quaternions = np.roll(numbers[:, 3:], -1, axis=1) if _w_first(table) else numbers[:, 3:]
    return _cleaned(str(path), stamps, numbers[:, :3], quaternions)


def _w_first(table: Table) -> bool:
    """Whether quaternions begin with w: as the header says, else as is custom."""
    names = [name.partition("[")[0].strip().lower() for name in table.header]
    for column, w_first in ((4, True), (7, False)):
        if len(names) > column and names[column][:1] == "q" and names[column][-1:] == "w":
            return w_first
    return table.commas


def _kitti(table: Table, times: Path) -> GroundTruth:
    """Rows of a 3x4 matrix, whose stamps, s, are in a file of their own."""
    if table.width != 12:
        raise table.error(0, f"{table.width} columns, but KITTI's poses have 12")
    if not times.exists():
        raise TableError(
            f"{table.path}: KITTI poses need their stamps, and there is no {times}; "
            f"name the file after a comma: {table.path},times.txt"
        )
    stamps = read_table(times).stamps(0, "s")
    if len(stamps) != len(table.rows):
        raise TableError(f"{times}: {len(stamps)} stamps, but {len(table.rows)} poses")
    matrices = table.numbers(range(12)).reshape(-1, 3, 4)
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    R = np.where(finite[:, None, None], matrices[:, :, :3], np.eye(3)).clip(-2.0, 2.0)
    defect = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (defect > _ORTHONORMAL) | (np.linalg.det(R) < 0.0)
    if wrong.any():
        raise table.error(int(np.argmax(wrong)), "its first three columns are no rotation")
    # Loaded here: it takes a third of a second, and other formats have quaternions.
    from scipy.spatial.transform import Rotation

    quaternions = np.where(finite[:, None], Rotation.from_matrix(R).as_quat(), np.nan)
    return _cleaned(str(table.path), stamps, matrices[:, :, 3], quaternions)


def _from_topic(source: str, recording: "Recording") -> GroundTruth:
    name, _, frame = source.partition(":")
    topic = next((t for t in recording.topics if t.name.strip("/") == name.strip("/")), None)
    if topic is None or topic.type not in (*POSITIONS, *_TRANSFORMS):
        usable = [t.name for t in recording.topics if t.type in (*POSITIONS, *_TRANSFORMS)]
        what = f"holds {topic.type}, no poses" if topic else "is no file and no topic"
        instead = f"; topics with ground truth: {', '.join(usable)}" if usable else ""
        raise TrajectoryError(f"{source}: {what}{instead}")
    messages = recording.messages(topic.name)
    if topic.type in _TRANSFORMS:
        rows = _frame_rows(source, (message for _, message in messages), frame.strip("/"))
    else:
        rows = [(stamp, *_row(inner(message, topic.type))) for stamp, message in messages]
    if not rows:
        raise TrajectoryError(f"{source}: holds no messages that can be read")
    stamps = np.array([row[0] for row in rows], dtype=np.int64)
    numbers = np.array([row[1:] for row in rows], dtype=np.float64)
    quaternions = numbers[:, 3:] if numbers.shape[1] == 7 else None
    return _cleaned(source, stamps, numbers[:, :3], quaternions)


def inner(message: Any, message_type: str) -> Any:
    """The Point, Pose or Transform in a message of one of the types in `POSITIONS`."""
    for name in POSITIONS[message_type].split("."):
        message = getattr(message, name)
    return message


def position(pose: Any) -> tuple[float, float, float]:
    """Of a Point, Pose or Transform."""
    for name in ("position", "translation"):
        pose = getattr(pose, name, pose)
    return pose.x, pose.y, pose.z


def _row(pose: Any) -> tuple[float, ...]:
    """Position, and quaternion where there is one."""
    q = getattr(pose, "orientation", None) or getattr(pose, "rotation", None)
    return (*position(pose), q.x, q.y, q.z, q.w) if q else position(pose)


def _frame_rows(source: str, messages: Iterable[Any], frame: str) -> list[tuple[Any, ...]]:
    """Stamps and poses of one child frame among all transforms."""
    rows: list[tuple[Any, ...]] = []
    frames: set[str] = set()
    for message in messages:
        for transform in message.transforms:
            child = transform.child_frame_id.strip("/")
            frames.add(child)
            if child == frame:
                stamp = transform.header.stamp
                pose = _row(transform.transform)
                rows.append((stamp.sec * 10**9 + stamp.nanosec, *pose))
    if not rows:
        topic = source.partition(":")[0]
        choices = "  or  ".join(f"{topic}:{child}" for child in sorted(frames))
        what = f"no frame {frame}" if frame else "holds the transforms of frames"
        raise TrajectoryError(f"{source}: {what}, choose one: {choices or 'there is none'}")
    return rows


def _cleaned(
    source: str,
    stamps: NDArray[np.int64],
    positions: FloatArray,
    quaternions: FloatArray | None,
) -> GroundTruth:
    """Sorted, without what is not finite and without repetitions."""
    good = np.isfinite(positions).all(axis=1) & (stamps >= 0)
    if quaternions is not None:
        good &= np.isfinite(quaternions).all(axis=1)
        good &= np.abs(quaternions).max(axis=1) > _NO_ORIENTATION
    if not good.any():
        raise TrajectoryError(f"{source}: holds no valid pose")
    kept, first = np.unique(stamps[good], return_index=True)
    if quaternions is not None:
        try:
            quaternions = continuous(unit(quaternions[good][first]))
        except TrajectoryError as error:
            raise TrajectoryError(f"{source}: {error}") from None
    return GroundTruth(
        stamps=kept,
        positions=positions[good][first],
        quaternions=quaternions,
        dropped=int(np.count_nonzero(~good)),
        repeated=int(np.count_nonzero(good)) - len(kept),
    )
