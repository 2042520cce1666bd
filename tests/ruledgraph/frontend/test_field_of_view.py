# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The field of view, and lines at its rim."""

import dataclasses

import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.frontend.field_of_view import field_of_view, within_reach
from ruledgraph.simulation import D435I, simulate
from small_runs import ate, run

TAN_80 = 5.67


def fisheye(width: int, degrees: float) -> CameraModel:
    """Equidistant, of so many degrees from its left to its right rim."""
    focal, middle = (width - 1) / np.radians(degrees), 0.5 * (width - 1)
    return CameraModel(width, width, focal, focal, middle, middle, "equidistant", (0.0,) * 4)


def test_that_of_a_pinhole_ends_at_its_corners():
    low, high = field_of_view(CameraModel(320, 240, 200.0, 160.0, 159.0, 119.0))
    np.testing.assert_allclose(low, [-159 / 200, -119 / 160])
    np.testing.assert_allclose(high, [160 / 200, 120 / 160])


@pytest.mark.parametrize(
    ("degrees", "end"), [(120.0, TAN_80), (100.0, None), (178.0, TAN_80), (190.0, TAN_80)]
)
def test_that_of_a_fisheye_ends_at_80_degrees(degrees, end):
    low, high = field_of_view(fisheye(256, degrees))
    # A corner is further out than the rim by the root of two.
    corner = np.radians(degrees / 2.0) * np.sqrt(2.0)
    end = np.tan(corner) / np.sqrt(2.0) if end is None else end
    np.testing.assert_allclose(high, [end, end], rtol=1e-6)
    np.testing.assert_allclose(low, [-end, -end], rtol=1e-6)


def test_what_is_not_in_front_of_the_camera_is_out_of_reach():
    points = np.array([[0.0, 5.0], [0.0, 6.0], [np.nan, 0.0]])
    assert within_reach(points).tolist() == [True, False, False]


@pytest.mark.parametrize("readout", [0.0, 0.02], ids=["global", "rolling"])
def test_the_trajectory_of_a_fisheye_that_sees_more_than_half_a_sphere(readout):
    calibration = dataclasses.replace(D435I, camera=fisheye(384, 190.0)).with_readout(readout)
    simulation = simulate(
        "noncoplanar_cluttered", "free", calibration=calibration, rate=30.0, duration=3.5
    )
    _, live, _ = run(simulation.stream(), calibration)
    assert len(live) > 80
    # Its pixels are twice as large as those of the small pinhole camera, which has up to 20 mm.
    assert ate(live, simulation) < 0.04
