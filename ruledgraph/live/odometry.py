# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry in a thread of its own, for programs that run while the sensors do."""

import logging
import threading
import time as clock
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from numpy.typing import ArrayLike

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import RuledgraphError, machine_error
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.live.sensor_queue import SensorQueue, Signal
from ruledgraph.live.stream_checks import ImageStream, ImuStream
from ruledgraph.odometry import Odometry

_log = logging.getLogger("ruledgraph.live")

# What is dropped is reported this often at most, s.
_BETWEEN_REPORTS = 5.0
_AT_FIRST = "initializing: no attempt to start yet"


class Counts(NamedTuple):
    """What came in and out since the beginning or the last `reset`."""

    imu: int
    images: int
    dropped_images: int
    """Images that were not used because the odometry did not keep up, or had no IMU samples."""
    dropped_imu: int
    """Samples that were not used because no images came."""
    estimates: int


class LiveOdometry(Closing):
    """Visual-inertial odometry for live sensors.

    `add_imu` and `add_image` check what they get, put it in a bounded queue and return; a worker
    thread runs the odometry and calls back. When it cannot keep up, the oldest of the images that
    wait are dropped; that is logged and counted.

    Threads: each sensor may be added by a thread of its own, one at a time; `status`, `counts`,
    `latest` and `reset` may be used from any thread, from callbacks, too; `close` from any thread
    but not from a callback. Callbacks run in the worker thread, one after the other; while one
    runs the odometry waits. What a callback raises ends the odometry, and is raised by the next
    call of `add_imu`, `add_image` or `close`. Warnings go to the logger `ruledgraph`.

    Args:
        calibration: of camera and IMU.
        config: all settings.
        on_pose: called with each live estimate, as known at the time of its frame.
        on_smoothed: called with each estimate that left the window, better, and later by its lag.
        on_line: called with each line that left the window.
        max_images: that wait; more of them survive a longer pause, and make estimates later.
    """

    def __init__(
        self,
        calibration: Calibration,
        config: Config | None = None,
        *,
        on_pose: Callable[[Estimate], object] | None = None,
        on_smoothed: Callable[[Estimate], object] | None = None,
        on_line: Callable[[LineEstimate], object] | None = None,
        max_images: int = 16,
    ) -> None:
        if max_images < 1:
            raise RuledgraphError(f"max_images = {max_images}: at least 1 image has to wait")
        self.latest: Estimate | None = None
        """The last live estimate."""
        self._new_odometry = partial(Odometry, calibration, config)
        self._odometry = self._new_odometry()
        self._callbacks = (on_pose, on_smoothed, on_line)
        self._queue = SensorQueue(round(calibration.time_offset * 1e9), max_images)
        self._imu, self._images = ImuStream(), ImageStream(calibration.camera)
        self._estimates = 0
        self._status = _AT_FIRST
        self._error: BaseException | None = None
        self._last_report = -_BETWEEN_REPORTS
        self._worker = threading.Thread(target=self._work, name="ruledgraph", daemon=True)
        try:
            self._worker.start()
        except RuntimeError as error:
            raise (machine_error(error) or error) from None

    # -- input -----------------------------------------------------------------------------------

    def add_imu(
        self,
        gyroscope: ArrayLike,
        accelerometer: ArrayLike,
        *,
        t: float | None = None,
        t_ns: int | None = None,
    ) -> None:
        """Add a sample: angular velocity (3,), rad/s, and specific force (3,), m/s^2.

        Args:
            gyroscope: in the body frame; a list or an array.
            accelerometer: likewise; at rest it reads 9.81 m/s^2 upwards.
            t: the stamp in seconds; or
            t_ns: in nanoseconds, exact for stamps since 1970.

        Raises:
            MeasurementError: for what cannot be a sample in these units, or not in this order; it
                is left out. So is one with NaN or infinity, with a warning.
            RuledgraphError: for readings in another unit.
        """
        self._check_open()
        sample = ImuSample.of(gyroscope, accelerometer, t=t, t_ns=t_ns)
        self._imu.add(sample)
        if not self._queue.put_imu(sample):
            self._report("no images come: IMU samples that wait for them are dropped")

    def add_image(
        self, image: ArrayLike, *, t: float | None = None, t_ns: int | None = None
    ) -> None:
        """Add a copy of an image of the calibration's size.

        Args:
            image: 8 bit, grey (height, width) or BGR (height, width, 3).
            t: the stamp in seconds, of the middle of its exposure; or
            t_ns: in nanoseconds, exact for stamps since 1970.

        Raises:
            MeasurementError: for another image, or one not in order of time; it is left out.
        """
        self._check_open()
        frame = Frame.of(image, t=t, t_ns=t_ns)
        self._images.add(frame)
        if not self._queue.put_frame(frame):
            silent = self._imu.is_silent
            why = "no IMU samples come" if silent else "the odometry does not keep up"
            self._report(f"{why}: {self.counts.dropped_images} images are dropped so far")

    # -- state -----------------------------------------------------------------------------------

    @property
    def status(self) -> str:
        """What the odometry does.

        `waiting for IMU` (which also may be frozen), `waiting for images` (for a second there were
        none), `initializing:` with the reason why it did not start yet, then the last estimate's
        status, and `closed`.
        """
        if not self._worker.is_alive():
            return "closed"
        if self._imu.is_silent:
            return "waiting for IMU"
        if self._images.is_silent:
            return "waiting for images"
        return self._status

    @property
    def counts(self) -> Counts:
        """What came in and out so far."""
        dropped = self._queue.dropped_frames, self._queue.dropped_imu
        return Counts(self._imu.count, self._images.count, *dropped, self._estimates)

    @property
    def waiting(self) -> int:
        """Images that wait for the odometry; none when it has ended."""
        return len(self._queue) if self._worker.is_alive() else 0

    # -- control ---------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget everything and begin anew with what is added from now on.

        Stamps may begin anew, too. What is being processed may still be handed out.
        """
        self._check_open()
        camera = self._odometry.calibration.camera
        self._imu, self._images = ImuStream(), ImageStream(camera)
        self._queue.reset()

    def close(self) -> None:
        """Process what waits, hand out what is left, end the thread; may be called again.

        Raises:
            Exception: what ended the odometry before.
        """
        if threading.current_thread() is self._worker:
            raise RuledgraphError("close() was called from a callback; call it from another thread")
        self._queue.end()
        self._worker.join()
        if self._error is not None:
            raise self._error

    def _check_open(self) -> None:
        if self._error is not None:
            raise self._error
        if self._queue.ended:
            raise RuledgraphError("the odometry is closed; make another one")

    def _report(self, message: str) -> None:
        now = clock.monotonic()
        if now - self._last_report >= _BETWEEN_REPORTS:
            self._last_report = now
            _log.warning("%s", message)

    # -- the worker ------------------------------------------------------------------------------

    def _work(self) -> None:
        images = False
        try:
            while (item := self._queue.take()) is not Signal.END:
                if isinstance(item, Signal):
                    self._odometry, self.latest = self._new_odometry(), None
                    self._estimates, self._status, images = 0, _AT_FIRST, False
                    continue
                self._odometry.add(item)
                self._hand_out()
                images = images or isinstance(item, Frame)
                if images:
                    self._status = self._odometry.status
            self._odometry.finish()
            self._hand_out()
        except BaseException as error:  # noqa: BLE001 - raised where the next measurement is added
            self._error = machine_error(error) or error
            _log.error("the odometry ended: %s: %s", type(self._error).__name__, self._error)

    def _hand_out(self) -> None:
        on_pose, on_smoothed, on_line = self._callbacks
        for estimate in self._odometry.take_live():
            self.latest, self._estimates = estimate, self._estimates + 1
            if on_pose is not None:
                on_pose(estimate)
        for estimate in self._odometry.take_smoothed():
            if on_smoothed is not None:
                on_smoothed(estimate)
        for line in self._odometry.take_lines():
            if on_line is not None:
                on_line(line)
