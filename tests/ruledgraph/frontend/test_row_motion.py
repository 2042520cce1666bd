# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Points of a rolling shutter moved to the middle row's time, against the exact projection.

The camera turns at a constant rate and accelerates evenly. Each point of a line is projected at the
time of its row; moved, it has to lie on the image of the line at the middle row's time.
"""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.line_observations import Sighting
from ruledgraph.frontend.edge_batch import Edges, Rulings
from ruledgraph.frontend.rolling_edges import (
    RowMoves,
    correct_last_sighting,
    estimated_moves,
    keep_unsettled,
    measured_moves,
    straight_edges,
)
from ruledgraph.frontend.row_motion import MovingRulings, RowMotion
from ruledgraph.frontend.track import Track

READOUT, FOCAL = 0.03, 385.0
PINHOLE = CameraModel(640, 480, FOCAL, FOCAL, 320.0, 240.0)
BENT = CameraModel(640, 480, FOCAL, FOCAL, 320.0, 240.0, "radtan", (-0.28, 0.07, 0.0002, 2e-05))
DELAY = READOUT / 479
# rad/s, m/s and m/s^2: a camera that is shaken by hand.
RATE = np.array([1.0, -1.5, 3.0])
VELOCITY, ACCELERATION = np.array([0.8, -0.5, 0.3]), np.array([4.0, 5.0, -3.0])
WORLD_T_MIDDLE = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.2, -0.4, 1.1), np.array([0.3, -0.2, 0.5]))


def pose(t: float) -> gtsam.Pose3:
    """middle_T_cam at a time from the middle row's."""
    return gtsam.Pose3(gtsam.Rot3.Expmap(RATE * t), VELOCITY * t + 0.5 * ACCELERATION * t * t)


def rows_of(camera: CameraModel) -> RowMotion:
    times = np.linspace(-READOUT / 2, READOUT / 2, 9)
    poses = [pose(t) for t in times]
    turns = np.array([gtsam.Rot3.Logmap(p.rotation()) for p in poses])
    return RowMotion(camera, DELAY, times, turns, np.array([p.translation() for p in poses]))


def random_segments(rng: np.random.Generator, count: int) -> np.ndarray:
    """End points in the middle camera's axes, in view, (N, 2, 3)."""
    rays = np.concatenate(
        [rng.uniform([-0.6, -0.5], [0.6, 0.5], (count, 2, 2)), np.ones((count, 2, 1))], axis=2
    )
    return rays * rng.uniform(1.0, 4.0, (count, 2, 1))


def seen(points: np.ndarray, camera: CameraModel) -> np.ndarray:
    """Normalised images (N, 2) of points (N, 3), each at the time of its own row."""
    times = np.zeros(len(points))
    normalised = points[:, :2]
    for _ in range(12):
        each = zip(times, points, strict=True)
        in_cam = np.array([pose(t).transformTo(p) for t, p in each])
        normalised = in_cam[:, :2] / in_cam[:, 2:]
        times = camera.distort(normalised).pixels[:, 1] * DELAY - READOUT / 2
    return normalised


def plucker_in_world(segment: np.ndarray) -> np.ndarray:
    a, b = (WORLD_T_MIDDLE.transformFrom(p) for p in segment)
    direction = (b - a) / np.linalg.norm(b - a)
    return np.concatenate([np.cross(a, direction), direction])


def in_view(points: np.ndarray, camera: CameraModel) -> np.ndarray:
    pixels = camera.distort(points).pixels
    return np.all((pixels >= 0) & (pixels <= [639, 479]), axis=1)


def test_rows_have_their_times() -> None:
    """Kalibr's: the first row half the readout before the middle one, row r r delays after it."""
    rows = rows_of(BENT)
    pixels = np.array([[10.0, 0.0], [600.0, 239.5], [320.0, 479.0], [320.0, 100.0]])
    times = rows.row_times(BENT.undistort(pixels))
    expected = np.array([-READOUT / 2, 0.0, READOUT / 2, 100.0 * DELAY - READOUT / 2])
    np.testing.assert_allclose(times, expected, atol=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 1.04])
@pytest.mark.parametrize("camera", [PINHOLE, BENT], ids=["pinhole", "radtan"])
def test_points_are_moved_onto_the_line_of_the_middle_row(
    camera: CameraModel, ratio: float
) -> None:
    """Also where points are normalised with a focal length that is off by a ratio."""
    rng, off, raw = np.random.default_rng(1), [], []
    given = camera.with_focal_ratio(1.0 / ratio).bent_by(ratio)
    rows = replace(rows_of(camera), camera=given, focal_ratio=ratio)
    for segment in random_segments(rng, 60):
        ends = ratio * segment[:, :2] / segment[:, 2:]
        moves = estimated_moves(ends[None], plucker_in_world(segment)[None], WORLD_T_MIDDLE, rows)
        on_line = segment[0] + np.linspace(0.0, 1.0, 25)[:, None] * (segment[1] - segment[0])
        image = seen(on_line, camera)
        image = ratio * image[in_view(image, camera)]
        if len(image) < 10:
            continue
        moving = MovingRulings(rows, ends[None], moves)
        straight = moving.straightened(image, np.zeros(len(image), dtype=np.int64))
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        normal = np.array([-along[1], along[0]])
        off += list((straight.points - ends[0]) @ normal * FOCAL)
        raw += list((image - ends[0]) @ normal * FOCAL)
    # What is left is of third order in time; as the image shows them points are off by pixels.
    assert len(off) > 800
    assert np.abs(off).max() < 0.05
    assert np.sqrt(np.mean(np.square(raw))) > 3.0


@pytest.mark.parametrize("camera", [PINHOLE, BENT], ids=["pinhole", "radtan"])
def test_rulings_are_bent_to_where_the_image_shows_them(camera: CameraModel) -> None:
    """A parabola through ends and middle: rolling by 3 rad/s bows a long line by pixels."""
    rng, off, bows = np.random.default_rng(2), [], []
    rows = rows_of(camera)
    for segment in random_segments(rng, 40):
        ends = segment[:, :2] / segment[:, 2:]
        moves = estimated_moves(ends[None], plucker_in_world(segment)[None], WORLD_T_MIDDLE, rows)
        bent, bow = MovingRulings(rows, ends[None], moves).bent()
        s = np.linspace(0.0, 1.0, 41)[:, None]
        curve = bent[0, 0] + s * (bent[0, 1] - bent[0, 0]) + 4.0 * s * (1.0 - s) * bow[0]
        image = seen(segment[0] + s * (segment[1] - segment[0]), camera)
        for point in image[in_view(image, camera)][::4]:
            # Distance from the polyline of the curve.
            a, d = curve[:-1], np.diff(curve, axis=0)
            t = np.clip(np.sum((point - a) * d, axis=1) / np.sum(d * d, axis=1), 0.0, 1.0)
            nearest = np.linalg.norm(a + t[:, None] * d - point, axis=1).min()
            off.append(FOCAL * nearest)
        bows.append(FOCAL * np.linalg.norm(bow[0]))
    # Within the search's 0.7 px for inliers.
    assert np.quantile(off, 0.95) < 0.5
    assert np.max(bows) > 3.0


def track_at(ends: np.ndarray) -> Track:
    return Track(id=1, first_time=0.0, ends=ends, slope=20.0)


def edges_of(points: np.ndarray, a: float, b: float) -> Edges:
    one = np.ones(1)
    return Edges(
        counts=np.array([len(points)]),
        points=points,
        ends=np.zeros((1, 2, 2)),
        statistics=np.zeros((1, 3, 3)),
        lines=np.array([[a, b]]),
        support=one,
        rms_px=0.0 * one,
        slopes=20.0 * one,
        ambiguous=np.zeros(1, dtype=bool),
    )


def test_a_track_measures_its_own_motion_and_settles_the_sighting_before() -> None:
    """An upright line that the camera passes evenly: no estimate is needed to place its points."""
    velocity = np.array([1.0, 0.0, 0.0])
    times = np.linspace(-READOUT / 2, READOUT / 2, 9)
    rows = RowMotion(PINHOLE, DELAY, times, np.zeros((9, 3)), None)
    segment = np.array([[0.2, -0.8, 2.0], [0.2, 0.8, 2.0]])
    frames, interval = [], 1.0 / 30.0
    track = track_at(segment[:, :2] / segment[:, 2:])
    for k in range(3):
        there = segment - velocity * k * interval
        ends = there[:, :2] / there[:, 2:]
        points = there[0] + np.linspace(0.05, 0.95, 30)[:, None] * (there[1] - there[0])
        times = (FOCAL * points[:, 1] / 2.0 + 240.0) * DELAY - READOUT / 2
        image = points[:, :2] / 2.0 - np.outer(times, velocity[:2]) / 2.0
        frames.append((ends, image))
    x_true = [ends[0, 0] for ends, _ in frames]
    for k, (ends, image) in enumerate(frames):
        # The search measures from the ruling as it was predicted: here at rest.
        predicted = track.ends
        normal = np.array([-1.0, 0.0])  # of a ruling from top to bottom
        a = FOCAL * (ends[0] - predicted[0]) @ normal
        time = k * interval
        known = RowMoves(rows, track.moves[None], np.zeros(1, dtype=bool))
        edges = edges_of(image, a, 0.0)
        if track.sightings:
            known = measured_moves([track], edges, known, time, FOCAL)
            correct_last_sighting(track, known.moves[0], 20.0)
        moving = known.along(Rulings(predicted[None], np.ones((1, 2)), np.ones(1)))
        edges, points = straight_edges(edges, moving, 0.5)
        keep_unsettled([track], points, moving)
        track.sightings.append(Sighting(k, edges.points, edges.statistics[0]))
        track.ends, track.last_seen = ends, time
    each = zip(track.sightings, x_true, strict=True)
    off = [FOCAL * np.abs(s.points[:, 0] - x).max() for s, x in each]
    # 1 m/s at 2 m is 192 px/s: 1.7 px at the line's ends, of which the first sighting knew nothing
    # until the second one came.
    assert max(off) < 1e-6
    assert FOCAL * np.abs(frames[0][1][:, 0] - x_true[0]).max() > 1.5
