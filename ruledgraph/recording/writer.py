# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Writes measurements as a recording others can read."""

import heapq
import sqlite3
import tempfile
from collections.abc import Iterable
from pathlib import Path

from rosbags.rosbag1.writer import WriterError as Rosbag1Error
from rosbags.rosbag2 import WriterError as Rosbag2Error

from ruledgraph.calibration.rig import Calibration, Mounting
from ruledgraph.core.errors import machine_error
from ruledgraph.core.measurements import Gap, Measurement
from ruledgraph.recording.container import Kind
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.writers import AslSink, BagSink, GroundTruthPose

_KINDS: dict[str, Kind] = {".bag": "rosbag1", ".mcap": "mcap"}
# rosbags hands the path to sqlite3 as a URI, as it is.
_UNSAFE = frozenset("?#%")


def write_recording(
    measurements: Iterable[Measurement],
    out: Path,
    kind: Kind,
    *,
    calibration: Calibration | Mounting | None = None,
    image_topic: str = "/cam0/image_raw",
    imu_topic: str = "/imu0",
    ground_truth: Iterable[GroundTruthPose] | None = None,
) -> None:
    """Write measurements, one pass, as they come.

    Args:
        measurements: in time order; gaps are not written, the missing samples say it all.
        out: the file (`rosbag1`, `mcap`) or folder (`rosbag2`, an sqlite3 bag, and `asl`) to make.
        kind: the format.
        calibration: written as CameraInfo beside the image topic and as `/tf_static`, in `asl` as
            sensor.yaml.
        image_topic: mono8 `sensor_msgs/Image`; `asl` writes PNG files of `cam0` instead. Frames
            that kept their JPEG are written as that, in bags on `IMAGE_TOPIC/compressed`.
        imu_topic: `sensor_msgs/Imu`; `asl` writes `imu0`.
        ground_truth: in time order; `geometry_msgs/PoseStamped` on `/ground_truth`, in `asl`
            `state_groundtruth_estimate0/data.csv`.

    Raises:
        RecordingError: when `out` exists, or cannot be written.
    """
    if out.exists() or out.is_symlink():
        raise RecordingError(f"{out} exists already; remove it or choose another name")
    if kind == "rosbag2" and not _UNSAFE.isdisjoint(str(out.absolute())):
        raise RecordingError(
            f"{out}: sqlite3 bags cannot be written to paths with any of ?, # and %"
        )
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        # Written beside and moved at the end: what bears the name is always whole.
        with tempfile.TemporaryDirectory(prefix=".ruledgraph-", dir=out.parent) as folder:
            part = Path(folder, out.name)
            sink: AslSink | BagSink
            if kind == "asl":
                sink = AslSink(part, calibration)
            else:
                sink = BagSink(part, kind, calibration, image_topic, imu_topic)
            with sink:
                for item in heapq.merge(measurements, ground_truth or (), key=_stamp):
                    if not isinstance(item, Gap):
                        sink.write(item)
            sink.path.rename(out)
    except (OSError, sqlite3.Error, Rosbag1Error, Rosbag2Error) as error:
        fault = RecordingError(f"{out} cannot be written: {error}")
        raise (machine_error(error, out) or fault) from None


def kind_of(out: Path, kind: Kind | None) -> Kind:
    """The format to write, from the option or the file's suffix.

    Raises:
        RecordingError: when neither tells.
    """
    found = _KINDS.get(out.suffix) if kind is None else kind
    if found is None:
        raise RecordingError(
            f"{out}: .bag is a ROS 1 bag and .mcap an MCAP file; "
            "for a folder say --format rosbag2 or --format asl"
        )
    return found


def _stamp(item: Measurement | GroundTruthPose) -> int:
    return item.stop if isinstance(item, Gap) else item.stamp
