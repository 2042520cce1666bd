# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A RealSense D4xx camera with an IMU, by librealsense: infrared images without the projector's
dots, the maker's calibration, and stamps of the device's own clock.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple, TypeAlias

import gtsam
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel, DistortionModel
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.live.split_imu import Clock, SplitImu

Vector: TypeAlias = NDArray[np.float64]
OnImage: TypeAlias = Callable[[NDArray[np.uint8], int], object]
"""Called with a grey image, which is valid during the call, and its stamp, ns."""
OnImu: TypeAlias = Callable[[Vector, Vector, int], object]
"""Called with angular velocity (3,), rad/s, specific force (3,), m/s^2, and their stamp, ns."""

# Gyroscope and accelerometer turned against each other by more than this have other axes.
_SAME_AXES = 1e-3


def librealsense() -> Any:
    """The module pyrealsense2, which has no types.

    Raises:
        RuledgraphError: when it is not installed, or does not find libusb.
    """
    try:
        return import_module("pyrealsense2")
    except ImportError as error:
        raise RuledgraphError(
            "RealSense cameras need pyrealsense2 (pip install pyrealsense2) and libusb "
            f"(Debian, Ubuntu: apt install libusb-1.0-0): {error}"
        ) from None


def connected_device() -> Any:
    """The RealSense camera that is connected.

    Raises:
        RuledgraphError: when there is none, or more than one.
    """
    rs = librealsense()
    devices = list(rs.context().query_devices())
    if len(devices) != 1:
        found = f"{len(devices)} RealSense cameras are" if devices else "no RealSense camera is"
        raise RuledgraphError(f"{found} connected; connect one")
    return devices[0]


class _Streams(NamedTuple):
    """Profiles: what is streamed, and by which sensor."""

    camera: Any
    infrared: Any
    motion: Any
    gyroscope: Any
    accelerometer: Any


class RealSense(Closing):
    """Left infrared camera and IMU of one device.

    The body frame is the IMU's: x points right, y down, z forward. Images are stamped with the
    middle of their exposure. `start` streams, in threads of librealsense, until `close`.

    Args:
        device: of librealsense.
        width: of the images, px.
        height: of the images, px.
        rate: of the images, Hz; the IMU streams as fast as it can.

    Raises:
        RuledgraphError: when the device has no such streams, or figures that make no sense.
    """

    def __init__(self, device: Any, width: int = 640, height: int = 480, rate: int = 90) -> None:
        self._rs = librealsense()
        self._streams = _streams(self._rs, device, width, height, rate)
        self._clock = Clock()
        self._error: Exception | None = None
        self._started: list[Any] = []

    def calibration(self, noise: ImuNoise) -> Calibration:
        """The maker's, and noise figures, which the device does not have."""
        camera = _camera_model(self._rs, self._streams.infrared)
        imu = self._streams.accelerometer
        turned = _pose(self._streams.gyroscope.get_extrinsics_to(imu)).rotation().matrix()
        if np.abs(turned - np.eye(3)).max() > _SAME_AXES:
            raise RuledgraphError("the gyroscope's axes are not the accelerometer's")
        body_T_cam = _pose(self._streams.infrared.get_extrinsics_to(imu))
        return Calibration(camera, body_T_cam, noise, line_delay=0.0)

    def start(self, on_image: OnImage, on_imu: OnImu) -> None:
        """Stream; both are called from threads of librealsense.

        What they raise is raised by `check`, and ends the streams' calls.
        """
        streams, domain = self._streams, self._rs.timestamp_domain.hardware_clock
        imu = SplitImu(on_imu)

        def take_image(frame: Any) -> None:
            stamp = self._clock.unwrapped(_stamp(self._rs, frame))
            on_image(np.asanyarray(frame.get_data()), stamp)

        def take_motion(frame: Any) -> None:
            data = frame.as_motion_frame().get_motion_data()
            vector = np.array([data.x, data.y, data.z])
            stamp = self._clock.unwrapped(_stamp(self._rs, frame))
            if frame.get_profile().stream_type() == self._rs.stream.gyro:
                imu.add_gyroscope(vector, stamp)
            else:
                imu.add_accelerometer(vector, stamp)

        def guarded(take: Callable[[Any], None]) -> Callable[[Any], None]:
            def call(frame: Any) -> None:
                if self._error is not None:
                    return
                try:
                    if frame.get_frame_timestamp_domain() != domain:
                        raise RuledgraphError(
                            "the stamps are the computer's, not of the camera's clock; for these "
                            "librealsense needs its kernel patches or its RSUSB backend"
                        )
                    take(frame)
                except Exception as error:  # noqa: BLE001 - librealsense would swallow it
                    self._error = error

            return call

        for sensor, profiles, take in (
            (streams.motion, [streams.gyroscope, streams.accelerometer], take_motion),
            (streams.camera, [streams.infrared], take_image),
        ):
            for option, value in (("emitter_enabled", 0.0), ("global_time_enabled", 0.0)):
                if sensor.supports(getattr(self._rs.option, option)):
                    sensor.set_option(getattr(self._rs.option, option), value)
            sensor.open(profiles)
            sensor.start(guarded(take))
            self._started.append(sensor)

    def check(self) -> None:
        """Raise what went wrong in the streams."""
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Stop streaming."""
        while self._started:
            sensor = self._started.pop()
            sensor.stop()
            sensor.close()


def _streams(rs: Any, device: Any, width: int, height: int, rate: int) -> _Streams:
    wanted: dict[Any, tuple[Any, Any]] = {}
    sizes = set()
    for sensor in device.query_sensors():
        for profile in sensor.get_stream_profiles():
            kind = profile.stream_type()
            if kind == rs.stream.infrared and profile.format() == rs.format.y8:
                video = profile.as_video_stream_profile()
                size = (video.width(), video.height(), profile.fps())
                if profile.stream_index() == 1:  # the left one
                    sizes.add(size)
                    if size == (width, height, rate):
                        wanted[kind] = sensor, video
            elif kind in (rs.stream.gyro, rs.stream.accel):
                best = wanted.get(kind)
                if best is None or profile.fps() > best[1].fps():
                    wanted[kind] = sensor, profile.as_motion_stream_profile()
    if rs.stream.gyro not in wanted or rs.stream.accel not in wanted:
        raise RuledgraphError("this RealSense camera has no IMU; a D435i or D455 has one")
    if rs.stream.infrared not in wanted:
        choices = ", ".join(f"{w}x{h} at {fps} Hz" for w, h, fps in sorted(sizes)) or "none"
        raise RuledgraphError(
            f"no infrared images of {width}x{height} at {rate} Hz; the camera has: {choices}"
        )
    (motion, gyroscope), (_, accelerometer) = wanted[rs.stream.gyro], wanted[rs.stream.accel]
    return _Streams(*wanted[rs.stream.infrared], motion, gyroscope, accelerometer)


def _camera_model(rs: Any, profile: Any) -> CameraModel:
    """Of a stream of images; librealsense, too, has pixel (0, 0) at the top left one's centre."""
    found = profile.get_intrinsics()
    pinhole = found.width, found.height, found.fx, found.fy, found.ppx, found.ppy
    if not any(found.coeffs):  # infrared images are rectified in the camera
        return CameraModel(*pinhole)
    models: dict[Any, tuple[DistortionModel, int]] = {
        rs.distortion.brown_conrady: ("radtan", 5),
        rs.distortion.kannala_brandt4: ("equidistant", 4),
    }
    if found.model not in models:
        raise RuledgraphError(f"distortion model {found.model} is not known")
    name, count = models[found.model]
    return CameraModel(*pinhole, name, tuple(found.coeffs[:count]))


def _pose(extrinsics: Any) -> gtsam.Pose3:
    """Maps coordinates as librealsense's extrinsics do; their rotation goes column by column."""
    rotation = np.reshape(np.array(extrinsics.rotation, dtype=np.float64), (3, 3), order="F")
    # Its numbers have single precision: the nearest rotation.
    return gtsam.Pose3(gtsam.Rot3.ClosestTo(rotation), np.array(extrinsics.translation))


def _stamp(rs: Any, frame: Any) -> int:
    """On the device's clock, ns: of images the middle of the exposure, where it is known."""
    middle = rs.frame_metadata_value.sensor_timestamp
    if frame.is_video_frame() and frame.supports_frame_metadata(middle):
        return int(frame.get_frame_metadata(middle)) * 1000
    return round(float(frame.get_timestamp()) * 1e6)
