# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations whose focal length is off, in the whole odometry."""

import dataclasses
import re

import pytest

from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.measurements import Frame
from ruledgraph.core.settings import load_config
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import simulate
from small_runs import ate
from small_simulation import SMALL, small_simulation, small_stream

DURATION = 6.0


def run(factor: float, *settings: str, moving: bool) -> tuple[Odometry, float]:
    """The odometry at the end of a recording begun in motion, or at rest, whose calibration has so
    many times the camera's focal length, and its live ATE, m.
    """
    stream, calibration = small_stream(moving=moving, duration=DURATION)
    camera = calibration.camera.with_focal_ratio(factor)
    odometry = Odometry(
        dataclasses.replace(calibration, camera=camera), load_config(None, settings)
    )
    for measurement in stream:
        odometry.add(measurement)
    simulation = small_simulation(moving=moving, duration=DURATION)
    return odometry, ate(odometry.take_live(), simulation)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_focal_length_that_is_off_by_three_percent_is_found_and_reported(factor, moving):
    # As soon and as well as six seconds show it, the first of them at rest.
    settled = ("intrinsics.settled_states=5",)
    odometry, error = run(factor, *settled, moving=moving)
    found = odometry.online_calibration.focal_ratio
    assert found.value * factor == pytest.approx(1.0, abs=3.0 * found.sigma)
    assert found.sigma < 0.005
    word = "longer" if factor < 1.0 else "shorter"
    assert re.search(rf"focal length is [0-9.]+ ± .* {word} than", str(odometry.warnings))
    _, held = run(factor, "intrinsics.estimate=false", moving=moving)
    assert error < 0.01
    assert held > 1.5 * error


def test_a_new_segment_goes_on_with_what_was_found(monkeypatch):
    stream, calibration = small_stream(moving=True, duration=DURATION)
    first = next(m.stamp for m in stream if isinstance(m, Frame))
    # Frames are missing for longer than the window.
    cut = [m for m in stream if not (isinstance(m, Frame) and 2e9 < m.stamp - first < 4.7e9)]
    known, begin = [], Window.__init__

    def spy(self, *arguments):
        known.append(arguments[-1])
        begin(self, *arguments)

    monkeypatch.setattr(Window, "__init__", spy)
    camera = calibration.camera.with_focal_ratio(0.97)
    short = load_config(None, ["window.lag=2.5"])
    odometry = Odometry(dataclasses.replace(calibration, camera=camera), short)
    for measurement in cut:
        odometry.add(measurement)
    assert known[0] == (1.0, 0.01)
    assert len(known) > 1
    assert known[-1].value == pytest.approx(1.0 / 0.97, abs=0.015)
    assert known[-1].sigma < 0.006


def test_half_of_it_is_found_behind_a_lens_that_distorts():
    """Points undistorted with a focal length that is 3 % short are bent, which hides a part."""
    lens = dataclasses.replace(
        SMALL.camera, distortion="radtan", coefficients=(-0.28, 0.07, 0.0, 0.0)
    )
    true, scene = dataclasses.replace(SMALL, camera=lens), ("noncoplanar_cluttered", "free")
    made = simulate(
        *scene, calibration=true, rate=30.0, duration=DURATION, moving_start=True, seed=2
    )
    given = dataclasses.replace(true, camera=lens.with_focal_ratio(0.97))
    settled = ("intrinsics.settled_states=5",)
    odometry = Odometry(given, load_config(None, settled))
    for measurement in made.stream():
        odometry.add(measurement)
    assert ate(odometry.take_live(), made) < 0.01
    assert abs(odometry.online_calibration.ratio * 0.97 - 1.0) < 0.016
    # From when it was settled on points were undistorted by it.
    assert odometry.tracker.camera == odometry.online_calibration.camera != given.camera
    assert odometry.tracker.starter.camera == odometry.online_calibration.camera
