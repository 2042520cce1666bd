# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A RealSense camera of librealsense's own making, a software device, fed with measurements."""

import ctypes
import time
from collections.abc import Callable, Iterable
from contextlib import suppress

import numpy as np
import pytest

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.measurements import Frame, ImuSample, Measurement

# Where the system has no libusb, that of a wheel serves: what is loaded already is not looked for.
with suppress(ImportError):
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)


class SoftwareRealSense:
    """`device` has the left infrared camera and the IMU of a calibration."""

    def __init__(self, calibration: Calibration, imu: bool = True) -> None:
        self.device = rs.software_device()
        self.camera = self.device.add_sensor("Stereo Module")
        self.camera.add_option(rs.option.emitter_enabled, _switch(), True)
        self._infrared = self.camera.add_video_stream(_video(calibration))
        self._motion = self.device.add_sensor("Motion Module")
        self._domain = rs.timestamp_domain.hardware_clock
        self._streams = []
        if imu:
            for uid, kind in ((2, rs.stream.gyro), (3, rs.stream.accel)):
                stream = self._motion.add_motion_stream(_inertial(kind, uid))
                self._infrared.register_extrinsics_to(stream, _extrinsics(calibration))
                self._streams.append(stream)

    def play(
        self,
        measurements: Iterable[Measurement],
        shift: int,
        pace: Callable[[int], None] = lambda _: None,
    ) -> None:
        """Deliver them, their stamps later by `shift`, ns; `pace` waits for a stamp."""
        for number, item in enumerate(measurements):
            pace(item.stamp)
            # 32-bit microseconds, as the device counts them; in ms.
            stamp = (round((item.stamp + shift) / 1e3) % 2**32) / 1e3
            if isinstance(item, Frame):
                self._send_image(item.image, stamp, number)
            elif isinstance(item, ImuSample):
                for stream, vector in zip(
                    self._streams, (item.gyroscope, item.accelerometer), strict=True
                ):
                    self._send_motion(stream, vector, stamp, number)

    def use_computer_clock(self) -> None:
        """As where the operating system does not pass the device's stamps on."""
        self._domain = rs.timestamp_domain.system_time

    def _send_image(self, image: np.ndarray, stamp: float, number: int) -> None:
        frame = rs.software_video_frame()
        frame.pixels, frame.stride, frame.bpp = np.ascontiguousarray(image), image.shape[1], 1
        # Transferred 5 ms after the middle of the exposure.
        frame.timestamp, frame.domain, frame.frame_number = stamp + 5.0, self._domain, number
        frame.profile = self._infrared.as_video_stream_profile()
        middle = rs.frame_metadata_value.sensor_timestamp
        self.camera.set_metadata(middle, round(stamp * 1e3))
        self.camera.on_video_frame(frame)

    def _send_motion(self, stream, vector: np.ndarray, stamp: float, number: int) -> None:
        frame, data = rs.software_motion_frame(), rs.vector()
        data.x, data.y, data.z = map(float, vector)
        frame.data, frame.timestamp, frame.domain = data, stamp, self._domain
        frame.frame_number, frame.profile = number, stream.as_motion_stream_profile()
        self._motion.on_motion_frame(frame)


def at_pace() -> Callable[[int], None]:
    """Waits so that measurements come at the pace of their stamps."""
    begin: list[float] = []

    def wait(stamp: int) -> None:
        now = time.monotonic()
        begin.append(now - stamp * 1e-9)
        time.sleep(max(0.0, begin[0] + stamp * 1e-9 - now))

    return wait


def _switch():
    found = rs.option_range()
    found.min, found.max, found.step, found.default = 0.0, 1.0, 1.0, 1.0
    return found


def _video(calibration: Calibration):
    camera = calibration.camera
    found, inner = rs.video_stream(), rs.intrinsics()
    inner.width, inner.height = camera.width, camera.height
    inner.fx, inner.fy = camera.fx, camera.fy
    inner.ppx, inner.ppy, inner.coeffs = camera.cx, camera.cy, [0.0] * 5
    inner.model = rs.distortion.brown_conrady
    found.type, found.index, found.uid, found.fmt = rs.stream.infrared, 1, 1, rs.format.y8
    found.width, found.height, found.fps, found.bpp = camera.width, camera.height, 30, 1
    found.intrinsics = inner
    return found


def _inertial(kind, uid: int):
    found = rs.motion_stream()
    found.type, found.index, found.uid, found.fps = kind, 0, uid, 200
    found.fmt = rs.format.motion_xyz32f
    return found


def _extrinsics(calibration: Calibration):
    found, pose = rs.extrinsics(), calibration.body_T_cam
    found.rotation = list(pose.rotation().matrix().ravel(order="F"))
    found.translation = list(pose.translation())
    return found
