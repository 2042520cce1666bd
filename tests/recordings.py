# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Small recordings, built message by message."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.recording import write_recording

STORES = {
    "ros1": get_typestore(Stores.ROS1_NOETIC),
    "cdr": get_typestore(Stores.ROS2_HUMBLE),
}
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
IMU = "sensor_msgs/msg/Imu"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
for store in STORES.values():
    definition = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(definition, TRANSFORMS))
SECOND = 10**9
MS = 10**6
T0 = 1_700_000_000 * SECOND

# Format and compression of every kind of bag.
BAGS = [
    "rosbag1",
    "rosbag1-bz2",
    "rosbag1-lz4",
    "sqlite3",
    "sqlite3-file",
    "sqlite3-message",
    "mcap",
    "mcap-file",
    "mcap-message",
    "mcap-storage",
]


class Entry(NamedTuple):
    """A message to record; `fields` in the order of the definition, without the header."""

    topic: str
    type: str
    stamp: int
    fields: dict[str, Any]
    delay: int = 0
    """ns, from the stamp to the reception."""
    frame: str = "a frame"


def new(encoding: str, type_name: str, /, *values: Any, **fields: Any) -> Any:
    return STORES[encoding].types[type_name](*values, **fields)


def header_of(encoding: str, stamp: int, frame: str) -> Any:
    time = new(encoding, "builtin_interfaces/msg/Time", *divmod(stamp, SECOND))
    sequence = {"seq": 0} if encoding == "ros1" else {}
    return new(encoding, "std_msgs/msg/Header", stamp=time, frame_id=frame, **sequence)


def serialise(encoding: str, entry: Entry) -> bytes:
    fields = {"header": header_of(encoding, entry.stamp, entry.frame), **entry.fields}
    if entry.type == IMU:
        fields = {
            "header": fields["header"],
            "orientation": new(encoding, "geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
            "orientation_covariance": np.zeros(9),
            "angular_velocity": new(encoding, "geometry_msgs/msg/Vector3", *fields["w"]),
            "angular_velocity_covariance": np.zeros(9),
            "linear_acceleration": new(encoding, "geometry_msgs/msg/Vector3", *fields["a"]),
            "linear_acceleration_covariance": np.zeros(9),
        }
    elif entry.type == TRANSFORMS:
        fields = {"transforms": [_transform(encoding, entry.stamp, *t) for t in fields["all"]]}
    elif entry.type == CAMERA_INFO and encoding == "ros1":
        fields = {name.upper() if len(name) == 1 else name: v for name, v in fields.items()}
    message = new(encoding, entry.type, **fields)
    store = STORES[encoding]
    if encoding == "ros1":
        return bytes(store.serialize_ros1(message, entry.type))
    return bytes(store.serialize_cdr(message, entry.type, little_endian=sys.byteorder == "little"))


def _transform(
    encoding: str, stamp: int, parent: str, child: str, t: Sequence[float], q: Sequence[float]
) -> Any:
    pose = new(
        encoding,
        "geometry_msgs/msg/Transform",
        new(encoding, "geometry_msgs/msg/Vector3", *map(float, t)),
        new(encoding, "geometry_msgs/msg/Quaternion", *map(float, q)),
    )
    header = header_of(encoding, stamp, parent)
    return new(encoding, "geometry_msgs/msg/TransformStamped", header, child, pose)


def write_bag(path: Path, bag: str, entries: Iterable[Entry]) -> Path:
    """A bag of these messages in the given order; `bag` is one of `BAGS`."""
    form, _, compression = bag.partition("-")
    writer: Any
    if form == "rosbag1":
        encoding = "ros1"
        writer = rosbag1.Writer(path)
        if compression:
            writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
    else:
        encoding = "cdr"
        plugin = rosbag2.StoragePlugin[form.upper()]
        writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
        if compression:
            mode = rosbag2.CompressionMode[compression.upper()]
            writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for entry in entries:
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(
                    entry.topic, entry.type, typestore=STORES[encoding]
                )
            data = serialise(encoding, entry)
            writer.write(connections[entry.topic], entry.stamp + entry.delay, data)
    return path


def image(stamp: int, pixels: NDArray[np.uint8], topic: str = "/cam0/image_raw") -> Entry:
    """A mono8 image."""
    height, width = pixels.shape
    return raw_image(stamp, "mono8", width, height, width, pixels.tobytes(), topic=topic)


def raw_image(
    stamp: int,
    encoding: str,
    width: int,
    height: int,
    step: int,
    data: bytes,
    big_endian: bool = False,
    topic: str = "/cam0/image_raw",
) -> Entry:
    fields = {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": int(big_endian),
        "step": step,
        "data": np.frombuffer(data, np.uint8),
    }
    return Entry(topic, IMAGE, stamp, fields)


def compressed_image(
    stamp: int, data: bytes, form: str = "jpeg", topic: str = "/cam0/compressed"
) -> Entry:
    fields = {"format": form, "data": np.frombuffer(data, np.uint8)}
    return Entry(topic, COMPRESSED, stamp, fields)


def imu(
    stamp: int,
    w: Sequence[float] = (0.01, -0.02, 0.03),
    a: Sequence[float] = (0.1, 0.2, 9.8),
    topic: str = "/imu0",
) -> Entry:
    return Entry(topic, IMU, stamp, {"w": w, "a": a})


def png(pixels: NDArray[Any]) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def texture(index: int, shape: tuple[int, ...] = (12, 16)) -> NDArray[np.uint8]:
    """An image of its own for every index."""
    return np.random.default_rng(index).integers(0, 256, shape, dtype=np.uint8)


def sequence(
    duration: float = 1.0,
    imu_rate: int = 100,
    frame_rate: int = 10,
    shape: tuple[int, int] = (12, 16),
) -> list[Measurement]:
    """Frames and IMU samples in time order, each with numbers of its own."""
    measurements: list[Measurement] = []
    rng = np.random.default_rng(7)
    for i in range(round(duration * imu_rate)):
        w, a = rng.normal(size=3) * 0.1, rng.normal(size=3) * 0.1 + [0.0, 0.0, 9.8]
        measurements.append(ImuSample(T0 + i * SECOND // imu_rate, w, a))
    for i in range(round(duration * frame_rate)):
        stamp = T0 + i * SECOND // frame_rate + MS
        measurements.append(Frame(stamp, texture(i, shape)))
    return sorted(measurements, key=lambda m: fields(m)[0])


def fields(m: Measurement) -> tuple:
    """What a measurement holds, its stamp first."""
    return (m.stamp, m.image) if isinstance(m, Frame) else tuple(m)


def entries_of(measurements: Iterable[Measurement]) -> list[Entry]:
    """The messages that carry these measurements."""
    entries = []
    for m in measurements:
        if isinstance(m, Frame):
            entries.append(image(m.stamp, m.image))
        elif isinstance(m, ImuSample):
            entries.append(imu(m.stamp, list(m.gyroscope), list(m.accelerometer)))
    return entries


def assert_same(got: Sequence[Measurement], expected: Sequence[Measurement]) -> None:
    """Equal bit for bit."""
    assert [(type(m), fields(m)[0]) for m in got] == [(type(m), fields(m)[0]) for m in expected]
    for a, b in zip(got, expected, strict=True):
        for x, y in zip(fields(a)[1:], fields(b)[1:], strict=True):
            np.testing.assert_array_equal(x, y)


def write_asl(path: Path, measurements: Iterable[Measurement]) -> Path:
    write_recording(measurements, path, "asl")
    return path
