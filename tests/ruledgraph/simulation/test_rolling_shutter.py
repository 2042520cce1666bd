# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images whose rows are exposed one after the other, against the projection at each row's time."""

from dataclasses import replace

import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation import D435I, PERFECT, ImageQuality, Simulation, simulate
from ruledgraph.simulation.options import simulation_from_options
from ruledgraph.simulation.rolling_shutter import row_weights

READOUT = 0.02
PINHOLE = CameraModel(320, 240, 192.0, 192.0, 159.6, 119.4)
BENT = CameraModel(320, 240, 192.0, 192.0, 159.6, 119.4, "radtan", (-0.12, 0.03, 0.001, -0.001))


def rolling(camera: CameraModel, quality: ImageQuality, readout: float = READOUT) -> Simulation:
    """Dark slats before a wall, by a camera that turns about its axis at up to 1.9 rad/s."""
    calibration = replace(D435I, camera=camera).with_readout(readout)
    return simulate(
        "square",
        "circular-tilted-rot-z",
        calibration=calibration,
        rate=30.0,
        quality=quality,
        moving_start=True,
        duration=3.0,
        seed=3,
    )


def true_edge(simulation: Simulation, time: float, ends: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows and columns where points of a line are seen, each point at the time of its row."""
    calibration, camera = simulation.calibration, simulation.calibration.camera
    points = ends[0] + np.linspace(0.1, 0.9, 400)[:, None] * (ends[1] - ends[0])
    rows = np.full(len(points), camera.height / 2.0)
    pixels = np.zeros((len(points), 2))
    for _ in range(6):
        times = time + rows * calibration.line_delay
        R, p = simulation.motion.rotation(times), simulation.motion.position(times)
        in_body = np.einsum("nji,nj->ni", R, points - p)
        in_cam = np.array([calibration.body_T_cam.transformTo(x) for x in in_body])
        pixels = camera.project(in_cam)
        rows = pixels[:, 1]
    return pixels[:, 1], pixels[:, 0]


def edge_offsets(simulation: Simulation, numbers: range) -> np.ndarray:
    """Distance of upright slats' edges from where they should be, px, a row at a time: the centroid
    of the differences along the row.
    """
    times, found = simulation.frame_times(), []
    names = [f"{slat}.{side}" for slat in ("left", "right") for side in ("left", "right")]
    for number, frame in zip(numbers, simulation.frames(numbers), strict=True):
        for name in names:
            ends = simulation.lines[simulation.line_names.index(name)]
            y, x = true_edge(simulation, times[number], ends)
            order = np.argsort(y)
            if np.ptp(y) < 2.0 * np.ptp(x):
                continue
            slant = np.hypot(1.0, np.ptp(x) / np.ptp(y))
            sign = -1.0 if name.endswith("left") else 1.0
            for row in range(int(y.min()) + 3, int(y.max()) - 3):
                column = float(np.interp(row, y[order], x[order]))
                first = int(column) - 4
                if 2 <= row < 238 and first >= 0 and first + 10 < 320:
                    step = np.diff(frame.image[row, first : first + 10].astype(float))
                    step = np.maximum(sign * step, 0.0)
                    at = np.arange(first, first + 9) + 0.5
                    found.append((step @ at / step.sum() - column) / slant)
    return np.array(found)


@pytest.mark.parametrize("camera", [PINHOLE, BENT], ids=["pinhole", "radtan"])
def test_every_row_shows_the_scene_at_its_own_time(camera: CameraModel) -> None:
    simulation = rolling(camera, PERFECT)
    offsets = edge_offsets(simulation, range(0, 60, 12))
    assert len(offsets) > 500
    # Of a global shutter's images the same figures are 0.006 and 0.086 px: grey levels are whole
    # numbers, walls are textured. By the time of a row half an image away it would be pixels.
    assert abs(offsets.mean()) < 0.01
    assert np.quantile(np.abs(offsets), 0.95) < 0.1
    ignored = replace(simulation, calibration=simulation.calibration.with_readout(0.0))
    images = zip(simulation.frames([24]), ignored.frames([24]), strict=True)
    assert all(np.abs(a.image.astype(int) - b.image).max() > 30 for a, b in images)


def test_rows_are_blurred_over_their_own_exposure() -> None:
    """With 8 ms of exposure the blurred edges are centred at the middle of each row's exposure."""
    quality = replace(PERFECT, exposure=0.008)
    offsets = edge_offsets(rolling(PINHOLE, quality), range(0, 60, 12))
    assert abs(offsets.mean()) < 0.02
    assert np.quantile(np.abs(offsets), 0.95) < 0.1


def test_weights_are_means_over_the_exposure() -> None:
    """Against a brute-force mean of the linear interpolation."""
    rows, moments, exposure = np.linspace(0.0, 0.02, 7), np.linspace(-0.002, 0.022, 13), 0.004
    weights = row_weights(rows, moments, exposure)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    brightness = np.random.default_rng(0).uniform(0.0, 255.0, len(moments))
    fine = np.linspace(-0.5, 0.5, 20001)[:-1] + 0.5 / 20000
    expected = [np.interp(t + fine * exposure, moments, brightness).mean() for t in rows]
    np.testing.assert_allclose(weights @ brightness, expected, atol=1e-3)
    sharp = row_weights(rows, moments, 0.0) @ brightness
    np.testing.assert_allclose(sharp, np.interp(rows, moments, brightness), atol=1e-9)


def test_readout_survives_another_resolution_and_fits_between_frames() -> None:
    made = simulation_from_options("square", "free", resolution="320x240", readout=0.01)
    assert made.calibration.readout == pytest.approx(0.01, rel=1e-12)
    assert made.calibration.line_delay == pytest.approx(0.01 / 239, rel=1e-12)
    with pytest.raises(RuledgraphError, match=r"readout of 0.02 s does not fit between"):
        simulation_from_options("square", "free", readout=0.02)
