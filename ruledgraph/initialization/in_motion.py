# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A start in motion: several hypotheses, the best of them, and whether it is accepted."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from statistics import NormalDist
from typing import NamedTuple

import gtsam
import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from ruledgraph.backend.edge_noise import edge_variance
from ruledgraph.backend.start import Start
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config, StartConfig
from ruledgraph.core.line_observations import LineTrack
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.rest import imu_rests
from ruledgraph.initialization.batch import ROUGH, Batch
from ruledgraph.initialization.first_window import FirstWindow, Seen
from ruledgraph.initialization.initial_values import (
    InitialValues,
    at_distance,
    from_closed_form,
)
from ruledgraph.initialization.prior import Refusal, pose_covariance
from ruledgraph.synchronization.frame_history import FrameTime
from ruledgraph_factors import FactorError
from ruledgraph_factors.closed_form import Planes, closed_form, gyroscope_bias

# The most frames used; a line counts that was seen in so many of them, and in no fewer.
_MAX_FRAMES, _SEEN_SHARE, _MIN_SIGHTINGS = 20, 0.3, 4
# Distances that hypotheses begin at beside the closed form, m.
_DISTANCES = (0.7, 2.0, 6.0)
# Robust constants round by round (px): at first, after lines were triangulated anew, and on the way
# from there to the smoother's own.
_WIDE, _NARROW, _BETWEEN = (6.0, 2.0), (2.0, 2.0), 1.0
# Lines that fit, or there is nothing that the window could hold on to: motion along one line is
# not seen.
_MIN_LINES = 2
# Tilt, velocity and biases.
_STATE_DOF = 11


def start_in_motion(
    imu: ImuBuffer,
    frames: Sequence[FrameTime],
    tracks: Sequence[LineTrack],
    calibration: Calibration,
    config: Config,
    time_offset: TimeOffset | None = None,
    focal_ratio: float = 1.0,
) -> Start | Refusal:
    """The state at the first of some frames from line tracks and IMU.

    Hypotheses are solved in batches with a loss that narrows, and the best is taken: if its lines
    fit, its velocity is known, and no other hypothesis fits as well.

    Args:
        imu: samples that cover the frames.
        frames: at least two.
        tracks: lines that were seen in them.
        calibration: of camera and IMU.
        config: all settings.
        time_offset: how much later than their times the frames may have been taken; None: it is
            known.
        focal_ratio: of the camera's focal length to the one that tracks were normalised with.
    """
    used = frames[:: max(1, -(-len(frames) // _MAX_FRAMES))]
    index_of_stamp = {frame.stamp: n for n, frame in enumerate(used)}
    least = max(_MIN_SIGHTINGS, _SEEN_SHARE * len(index_of_stamp))
    seen = []
    for track in tracks:
        hits = [s for s in track.sightings if s.stamp in index_of_stamp]
        if len(hits) >= least:
            sightings = [s.with_focal_ratio(focal_ratio) for s in hits]
            seen.append(Seen(track, [index_of_stamp[s.stamp] for s in hits], sightings))
    if len(seen) < _MIN_LINES:
        return Refusal(f"{len(seen)} lines were followed long enough, {_MIN_LINES} are needed")
    samples, times = imu.between(frames[0].time, frames[-1].time), [f.time for f in used]
    readings = np.hstack([samples.gyroscope, samples.accelerometer])
    if imu_rests(samples.times, readings, config.rest):
        # To the IMU a constant velocity is a rest; errors of the tracks alone would set the scale.
        return Refusal("the IMU shows no acceleration: the scale of the motion is unknown")
    window = FirstWindow(samples, times, seen, calibration, config, time_offset)
    try:
        best = solved(window)
    except FactorError as error:
        return Refusal(f"the first window cannot be integrated: {error}")
    if best:
        window = replace(window, edge_variance=_edge_variance(best[0], window))
        best = _sorted(_solved_again(batch, window) for batch in best)
    if not best:
        return Refusal("no start converged")
    return _accepted(best, window, frames[0].stamp)


def solved(window: FirstWindow) -> list[Batch]:
    """What the hypotheses lead to, best first.

    All are followed to the end: which one is best shows when the loss is narrow.
    """
    return _sorted(_followed(window, begin) for begin in _hypotheses(window))


def _sorted(batches: Iterable[Batch | None]) -> list[Batch]:
    """Those that there are, best first."""
    return sorted(filter(None, batches), key=lambda batch: batch.error)


def _hypotheses(window: FirstWindow) -> Iterator[Callable[[], InitialValues]]:
    """From the gyroscope's bias with which lines keep their directions best, and from none: before
    lines at similar distances a translation passes for such a bias, and no distance leads back.
    """
    planes, sigma = window.planes(), window.config.start.gyroscope_bias
    shown = gyroscope_bias(window.samples, window.times, planes, sigma)
    for bias in (shown, np.zeros(3)):
        yield partial(_linear, window, planes, bias)
        for distance in _DISTANCES:
            yield partial(at_distance, window, bias, distance)


def _linear(window: FirstWindow, planes: Sequence[Planes], bias: FloatArray) -> InitialValues:
    motion = window.motion(gtsam.imuBias.ConstantBias(np.zeros(3), bias))
    lever_arm = window.calibration.body_T_cam.translation()
    found = closed_form(motion, planes, lever_arm, window.config.imu.gravity)
    return from_closed_form(window, bias, found)


def _followed(window: FirstWindow, begin: Callable[[], InitialValues]) -> Batch | None:
    """None where it ends in an indeterminate system or with a line through its camera."""
    first, *others = _WIDE
    last = window.config.lines.cauchy_scale_px
    try:
        batch = Batch(window, begin(), first, ROUGH)
        for cauchy in others:
            batch.solve(cauchy, ROUGH)
        for cauchy in _NARROW:
            batch.triangulate_anew()
            batch.solve(cauchy)
        for cauchy in (_BETWEEN, last or _BETWEEN):
            batch.solve(cauchy)
    except (FactorError, np.linalg.LinAlgError):
        return None
    return batch


def _edge_variance(batch: Batch, window: FirstWindow) -> float:
    """By the sightings that do not contradict the start, see `edge_variance`."""
    misfits = np.concatenate(batch.misfits(window.nominal_sigma))
    fitting = misfits[misfits < float(chdtri(2, 1.0 - window.config.start.confidence))]
    dof = 2.0 * len(fitting) - 4.0 * len(window.seen) - _STATE_DOF
    return edge_variance(float(np.sum(fitting)), dof, window.config.edges)


def _solved_again(batch: Batch, window: FirstWindow) -> Batch | None:
    """With the noise of this window's edges; None where that ends in an indeterminate system."""
    try:
        return batch.solved_again(window, window.config.lines.cauchy_scale_px or _BETWEEN)
    except (FactorError, np.linalg.LinAlgError):
        return None


def _accepted(best: Sequence[Batch], window: FirstWindow, stamp: int) -> Start | Refusal:
    """The best hypothesis, if it is accepted."""
    batch, start = best[0], window.config.start
    limit = float(chdtri(2, 1.0 - start.confidence))
    fits = [misfit < limit for misfit in batch.misfits(window.nominal_sigma)]
    outliers = 1.0 - float(np.mean(np.concatenate(fits)))
    if outliers > start.outlier_share:
        return Refusal(
            f"only {100 * (1 - outliers):.0f} % of the line sightings fit a common motion"
        )
    try:
        velocities = batch.velocities()
    except np.linalg.LinAlgError:
        return Refusal("too little motion across the lines: the velocity is indeterminate")
    for velocity, covariance in velocities:
        if reason := _why_unknown(velocity, covariance, start):
            return Refusal(reason)
    own = _in_body(batch, *velocities[0])
    if any(_is_rival(other, batch, own, start.confidence) for other in best[1:]):
        return Refusal("two different motions explain the lines equally well")
    lines = {}
    for seen, line, fit in zip(window.seen, batch.lines(), fits, strict=True):
        if np.mean(fit) > 0.5 and line.chart.inverse_distance(np.zeros(4))[0] > 0.0:
            lines[seen.track.id] = line
    if len(lines) < _MIN_LINES:
        return Refusal(
            f"only {len(lines)} lines are in front of the camera, {_MIN_LINES} are needed"
        )
    offset = window.time_offset
    if offset is not None:
        # As wide as before: the window sees the same points again.
        offset = offset._replace(value=batch.residual_offset)
    return Start(
        stamp=stamp,
        time=window.times[0],
        state=gtsam.NavState(batch.pose, batch.velocity),
        bias=batch.bias,
        covariance=block_diag(
            pose_covariance(batch.pose.rotation(), start.tilt),
            start.velocity**2 * np.eye(3),
            np.diag(np.square(start.bias_sigmas)),
        ),
        lines=lines,
        time_offset=offset,
        edge_variance=window.edge_variance,
    )


def _why_unknown(velocity: FloatArray, covariance: FloatArray, start: StartConfig) -> str:
    """Why a velocity is not known well enough; nothing if it is.

    An error of the scale is one of the speed by the same share: where the speed may as well be
    none, the scale may be anything, however small both are. Of a body at rest none is expected.
    """
    sigma = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    if not sigma < start.velocity_sigma:
        return f"the velocity is uncertain by {sigma:.2g} m/s: too little motion across the lines"
    speed = float(np.linalg.norm(velocity))
    along = float(np.sqrt(velocity @ covariance @ velocity)) / max(speed, 1e-12)
    sure = NormalDist().inv_cdf(0.5 + 0.5 * start.confidence)
    if along > start.rest_velocity_sigma and speed < sure * along:
        return (
            f"the speed is {speed:.2g} m/s, uncertain by {along:.2g}: too little acceleration to "
            "tell the scale"
        )
    return ""


class _BodyVelocity(NamedTuple):
    """In the body's axes, at a window's start."""

    mean: FloatArray
    """(3,), m/s."""
    covariance: FloatArray
    """(3, 3)."""


def _in_body(batch: Batch, velocity: FloatArray, covariance: FloatArray) -> _BodyVelocity:
    world_R_body = batch.pose.rotation().matrix()
    return _BodyVelocity(world_R_body.T @ velocity, world_R_body.T @ covariance @ world_R_body)


def _is_rival(other: Batch, best: Batch, own: _BodyVelocity, confidence: float) -> bool:
    """Whether another velocity than the best one's (`own`) fits no worse than by chance.

    It is another one where it is beyond the covariance of either: the wider one may hold two
    minima, and no step leads from the wrong one to the other.
    """
    limit = float(chdtri(3, 1.0 - confidence))
    if 2.0 * (other.error - best.error) >= limit:
        return False
    try:
        its = _in_body(other, *other.velocities()[0])
    except np.linalg.LinAlgError:
        return True  # it may be any
    apart = its.mean - own.mean
    return any(
        float(apart @ np.linalg.solve(each.covariance, apart)) > limit for each in (own, its)
    )
