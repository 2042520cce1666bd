# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry on one recording, or on a part of it, and what its live estimates are worth.

They are compared with ground truth: ATE by evo, SE(3)-aligned without scale, and the scale of a
Sim(3) alignment beside it. The faster of the two is interpolated at the stamps of the other.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from backwards import backward_calibration, backward_truth, played_backwards
from reported_errors import ReportedErrors, TruthSigma, reported_errors, segments_of, trajectory_of
from ruledgraph.calibration import read_calibration
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.estimates import Estimate, nis_per_dof
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import EvaluationError, compare, matched
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.odometry import Odometry
from ruledgraph.recording import open_recording
from variants import VARIANTS


@dataclass(frozen=True)
class Run:
    """What came of it."""

    begin: float
    """s after the recording's first message."""
    delay: float | None
    """From the first frame to the first frame with a live pose, s; None without any."""
    handed_out: float | None
    """From the first frame to the one at which the first live pose came out, s."""
    frames: float
    """Share of the frames that have a live pose."""
    degraded: float
    """Share of these that are degraded."""
    ate: float | None
    """RMSE of live positions, SE(3)-aligned, mm."""
    worst: float | None
    """The same, largest error, mm."""
    scale: float | None
    """By which the live estimate has to be multiplied to fit best."""
    warnings: tuple[str, ...]
    smoothed: float | None = None
    """RMSE of smoothed positions, SE(3)-aligned, mm."""
    similar: float | None = None
    """RMSE of live positions, Sim(3)-aligned, mm."""
    worst_reliable: float | None = None
    """Largest error of those `tracking` or `still`, SE(3)-aligned among themselves, mm."""
    beyond: float | None = None
    """Share of live positions beyond three sigmas, see `reported_errors`."""
    unreported: float | None = None
    """Share, of those `tracking` or `still`, beyond three sigmas and 30 mm."""
    nees: float | None = None
    """Median NEES of live positions, as a share of the one it should have."""
    nis: float | None = None
    """Of all innovations, per degree of freedom."""


@dataclass(frozen=True)
class Recorded:
    """Where the recording is, and how it is run."""

    bag: str
    calibration: str
    truth: str
    settings: tuple[str, ...] = ()
    image_topic: str | None = None
    every: int = 1
    """Of so many frames one is used."""
    shrink: int = 1
    """Images are made so many times smaller, by the mean of their pixels."""
    crop: tuple[int, int, int, int] | None = None
    """Left, top, width and height of the part of the image that is used, px."""
    truth_sigma: TruthSigma = field(default_factory=TruthSigma)
    """How good the ground truth is."""
    variant: str = "as recorded"
    """One of `VARIANTS`."""
    seed: int = 0
    """Of the variant's randomness."""
    backwards: bool = False
    """Whether it is played backwards, see `backwards`."""


@dataclass(frozen=True)
class _Errors:
    ate: float
    worst: float
    similar: float
    scale: float


def run_from(recorded: Recorded, duration: float | None, begin: float) -> Run:
    """Run the odometry over `duration` seconds from `begin` on; None: until the end."""
    topic = recorded.image_topic
    camera_topic = topic.removesuffix("/compressed") if topic else None
    calibration = read_calibration(Path(recorded.calibration), image_topic=camera_topic)
    calibration = replace(calibration, camera=changed_camera(calibration.camera, recorded))
    variant, rng = VARIANTS[recorded.variant], np.random.default_rng(recorded.seed)
    if recorded.backwards:
        calibration = backward_calibration(calibration)
    calibration = variant.calibration(calibration)
    odometry = Odometry(calibration, load_config(None, recorded.settings))
    recording = open_recording(recorded.bag, image_topic=topic, start=begin, duration=duration)
    live: list[Estimate] = []
    smoothed: list[Estimate] = []
    first, latest, count, handed_out = 0, 0, 0, None
    truth = read_ground_truth(recorded.truth)
    stream = _reduced(recording.stream(), recorded)
    if recorded.backwards:
        stream, total = played_backwards(stream)
        truth = backward_truth(truth, total)
    for measurement in variant.changed(stream, rng):
        if isinstance(measurement, Frame):
            latest, count = measurement.stamp, count + 1
            first = first or latest
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
        odometry.take_lines()
        if live and handed_out is None:
            handed_out = (latest - first) * 1e-9
    odometry.finish()
    live += odometry.take_live()
    smoothed += odometry.take_smoothed()
    of_live, of_smoothed = _errors(live, truth), _errors(smoothed, truth)
    of_reliable = _errors([e for e in live if e.status in ("tracking", "still")], truth)
    of_reports = _reported(live, smoothed, truth, recorded.truth_sigma)
    return Run(
        begin=begin,
        delay=(live[0].stamp - first) * 1e-9 if live else None,
        handed_out=handed_out,
        frames=len(live) / max(count, 1),
        degraded=float(np.mean([e.status == "degraded" for e in live])) if live else 0.0,
        ate=of_live.ate if of_live else None,
        worst=of_live.worst if of_live else None,
        scale=of_live.scale if of_live else None,
        warnings=tuple(str(warning) for warning in odometry.warnings),
        smoothed=of_smoothed.ate if of_smoothed else None,
        similar=of_live.similar if of_live else None,
        worst_reliable=of_reliable.worst if of_reliable else None,
        beyond=of_reports.beyond if of_reports else None,
        unreported=of_reports.unreported if of_reports else None,
        nees=of_reports.nees if of_reports else None,
        nis=nis_per_dof(e.innovation for e in live if e.innovation),
    )


def changed_camera(camera: CameraModel, recorded: Recorded) -> CameraModel:
    """The model of images that were cropped and made smaller."""
    if recorded.crop is not None:
        left, top, width, height = recorded.crop
        camera = replace(
            camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top
        )
    if recorded.shrink == 1:
        return camera
    # Pixel 0 is the mean of pixels 0 to n - 1: its centre lies at their mean.
    n = recorded.shrink
    size = replace(camera, width=camera.width // n, height=camera.height // n)
    middle = 0.5 * (n - 1)
    cx, cy = (camera.cx - middle) / n, (camera.cy - middle) / n
    return replace(size, fx=camera.fx / n, fy=camera.fy / n, cx=cx, cy=cy)


def _reduced(measurements: Iterable[Measurement], recorded: Recorded) -> Iterable[Measurement]:
    """With the frames, and the parts of their images, that are used."""
    seen = 0
    for measurement in measurements:
        if not isinstance(measurement, Frame):
            yield measurement
            continue
        if seen % recorded.every == 0:
            yield changed(measurement, recorded)
        seen += 1


def changed(frame: Frame, recorded: Recorded) -> Frame:
    """Its image cropped and made smaller."""
    image = frame.image
    if recorded.crop is not None:
        left, top, width, height = recorded.crop
        image = image[top : top + height, left : left + width]
    if (n := recorded.shrink) > 1:
        height, width = (size // n for size in image.shape)
        area = image[: height * n, : width * n]
        image = np.asarray(cv2.resize(area, (width, height), interpolation=cv2.INTER_AREA))
    return Frame(frame.stamp, np.ascontiguousarray(image, dtype=np.uint8))


def _errors(estimates: Sequence[Estimate], truth: GroundTruth) -> _Errors | None:
    if not estimates:
        return None
    estimate = trajectory_of(estimates)
    try:
        estimate, truth = at_slower_stamps(estimate, truth)
        rigid = compare(estimate, truth, lengths=())
        similar = compare(estimate, truth, align="sim3", lengths=())
    except EvaluationError:
        return None
    errors = rigid.errors["ate_translation"]
    scale = float(np.cbrt(np.linalg.det(similar.reference_T_estimate[:3, :3])))
    of_shape = similar.errors["ate_translation"].rmse
    return _Errors(1e3 * errors.rmse, 1e3 * errors.max, 1e3 * of_shape, scale)


def _reported(
    live: Sequence[Estimate], smoothed: Sequence[Estimate], truth: GroundTruth, sigma: TruthSigma
) -> ReportedErrors | None:
    try:
        return reported_errors(segments_of(live, smoothed), truth, sigma)
    except EvaluationError:
        return None


def at_slower_stamps(estimate: Trajectory, truth: GroundTruth) -> tuple[Trajectory, GroundTruth]:
    """Both where they overlap, the faster one interpolated at the stamps of the other.

    Raises:
        EvaluationError: when they hardly overlap.
    """
    if len(estimate) < 2 or _step(truth.stamps) <= _step(estimate.stamps):
        return matched(estimate, truth)
    known, at_truth = matched(
        truth.trajectory, GroundTruth(estimate.stamps, estimate.positions, estimate.quaternions)
    )
    return at_truth.trajectory, GroundTruth(known.stamps, known.positions, known.quaternions)


def _step(stamps: NDArray[np.int64]) -> float:
    return float(np.median(np.diff(stamps)))


def cell(value: float | None, digits: int) -> str:
    """A figure of a table, or a dash."""
    return "-" if value is None else f"{value:.{digits}f}"
