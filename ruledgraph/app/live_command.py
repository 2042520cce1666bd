# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph live`: a connected camera's trajectory, printed, and its measurements recorded."""

import logging
import shlex
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ruledgraph.app.calibration_choice import calibration_of_files
from ruledgraph.app.interrupts import CaughtSignals
from ruledgraph.app.refusals import Refusals
from ruledgraph.app.remove_existing import remove_existing
from ruledgraph.calibration import TYPICAL_IMU_NOISE, write_kalibr
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import MeasurementError, RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import seconds
from ruledgraph.live import LiveOdometry
from ruledgraph.live.realsense import RealSense, connected_device
from ruledgraph.live.sensor_queue import SensorQueue, Signal
from ruledgraph.recording import write_recording
from ruledgraph.simulation.options import size_of

# Images that may wait to be written: four seconds at 90 Hz.
_MAX_UNWRITTEN = 360
_BETWEEN_LINES = 1.0


def live_command(
    *,
    calibration_files: Sequence[Path],
    camera: str | None,
    imu: str | None,
    readout: float | None,
    resolution: str,
    rate: int,
    duration: float | None,
    record: Path | None,
    config_file: Path | None,
    settings: Sequence[str],
    force: bool,
    device: Any = None,
) -> None:
    """See `ruledgraph live --help`; `device` is one of librealsense, by default that connected."""
    config = load_config(config_file, settings)
    width, height = size_of(resolution)
    sensors = RealSense(device or connected_device(), width, height, rate)
    if calibration_files:
        calibration = calibration_of_files(calibration_files, None, camera, imu)
        _check_size(calibration, width, height)
    else:
        calibration = sensors.calibration(TYPICAL_IMU_NOISE[imu or "d435i"])
    if readout is not None:
        calibration = calibration.with_readout(readout)
    inputs = [*calibration_files, *([config_file] if config_file else [])]
    images, samples = Refusals("image"), Refusals("IMU sample")
    with ExitStack() as stack:
        # They end from the last to the first: the streams before what they feed.
        recorder = record and stack.enter_context(
            Recorder(record, calibration, inputs, force=force)
        )
        odometry = stack.enter_context(LiveOdometry(calibration, config))
        stack.enter_context(sensors)
        signals = stack.enter_context(CaughtSignals())
        stack.enter_context(_Warnings())

        def on_image(image: NDArray[np.uint8], stamp: int) -> None:
            with images.counted():
                odometry.add_image(image, t_ns=stamp)
                if recorder:
                    recorder.add(Frame.of(image, t_ns=stamp))

        def on_imu(
            gyroscope: NDArray[np.float64], accelerometer: NDArray[np.float64], stamp: int
        ) -> None:
            with samples.counted():
                if not np.isfinite([gyroscope, accelerometer]).all():
                    raise MeasurementError(f"the IMU sample at {seconds(stamp)} s is not finite")
                odometry.add_imu(gyroscope, accelerometer, t_ns=stamp)
                if recorder:
                    recorder.add(ImuSample(stamp, gyroscope, accelerometer))

        sensors.start(on_image, on_imu)
        begin = time.monotonic()
        next_line = _BETWEEN_LINES
        while not signals.number and (elapsed := time.monotonic() - begin) < (duration or np.inf):
            sensors.check()
            if elapsed >= next_line:
                next_line += _BETWEEN_LINES
                click.echo(_line(odometry))
            time.sleep(0.02)
    counts = odometry.counts
    click.echo(
        f"{counts.images} images, {counts.dropped_images} of them dropped, {counts.imu} IMU "
        f"samples, {counts.estimates} estimates"
    )
    if images.count or samples.count:
        click.echo(f"warning: {images} and {samples} could not be used", err=True)
    if record:
        command = ["ruledgraph", "smooth", str(record), "--calibration", str(_beside(record))]
        click.echo(f"{record}\nNext: {shlex.join(command)}")


class _Warnings(logging.Handler, Closing):
    """Prints what the odometry warns of."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        logging.getLogger("ruledgraph").addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """An error is not printed here: it ends the command, and is printed then."""
        if record.levelno == logging.WARNING:
            click.echo(f"warning: {record.getMessage()}", err=True)

    def close(self) -> None:
        """Print no more."""
        logging.getLogger("ruledgraph").removeHandler(self)
        super().close()


def _check_size(calibration: Calibration, width: int, height: int) -> None:
    camera = calibration.camera
    if (camera.width, camera.height) != (width, height):
        raise RuledgraphError(
            f"the images will be {width}x{height}, but the calibration is for {camera.width}x"
            f"{camera.height}; choose it by --resolution {camera.width}x{camera.height}"
        )


def _line(odometry: LiveOdometry) -> str:
    latest, status = odometry.latest, odometry.status
    if latest is None:
        return status
    x, y, z = latest.position
    sigma = latest.position_covariance.diagonal().max() ** 0.5
    dropped = odometry.counts.dropped_images
    note = f", {dropped} images dropped" if dropped else ""
    return f"{latest.time:.2f} s  {x:8.3f} {y:8.3f} {z:8.3f} m ±{sigma:.3f}  {status}{note}"


def _beside(record: Path) -> Path:
    return record.with_suffix(".calib.yaml")


class Recorder(Closing):
    """Writes measurements in order of time, by a thread of its own.

    Args:
        path: of the MCAP file; the calibration is written beside it.
        calibration: of the sensors.
        inputs: files that are never overwritten.
        force: whether to overwrite what is there.

    Raises:
        RuledgraphError: when one is there, or of `add` and `close`, when it cannot be written.
    """

    def __init__(
        self, path: Path, calibration: Calibration, inputs: Sequence[Path], *, force: bool
    ) -> None:
        if path.suffix != ".mcap":
            raise RuledgraphError(f"{path}: --record writes MCAP files, name it .mcap")
        if force:
            remove_existing(path, _beside(path), inputs=inputs)
        for file in (path, _beside(path)):
            if file.exists():
                raise RuledgraphError(f"{file} exists already; choose another name or pass --force")
        write_kalibr(calibration, _beside(path))
        self._path, self._calibration = path, calibration
        self._queue = SensorQueue(round(calibration.time_offset * 1e9), _MAX_UNWRITTEN)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._write, name="recorder")
        self._thread.start()

    def add(self, measurement: Frame | ImuSample) -> None:
        """From any thread, each kind in order of time."""
        if self._error is not None:
            raise self._error
        if isinstance(measurement, ImuSample):
            self._queue.put_imu(measurement)
        elif not self._queue.put_frame(measurement):
            raise RuledgraphError(f"{self._path}: the disk is too slow for these images")

    def close(self) -> None:
        """Write what waits, and end."""
        self._queue.end()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _taken(self) -> Iterator[Frame | ImuSample]:
        while not isinstance(item := self._queue.take(), Signal):
            yield item

    def _write(self) -> None:
        try:
            write_recording(self._taken(), self._path, "mcap", calibration=self._calibration)
        except Exception as error:  # noqa: BLE001 - raised where the next measurement is added
            self._error = error
