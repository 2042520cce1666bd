# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Where tracks appear in the next frame: by the rotation and their own motion, or by the estimate.

For all tracks of a frame at once, in arrays whose first axis is the track.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, TracksConfig
from ruledgraph.core.line_geometry import THROUGH_CENTRE, closest_to_rays
from ruledgraph.core.line_observations import PluckerEstimate
from ruledgraph.frontend import kernel
from ruledgraph.frontend.edge_batch import Rulings
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.track import Track
from ruledgraph_factors.so3 import hat

# A shorter direction is that of a line at infinity.
_AT_INFINITY = 1e-6
# s; frames are further apart.
_MIN_ELAPSED = 1e-3


class CameraMotion(NamedTuple):
    """From the last frame to this one."""

    cam_R_before: FloatArray
    """(3, 3)."""
    elapsed: float
    """s."""
    world_T_before: gtsam.Pose3
    world_T_cam: gtsam.Pose3
    focal_ratio: float = 1.0
    """The camera's focal length over the one that tracks were normalised with."""


def predict(
    tracks: Sequence[Track],
    lines: Mapping[int, PluckerEstimate],
    motion: CameraMotion,
    focal: float,
    config: TracksConfig = DEFAULTS.tracks,
) -> Rulings:
    """Rulings of all tracks: by their line, if there is one in `lines`, else by the rotation.

    Tracks of the former get the rates that their line's prediction means. `lines` go by the track's
    id; `focal` is the focal length, px.
    """
    ratio = motion.focal_ratio
    rulings = by_rotation(tracks, motion.cam_R_before, motion.elapsed, focal, ratio)
    at = [i for i, track in enumerate(tracks) if track.id in lines]
    own = [tracks[i] for i in at]
    known = [lines[track.id] for track in own]
    turned = by_rotation(own, motion.cam_R_before, 0.0, focal, ratio)
    estimated = by_estimate(own, known, motion, turned, focal, config)
    moved = np.einsum("nei,ni->ne", estimated.ends - turned.ends, normal_of(turned.ends)) * focal
    rates = (moved / max(motion.elapsed, _MIN_ELAPSED)).tolist()
    for track, (first, second) in zip(own, rates, strict=True):
        track.rates = first, second
    rulings.ends[at], rulings.sigmas[at] = estimated.ends, estimated.sigmas
    return rulings


def by_rotation(
    tracks: Sequence[Track],
    cam_R_before: FloatArray,
    elapsed: float,
    focal: float,
    focal_ratio: float = 1.0,
) -> Rulings:
    """Rulings in a frame whose camera turned by `cam_R_before` in `elapsed` s since the last one.

    `focal` is the focal length, px, that tracks were normalised with.
    """
    ends = np.array([track.ends for track in tracks]).reshape(-1, 2, 2) / focal_ratio
    moved = np.array([track.rates for track in tracks]).reshape(-1, 2) * elapsed
    turn = kernel.native.rotate_all if kernel.is_native() else rotate_in_numpy
    ends = turn(ends, cam_R_before, moved / (focal * focal_ratio)).reshape(-1, 2, 2) * focal_ratio
    sigmas = np.array([(track.sigma, track.sigma) for track in tracks]).reshape(-1, 2)
    return Rulings(ends, sigmas, np.array([track.slope for track in tracks]))


def rotate_in_numpy(ends: FloatArray, cam_R_before: FloatArray, moved: FloatArray) -> FloatArray:
    """Segments (N, 2, 2) after a turn of the camera, moved on across themselves by (N, 2).

    The reference of `_native_frame.rotate_all`.
    """
    rays = _rays(ends) @ cam_R_before.T
    ends = rays[..., :2] / rays[..., 2:]
    return np.asarray(ends + moved[..., None] * normal_of(ends)[:, None])


def by_estimate(
    tracks: Sequence[Track],
    lines: Sequence[PluckerEstimate],
    motion: CameraMotion,
    otherwise: Rulings,
    focal: float,
    config: TracksConfig = DEFAULTS.tracks,
) -> Rulings:
    """Where lines appear: m_c = R^T (m - p x v), with the spread their covariance gives.

    Args:
        tracks: where they were seen in the last frame.
        lines: what is known of each of them.
        motion: of the camera since then.
        otherwise: the prediction for each without its depth: for ends that the line does not fix,
            and for a line through the camera's centre.
        focal: focal length, px, that tracks were normalised with.
        config: of tracks.
    """
    if not lines:
        return otherwise
    ratio = motion.focal_ratio
    arrays = _LineArrays(
        plucker=np.array([line.plucker for line in lines]),
        by_delta=np.array([line.plucker_by_delta for line in lines]),
        covariances=np.array([line.covariance for line in lines]),
        seen=np.array([track.ends for track in tracks]) / ratio,
        floors=np.array([_floor(track) for track in tracks]),
    )
    poses = motion.world_T_before.matrix(), motion.world_T_cam.matrix()
    predict_ends = kernel.native.predict_all if kernel.is_native() else predict_in_numpy
    limits = config.max_predicted_sigma_px, config.nearest
    without_depth = otherwise.ends / ratio, otherwise.sigmas
    ends, sigmas = predict_ends(*arrays, *poses, *without_depth, focal * ratio, *limits)
    return Rulings(ends.reshape(-1, 2, 2) * ratio, sigmas, otherwise.slopes)


def _floor(track: Track) -> float:
    """What the motion's uncertainty leaves, px; more with every frame that missed the line."""
    return track.config.motion_sigma_px * track.config.sigma_growth**track.misses


class _LineArrays(NamedTuple):
    """Estimates and tracks of N lines."""

    plucker: FloatArray
    """World coordinates, (N, 6)."""
    by_delta: FloatArray
    """Their derivative, (N, 6, 4)."""
    covariances: FloatArray
    """Of delta, (N, 4, 4)."""
    seen: FloatArray
    """Ends in the last frame, (N, 2, 2)."""
    floors: FloatArray
    """Least deviation, (N,), px."""


def predict_in_numpy(
    plucker: FloatArray,
    by_delta: FloatArray,
    covariances: FloatArray,
    seen: FloatArray,
    floors: FloatArray,
    world_T_before: FloatArray,
    world_T_cam: FloatArray,
    ends: FloatArray,
    sigmas: FloatArray,
    focal: float,
    max_sigma: float,
    nearest: float,
) -> tuple[FloatArray, FloatArray]:
    """The reference of `_native_frame.predict_all`."""
    moment, direction = plucker[:, :3], plucker[:, 3:]
    R, p = world_T_cam[:3, :3], world_T_cam[:3, 3]
    hat_p = hat(p)
    m = (moment - direction @ hat_p.T) @ R
    size = np.hypot(m[:, 0], m[:, 1])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        in_cam = (_ends_in_space(seen, moment, direction, world_T_before) - p) @ R
        ahead = in_cam[..., 2:] > nearest
        found = np.where(ahead, in_cam[..., :2] / in_cam[..., 2:], ends)
        # Onto the ruling.
        off = np.einsum("nei,ni->ne", _rays(found), m)
        found = found - off[..., None] * (m[:, :2] / size**2)[:, None]
        by_m = R.T @ (by_delta[:, :3] - hat_p @ by_delta[:, 3:])
        gradient = _rays(found) @ by_m / size[..., None]
        variance = np.einsum("nei,nij,nej->ne", gradient, covariances, gradient)
        spread = np.hypot(focal * np.sqrt(np.maximum(variance, 0.0)), floors[:, None])
    apart = size >= THROUGH_CENTRE
    found = np.where(apart[..., None], found, ends)
    return found, np.where(apart, np.minimum(spread, max_sigma), sigmas)


def _ends_in_space(
    seen: FloatArray, moment: FloatArray, direction: FloatArray, world_T_before: FloatArray
) -> FloatArray:
    """The points of the lines closest to the rays through their tracks' ends, (N, 2, 3), in the
    world; NaN where they are parallel or the line is at infinity.
    """
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    unit = direction / np.where(length > _AT_INFINITY, length, np.nan)
    foot = (hat(unit) @ (moment / length)[..., None])[..., 0]
    rays = _rays(seen) @ world_T_before[:3, :3].T
    along = closest_to_rays(foot, unit, world_T_before[:3, 3], rays)
    return np.asarray(foot[:, None] + along[..., None] * unit[:, None])


def _rays(points: FloatArray) -> FloatArray:
    """(..., 2) normalised as (..., 3), the last 1."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
