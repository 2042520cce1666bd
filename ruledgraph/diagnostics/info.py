# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph info`: what a recording holds, what would be used of it, what is wrong with it.

`checks` and `extrinsics_check` judge it, and the calibration that is to go with it.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ruledgraph.calibration import CalibrationError, camera_from_info
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import D435I_LIKE, ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import DEFAULTS, Config
from ruledgraph.core.measurements import Gap
from ruledgraph.core.new_folder import check_empty
from ruledgraph.diagnostics.checks import (
    Observations,
    examine,
    examine_calibration,
    examine_camera_info,
    examine_length,
)
from ruledgraph.diagnostics.extrinsics_check import check_rotation
from ruledgraph.diagnostics.finding import Finding
from ruledgraph.diagnostics.image_check import examine_image
from ruledgraph.diagnostics.readout_check import examine_readout
from ruledgraph.diagnostics.timing_plot import draw_timing
from ruledgraph.recording.container import Container, Kind, RawMessage, Topic
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.formats import open_container
from ruledgraph.recording.images import Grey, check_image, decode_image
from ruledgraph.recording.messages import UnreadableMessageError, deserialise, stamp_of
from ruledgraph.recording.recording import Recording
from ruledgraph.recording.report import StampRange
from ruledgraph.recording.ros_calibration import recorded_camera
from ruledgraph.recording.topics import (
    CAMERA_INFO,
    STATIC_TRANSFORMS,
    ImuTopics,
    camera_info_topic,
    choose_image_topic,
    choose_imu_topics,
    is_rectified,
)

# Images decoded to see that they can be, and how large they are.
_FIRST_IMAGES = 5


@dataclass
class TopicInfo:
    """A topic and the stamps found on it."""

    name: str
    type: str
    messages: int
    """As the recording's own index says."""
    read: int
    """Messages with a stamp that were read."""
    rate: float
    """Hz."""
    longest_step: float
    """s, between two stamps."""


@dataclass
class SensorInfo:
    """What would be delivered of the camera or the IMU."""

    topics: list[str]
    count: int
    rate: float
    """Hz."""
    longest_step: float
    """s."""
    first_stamp: int
    """ns."""
    last_stamp: int
    """ns."""


@dataclass
class RecordingInfo:
    """The findings."""

    path: str
    kind: str
    topics: list[TopicInfo] = field(default_factory=list)
    camera: SensorInfo | None = None
    imu: SensorInfo | None = None
    image_size: tuple[int, int] | None = None
    """Width and height, px."""
    overlap: float = 0.0
    """s, for which there are both frames and IMU samples."""
    missing: list[str] = field(default_factory=list)
    """What stands in the way of using it."""
    warnings: list[str] = field(default_factory=list)
    unit_warnings: list[str] = field(default_factory=list)
    """Those of `warnings` that say what unit the IMU may have."""
    bytes_lost: int = 0
    findings: list[Finding] = field(default_factory=list)
    """Whether it is good for odometry."""
    plot: str | None = None
    """Where the picture is."""

    def as_dict(self) -> dict[str, Any]:
        """As JSON takes it."""
        return asdict(self)


def inspect_recording(
    path: Path,
    *,
    image_topic: str | None = None,
    imu_topic: str | None = None,
    gyroscope_topic: str | None = None,
    accelerometer_topic: str | None = None,
    start: float | None = None,
    duration: float | None = None,
    calibrate: Callable[[Kind, str | None], Calibration | None] | None = None,
    imu_noise: ImuNoise = D435I_LIKE,
    config: Config = DEFAULTS,
    plots: Path | None = None,
) -> RecordingInfo:
    """Read every stamp and IMU sample of a recording, and its first images.

    The other arguments as of `open_recording`. A recording without camera or IMU is described too,
    with what is missing.

    Args:
        path: the recording.
        image_topic: the camera's.
        imu_topic: the IMU's.
        gyroscope_topic: the gyroscope's.
        accelerometer_topic: the accelerometer's.
        start: s after the beginning.
        duration: s.
        calibrate: reads the calibration that is to go with a kind of recording and an image topic.
        imu_noise: of a recording that brings the rest of its calibration along.
        config: settings of the run that it is or was for.
        plots: a new folder for a picture of the timing.

    Raises:
        RecordingError: when it cannot be opened.
        RuledgraphError: what `calibrate` raises.
    """
    if plots is not None:
        check_empty(plots)
    container = _Observed(open_container(path))
    info = RecordingInfo(str(path), container.kind)
    camera: Topic | None = None
    imu: ImuTopics | None = None
    try:
        camera = choose_image_topic(container.topics, image_topic)
    except RecordingError as error:
        info.missing.append(str(error))
    try:
        imu = choose_imu_topics(container.topics, imu_topic, gyroscope_topic, accelerometer_topic)
    except RecordingError as error:
        info.missing.append(str(error))

    calibration = calibrate(container.kind, camera.name if camera else None) if calibrate else None
    recording = Recording(container, camera, imu, start, duration)
    images, seen = _FirstImages(), Observations()
    try:
        for measurement in recording.stream_with(images):
            if not isinstance(measurement, Gap):
                seen.add(measurement)
    except RecordingError as error:
        info.missing.append(str(error))
    container.finish()

    def rotation(known: Calibration) -> list[Finding]:
        # From where on it turns most.
        stretch = Recording(open_container(path), camera, imu, seen.liveliest(start or 0.0))
        try:
            return list(check_rotation(stretch.stream(), known, config))
        except RecordingError:  # no images there, which is said below
            return []

    report = recording.report
    info.topics = [container.describe(topic) for topic in container.topics]
    if camera is not None:
        info.camera = _sensor([camera], report.frames)
        if images.latest is not None:
            height, width = images.latest.shape
            info.image_size = width, height
    if imu is not None:
        info.imu = _sensor(dict.fromkeys(imu), report.imu)
    if report.frames.count and report.imu.count:
        begin = max(report.frames.first, report.imu.first)
        info.overlap = max(0, min(report.frames.last, report.imu.last) - begin) * 1e-9
    info.warnings = report.warnings
    info.unit_warnings = report.unit_warnings
    info.bytes_lost = report.bytes_lost
    noise = calibration.imu_noise if calibration else None
    info.findings = list(examine(seen, noise, config))
    if images.latest is not None:
        info.findings += examine_image(images.latest, config)
    if calibration is None and container.camera_infos:
        found, own = _own_calibration(Recording(open_container(path), camera, imu), imu_noise)
        info.findings.append(found)
        if own is not None and not info.missing:
            info.findings += rotation(own)
    if calibration is not None:
        info.findings += examine_calibration(calibration, info.image_size)
        info.findings += examine_readout(calibration, seen.times(seen.frame_stamps))
        recorded = container.camera_info(camera) if camera is not None else None
        if recorded is not None:
            info.findings += examine_camera_info(calibration.camera, recorded)
        if not info.missing:
            info.findings += rotation(calibration)
    if camera is not None and not info.missing:
        # Last, which is taken for the likeliest cause.
        info.findings += examine_length(seen, config)
    if plots is not None:
        info.plot = str(draw_timing(seen, plots, config.rest))
    return info


def _own_calibration(recording: Recording, noise: ImuNoise) -> tuple[Finding, Calibration | None]:
    """Whether it can be smoothed without a calibration file, and with what."""
    try:
        camera, body_T_cam = recorded_camera(recording)
    except RecordingError as error:
        text = f"no calibration of its own: {error}; pass --calibration"
        return Finding(False, text), None
    lever = 1e3 * float(np.linalg.norm(body_T_cam.translation()))
    text = (
        f"camera_info and {STATIC_TRANSFORMS} tell of the camera, {lever:.3g} mm from the IMU: "
        "smooth needs only --imu"
    )
    return Finding(True, text), Calibration(camera, body_T_cam, noise)


class _Observed:
    """A container that keeps count of all stamps while some of its messages are read, once."""

    def __init__(self, container: Container) -> None:
        self.kind = container.kind
        self.topics = container.topics
        self.damage = container.damage
        self._by_name = {topic.name: topic for topic in container.topics}
        self._all = container.messages(self._by_name)
        self._stamps = {topic.name: StampRange() for topic in container.topics}
        self.camera_infos: dict[str, RawMessage] = {}

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        for message in self._all:
            self._note(message)
            if message.topic in topics:
                yield message

    def finish(self) -> None:
        """Read on to the end."""
        for message in self._all:
            self._note(message)

    def describe(self, topic: Topic) -> TopicInfo:
        stamps = self._stamps[topic.name]
        step = stamps.longest_step * 1e-9
        return TopicInfo(
            topic.name, topic.type, topic.message_count, stamps.count, stamps.rate, step
        )

    def camera_info(self, camera: Topic) -> CameraModel | None:
        """What the CameraInfo beside an image topic says first; None where there is none of use."""
        name = camera_info_topic(camera.name)
        message = self.camera_infos.get(name)
        if message is None or not isinstance(message.data, bytes):
            return None
        try:
            message_of_camera = deserialise(self._by_name[name], message.data)
            return camera_from_info(message_of_camera, is_rectified(camera.name))
        except (UnreadableMessageError, CalibrationError):
            return None

    def _note(self, message: RawMessage) -> None:
        topic = self._by_name[message.topic]
        if topic.type == CAMERA_INFO:
            self.camera_infos.setdefault(topic.name, message)
        try:
            stamp = stamp_of(topic, message)
        except UnreadableMessageError:
            return
        self._stamps[message.topic].add(stamp)


class _FirstImages:
    """Decodes the first images; of later ones it only sees whether their files are whole, and
    repeats the last image for them.
    """

    def __init__(self) -> None:
        self.latest: Grey | None = None
        self._decoded = 0

    def __call__(self, topic: Topic, message: RawMessage) -> Grey:
        if self.latest is None or self._decoded < _FIRST_IMAGES:
            self.latest = decode_image(topic, message)
            self._decoded += 1
        else:
            check_image(topic, message)
        return self.latest


def _sensor(topics: Collection[Topic], stamps: StampRange) -> SensorInfo:
    return SensorInfo(
        [topic.name for topic in topics],
        stamps.count,
        stamps.rate,
        stamps.longest_step * 1e-9,
        stamps.first,
        stamps.last,
    )
