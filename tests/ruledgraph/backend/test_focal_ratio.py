# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's focal length: estimated by windows, kept between them, warned of."""

import dataclasses

import numpy as np
import pytest

from failing_smoother import fail_updates
from ideal_tracks import (
    CALIBRATION,
    IdealTracks,
    error_of,
    frame_times,
    ideal_tracks,
    sighting,
    start_of,
)
from ruledgraph.backend.sliding_window import Window
from ruledgraph.calibration.online_calibration import OnlineCalibration, focal_warning
from ruledgraph.core.calibration_estimates import FocalRatio
from ruledgraph.core.config import Config, IntrinsicsConfig
from ruledgraph.core.messages import Messages
from simulated_window import hand_held

DEFAULTS = IntrinsicsConfig()


def tracks_with(ratio: float, seed: int) -> IdealTracks:
    """A hand-held camera's, whose focal length is so many times the calibration's."""
    made = ideal_tracks(seed, hand_held(np.random.default_rng(seed)))
    tracks = [
        track._replace(sightings=[sighting(s.stamp, s.points * ratio) for s in track.sightings])
        for track in made.tracks
    ]
    return dataclasses.replace(made, tracks=tracks)


def run_window(made: IdealTracks, known: FocalRatio | None) -> Window:
    window = Window(CALIBRATION, Config(), start_of(made), 0.0, None, known)
    for first in range(1, len(made.times), 3):
        part = slice(first, first + 3)
        window.extend(
            frame_times(made.stamps[part], made.times[part]), made.imu, made.tracks, False
        )
        window.optimize()
    return window


def worst(window: Window, made: IdealTracks) -> float:
    """Error of a frame of the last interval but one, m."""
    interval = window.intervals[-2]
    poses = zip(interval.stamps, interval.poses(), strict=True)
    return max(error_of(pose, made.motion.pose(stamp * 1e-9)) for stamp, pose in poses)


@pytest.mark.parametrize("ratio", [0.97, 1.01, 1.03])
def test_a_window_finds_the_focal_length(ratio):
    """Within three of its standard deviations and 0.5 %, and the poses are unharmed by it."""
    made = tracks_with(ratio, seed=1)
    window = run_window(made, FocalRatio(1.0, DEFAULTS.focal_sigma))
    found = window.self_calibration.focal_ratio
    assert abs(found.value - ratio) < min(3.0 * found.sigma, 0.005)
    assert window.recoveries == []
    assert worst(window, made) < 0.02


def test_without_it_the_poses_suffer():
    made = tracks_with(1.03, seed=1)
    held, free = run_window(made, None), run_window(made, FocalRatio(1.0, DEFAULTS.focal_sigma))
    assert held.self_calibration.focal_ratio is None
    assert worst(held, made) > 2.0 * worst(free, made)


def test_lines_are_placed_and_end_where_the_true_camera_saw_them():
    """With the ratio known; a line's chart is where it was triangulated."""
    exact = run_window(tracks_with(1.0, seed=3), FocalRatio(1.0, 1e-6))
    other = run_window(tracks_with(1.04, seed=3), FocalRatio(1.04, 1e-6))
    assert len(exact.lines) > 8
    for id_, line in exact.lines.items():
        seen = other.lines[id_]
        same = [own.chart.plucker(np.zeros(4))[0] for own in (line, seen)]
        np.testing.assert_allclose(*same, atol=1e-3)
        ends = [own.estimate(0.1).ends for own in (line, seen)]
        np.testing.assert_allclose(*ends, atol=0.02)


def test_its_deviation_is_what_it_is_said_to_be():
    """Mean NEES of 24 windows: 99 % of such means lie in 0.41 to 1.90 were all Gaussian. Points
    have independent errors here, and count as if eight had one in common (`edges.correlation`).
    """
    nees = []
    for seed in range(24):
        ratio = 1.0 + DEFAULTS.focal_sigma * np.random.default_rng([seed, 8]).normal()
        window = run_window(tracks_with(ratio, seed), FocalRatio(1.0, DEFAULTS.focal_sigma))
        value, sigma = window.self_calibration.focal_ratio
        assert sigma < 0.5 * DEFAULTS.focal_sigma  # else nothing was found
        nees.append(((value - ratio) / sigma) ** 2)
    assert 0.41 / 8.0 < np.mean(nees) < 1.9


def test_a_new_smoother_goes_on_with_it(monkeypatch):
    made = tracks_with(1.02, seed=2)
    fail_updates(monkeypatch, 8)
    window = run_window(made, FocalRatio(1.0, DEFAULTS.focal_sigma))
    assert len(window.recoveries) == 1
    found = window.self_calibration.focal_ratio
    assert abs(found.value - 1.02) < min(3.0 * found.sigma, 0.005)


def test_it_is_kept_and_warned_of_once_it_is_settled():
    """From then on points are undistorted by it."""
    warnings = Messages()
    lens = dataclasses.replace(
        CALIBRATION.camera, distortion="radtan", coefficients=(-0.283, 0.074, 2e-4, 0.0)
    )
    calibration = dataclasses.replace(CALIBRATION, camera=lens)
    online_calibration = OnlineCalibration(calibration, Config(), warnings)
    assert online_calibration.focal_ratio == FocalRatio(1.0, DEFAULTS.focal_sigma)
    online_calibration.update(None, FocalRatio(1.03, 2e-3))
    online_calibration.update(None, None)
    assert online_calibration.focal_ratio == FocalRatio(1.03, 2e-3)
    assert online_calibration.ratio == 1.03
    assert online_calibration.current == calibration
    for _ in range(DEFAULTS.settled_states - 1):
        assert list(warnings) == []
        assert online_calibration.camera is lens
        online_calibration.update(None, FocalRatio(1.03, 2e-3))
    assert online_calibration.camera == lens.bent_by(1.03)
    online_calibration.update(None, FocalRatio(1.034, 2e-3))
    assert online_calibration.camera == lens.bent_by(1.03)
    online_calibration.update(None, FocalRatio(1.037, 2e-3))
    assert online_calibration.camera == lens.bent_by(1.037)
    (warning,) = warnings
    assert warning == (
        "the focal length is 3.0 ± 0.2 % longer than the calibration's: correct intrinsics"
    )
    held = Config(intrinsics=IntrinsicsConfig(estimate=False))
    assert OnlineCalibration(CALIBRATION, held, warnings).focal_ratio is None


@pytest.mark.parametrize("coefficients", [(-0.283, 0.074, 2e-4, -1e-4), (-0.2, 0.1, 0, 0, -0.02)])
@pytest.mark.parametrize("ratio", [0.97, 1.04])
def test_points_undistorted_by_the_focal_length_found_are_those_of_the_true_camera(
    coefficients, ratio
):
    """In units of the calibration's focal length, as the ratio of the factors has it."""
    given = dataclasses.replace(CALIBRATION.camera, distortion="radtan", coefficients=coefficients)
    true = given.with_focal_ratio(ratio)
    pixels = np.random.default_rng(1).uniform([0, 0], [640, 480], size=(200, 2))
    seen = given.bent_by(ratio).undistort(pixels)
    np.testing.assert_allclose(seen, ratio * true.undistort(pixels), atol=1e-8)
    assert np.abs(given.undistort(pixels) - seen).max() > 1e-3
    assert given.bent_by(1.0) == given
    assert CALIBRATION.camera.bent_by(ratio) is CALIBRATION.camera


@pytest.mark.parametrize(
    ("ratio", "sigma", "warned"),
    [(0.97, 1e-3, True), (0.97, 0.012, False), (1.005, 1e-3, False)],
    ids=["far", "not well known", "not far"],
)
def test_when_it_is_worth_a_warning(ratio, sigma, warned):
    assert (focal_warning(FocalRatio(ratio, sigma), DEFAULTS) is not None) == warned


@pytest.mark.parametrize(
    ("distortion", "coefficients", "estimated"),
    [("radtan", (-0.3, 0.1, 0.0, 0.0), True), ("equidistant", (0.0, 0.0, 0.0, 0.0), False)],
)
def test_wide_angle_lenses_keep_the_calibrations(distortion, coefficients, estimated):
    lens = dataclasses.replace(CALIBRATION.camera, distortion=distortion, coefficients=coefficients)
    calibration = dataclasses.replace(CALIBRATION, camera=lens)
    online_calibration = OnlineCalibration(calibration, Config(), Messages())
    assert (online_calibration.focal_ratio is not None) == estimated
    assert online_calibration.ratio == 1.0
