# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations whose focal length is off, in the whole odometry."""

import dataclasses
import re

import pytest

from ruledgraph.core.settings import load_config
from ruledgraph.odometry import Odometry
from small_runs import ate
from small_simulation import small_simulation, small_stream

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
    settled = "intrinsics.settled_sigma=0.005", "intrinsics.settled_states=5"
    odometry, error = run(factor, *settled, moving=moving)
    found = odometry.mounting.focal_ratio
    assert found.value * factor == pytest.approx(1.0, abs=3.0 * found.sigma)
    assert found.sigma < 0.005
    word = "longer" if factor < 1.0 else "shorter"
    assert re.search(rf"focal length is [0-9.]+ % .* {word} than", str(odometry.warnings))
    _, held = run(factor, "intrinsics.estimate=false", moving=moving)
    assert error < 0.01
    assert held > 1.5 * error
