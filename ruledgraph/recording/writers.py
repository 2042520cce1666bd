# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a recording is written to: a bag, by rosbags, or a folder in the ASL format."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2

from ruledgraph.calibration.camera_fields import kalibr_words
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.calibration.rig import Calibration, Mounting
from ruledgraph.calibration.wide_angle import WIDE_ANGLE
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.core.trajectory import quaternion_xyzw
from ruledgraph.recording.container import Kind
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.images import image_suffix
from ruledgraph.recording.messages import types
from ruledgraph.recording.report import StampRange
from ruledgraph.recording.topics import (
    CAMERA_INFO,
    STATIC_TRANSFORMS,
    TRANSFORMS,
    camera_info_topic,
)

GROUND_TRUTH_TOPIC = "/ground_truth"
_BODY, _CAM = "imu0", "cam0"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"
_IMAGE, _IMU = "sensor_msgs/msg/Image", "sensor_msgs/msg/Imu"
_POSE = "geometry_msgs/msg/PoseStamped"


class GroundTruthPose(NamedTuple):
    """world_T_body at a stamp, ns: position (3,), m, and quaternion (4,) in x, y, z, w order."""

    stamp: int
    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]


class BagSink:
    """A ROS 1 bag, ROS 2 bag (sqlite3) or MCAP file."""

    def __init__(
        self,
        path: Path,
        kind: Kind,
        calibration: Calibration | Mounting | None,
        image_topic: str,
        imu_topic: str,
    ) -> None:
        self._ros1 = kind == "rosbag1"
        self._store = types(ros1=self._ros1)
        self._writer: Any
        if self._ros1:
            self._writer = rosbag1.Writer(path)
        else:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            # Version 8 is what ROS 2 Humble and later read.
            self._writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
        self.path = path / f"{path.name}.mcap" if kind == "mcap" else path
        """What was written, once the sink is closed."""
        self._connections: dict[str, Any] = {}
        self._has_calibration = False
        self._calibration = calibration
        self._image_topic = image_topic
        self._imu_topic = imu_topic

    def __enter__(self) -> "BagSink":
        self._writer.open()
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)

    def write(self, item: Frame | ImuSample | GroundTruthPose) -> None:
        """Append it."""
        fields: dict[str, Any]
        if isinstance(item, Frame):
            if self._calibration is not None and not self._has_calibration:
                self._has_calibration = True
                self._write_calibration(item.stamp, self._calibration)
            if item.encoded is not None and image_suffix(item.encoded) == "jpg":
                fields = {"format": "jpeg", "data": np.frombuffer(item.encoded, np.uint8)}
                self._write(item.stamp, f"{self._image_topic}/compressed", _COMPRESSED, fields)
                return
            height, width = item.image.shape
            fields = {
                "height": height,
                "width": width,
                "encoding": "mono8",
                "is_bigendian": 0,
                "step": width,
                "data": np.ascontiguousarray(item.image).reshape(-1),
            }
            self._write(item.stamp, self._image_topic, _IMAGE, fields)
        elif isinstance(item, ImuSample):
            unknown = np.zeros(9)
            unknown[0] = -1.0  # no orientation
            fields = {
                "orientation": self._new("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
                "orientation_covariance": unknown,
                "angular_velocity": self._vector(item.gyroscope),
                "angular_velocity_covariance": np.zeros(9),
                "linear_acceleration": self._vector(item.accelerometer),
                "linear_acceleration_covariance": np.zeros(9),
            }
            self._write(item.stamp, self._imu_topic, _IMU, fields, _BODY)
        else:
            pose = self._new(
                "geometry_msgs/msg/Pose",
                self._new("geometry_msgs/msg/Point", *map(float, item.position)),
                self._new("geometry_msgs/msg/Quaternion", *map(float, item.quaternion)),
            )
            self._write(item.stamp, GROUND_TRUTH_TOPIC, _POSE, {"pose": pose}, "world")

    def _write(
        self, stamp: int, topic: str, type_name: str, fields: dict[str, Any], frame_id: str = _CAM
    ) -> None:
        self._send(stamp, topic, type_name, header=self._header(stamp, frame_id), **fields)

    def _write_calibration(self, stamp: int, calibration: Calibration | Mounting) -> None:
        topic = camera_info_topic(self._image_topic)
        self._write(stamp, topic, CAMERA_INFO, self._camera_info(calibration.camera))
        pose = calibration.body_T_cam
        transform = self._new(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(stamp, _BODY),
            child_frame_id=_CAM,
            transform=self._new(
                "geometry_msgs/msg/Transform",
                self._vector(pose.translation()),
                self._new("geometry_msgs/msg/Quaternion", *map(float, quaternion_xyzw(pose))),
            ),
        )
        self._send(stamp, STATIC_TRANSFORMS, TRANSFORMS, transforms=[transform])

    def _header(self, stamp: int, frame_id: str) -> Any:
        time = self._new("builtin_interfaces/msg/Time", *divmod(stamp, 10**9))
        sequence = {"seq": 0} if self._ros1 else {}
        return self._new("std_msgs/msg/Header", stamp=time, frame_id=frame_id, **sequence)

    def _send(self, stamp: int, topic: str, type_name: str, **fields: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, type_name, typestore=self._store
            )
        message = self._new(type_name, **fields)
        serialise = self._store.serialize_ros1 if self._ros1 else self._store.serialize_cdr
        self._writer.write(self._connections[topic], stamp, serialise(message, type_name))

    def _new(self, type_name: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[type_name](*values, **fields)

    def _vector(self, values: NDArray[np.float64]) -> Any:
        return self._new("geometry_msgs/msg/Vector3", *map(float, values))

    def _camera_info(self, camera: CameraModel) -> dict[str, Any]:
        if camera.distortion in WIDE_ANGLE:
            raise RecordingError(
                f"{self.path}: ROS has no CameraInfo for camera model {camera.distortion}; "
                "write an asl folder, or go without the calibration"
            )
        matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
        if camera.distortion == "equidistant":
            model, coefficients = "equidistant", camera.coefficients
        else:
            model, coefficients = "plumb_bob", (*camera.coefficients, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        arrays = {
            "d": np.array(coefficients),
            "k": matrix.reshape(-1),
            "r": np.eye(3).reshape(-1),
            "p": np.column_stack([matrix, np.zeros(3)]).reshape(-1),
        }
        region = self._new("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        return {
            "height": camera.height,
            "width": camera.width,
            "distortion_model": model,
            **{name.upper() if self._ros1 else name: value for name, value in arrays.items()},
            "binning_x": 0,
            "binning_y": 0,
            "roi": region,
        }


_IMU_COLUMNS = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_TRUTH_COLUMNS = (
    "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
)


class AslSink:
    """A folder as of the EuRoC MAV dataset."""

    def __init__(self, path: Path, calibration: Calibration | Mounting | None) -> None:
        self.path = path
        self._calibration = calibration
        self._tables: dict[str, Any] = {}
        self._stamps: dict[str, StampRange] = {"cam0": StampRange(), "imu0": StampRange()}
        self._files = ExitStack()

    def __enter__(self) -> "AslSink":
        (self.path / "mav0" / "cam0" / "data").mkdir(parents=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._files.close()
        if kind is None and self._calibration is not None:
            root, calibration = self.path / "mav0", self._calibration
            camera = _camera_yaml(calibration, self._stamps["cam0"].rate)
            (root / "cam0" / "sensor.yaml").write_text(camera)
            if calibration.imu_noise is not None:
                imu = _imu_yaml(calibration.imu_noise, self._stamps["imu0"].rate)
                (root / "imu0").mkdir(exist_ok=True)
                (root / "imu0" / "sensor.yaml").write_text(imu)

    def write(self, item: Frame | ImuSample | GroundTruthPose) -> None:
        """Append it; numbers are written so that reading gives back the same."""
        if isinstance(item, Frame):
            encoded = item.encoded or cv2.imencode(".png", item.image)[1].tobytes()
            name = f"{item.stamp}.{image_suffix(encoded)}"
            (self.path / "mav0" / "cam0" / "data" / name).write_bytes(encoded)
            self._row("cam0", "#timestamp [ns],filename", item.stamp, name)
            self._stamps["cam0"].add(item.stamp)
        elif isinstance(item, ImuSample):
            self._row("imu0", _IMU_COLUMNS, item.stamp, *item.gyroscope, *item.accelerometer)
            self._stamps["imu0"].add(item.stamp)
        else:
            x, y, z, w = item.quaternion
            row = (*item.position, w, x, y, z)
            self._row("state_groundtruth_estimate0", _TRUTH_COLUMNS, item.stamp, *row)

    def _row(self, sensor: str, columns: str, stamp: int, *values: float | str) -> None:
        if sensor not in self._tables:
            folder = self.path / "mav0" / sensor
            folder.mkdir(exist_ok=True)
            table = (folder / "data.csv").open("w", newline="\n")
            self._tables[sensor] = self._files.enter_context(table)
            table.write(f"{columns}\n")
        texts = [value if isinstance(value, str) else repr(float(value)) for value in values]
        self._tables[sensor].write(f"{stamp},{','.join(texts)}\n")


def _camera_yaml(calibration: Calibration | Mounting, rate: float) -> str:
    camera = calibration.camera
    words = kalibr_words(camera)
    model = "equidistant" if words.distortion_model == "equidistant" else "radial-tangential"
    coefficients = words.distortion or (0.0, 0.0, 0.0, 0.0)
    if words.camera_model in ("eucm", "ds"):
        model, coefficients = "none", ()
    return f"""%YAML:1.0
sensor_type: camera
comment: cam0
T_BS:
  cols: 4
  rows: 4
  data: {_list(calibration.body_T_cam.matrix().reshape(-1))}
rate_hz: {_number(rate)}
resolution: [{camera.width}, {camera.height}]
camera_model: {words.camera_model}
intrinsics: {_list(words.intrinsics)}
distortion_model: {model}
distortion_coefficients: {_list(coefficients)}
"""


def _imu_yaml(noise: ImuNoise, rate: float) -> str:
    return f"""%YAML:1.0
sensor_type: imu
comment: imu0
T_BS:
  cols: 4
  rows: 4
  data: {_list(np.eye(4).reshape(-1))}
rate_hz: {_number(rate)}
gyroscope_noise_density: {_number(noise.gyroscope)}
gyroscope_random_walk: {_number(noise.gyroscope_walk)}
accelerometer_noise_density: {_number(noise.accelerometer)}
accelerometer_random_walk: {_number(noise.accelerometer_walk)}
"""


def _list(values: Any) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _number(value: float) -> str:
    """As YAML 1.1 wants it: 2e-05 would be read as text."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
