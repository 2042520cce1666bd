# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures over the camera's images show the lines of the very image they are drawn on."""

import numpy as np
import pytest

from ruledgraph.core.figure_style import line_color, rgb, status_color
from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.overlay import draw_overlay, overlay_scale, overlay_size
from ruledgraph.visualization.views import View, ViewedLine, ViewQueue
from small_simulation import SMALL, small_stream

CAMERA = SMALL.camera


def view(*lines: ViewedLine, status: str = "tracking") -> View:
    image = np.full((CAMERA.height, CAMERA.width), 100, np.uint8)
    return View(Frame(10**9, image), lines, status, 1.0)


def line(number: int, pixels, in_graph: bool = True) -> ViewedLine:
    points = CAMERA.undistort(np.array(pixels, dtype=float))
    return ViewedLine(number, points[[0, -1]], points, in_graph)


def test_frames_are_handed_out_when_the_tracks_are_theirs():
    stream, calibration = small_stream()
    odometry, queue = Odometry(calibration), ViewQueue()
    added, handed_out, with_lines = [], [], 0
    for measurement in stream[: len(stream) // 3]:
        odometry.add(measurement)
        if isinstance(measurement, Frame):
            added.append(measurement.stamp)
            points = {
                (t.id, s.stamp): s.points for t in odometry.tracker.tracks for s in t.sightings
            }
            for taken in queue.take(odometry, measurement):
                handed_out.append(taken.frame.stamp)
                for seen in taken.lines:
                    own = points[seen.id, taken.frame.stamp]
                    np.testing.assert_array_equal(seen.points, own)
                with_lines += bool(taken.lines)
    assert len(handed_out) > 20
    assert with_lines > 20
    # Each once, in order; the last ones wait.
    assert handed_out == added[: len(handed_out)]
    assert len(added) - len(handed_out) <= 2


def test_frames_without_any_line_do_not_pile_up():
    stream, calibration = small_stream()
    odometry, queue = Odometry(calibration), ViewQueue()
    template = next(m for m in stream if isinstance(m, Frame))
    dark = [Frame(10**9 + i, 0 * template.image) for i in range(30)]
    taken = [each.frame.stamp for frame in dark for each in queue.take(odometry, frame)]
    assert taken == [frame.stamp for frame in dark[: len(taken)]]
    assert len(dark) - len(taken) < 10


def test_a_ruling_is_drawn_where_its_points_are():
    pixels = np.stack([np.linspace(40, 280, 25), np.linspace(60, 160, 25)], axis=1)
    drawn = draw_overlay(view(line(3, pixels)), CAMERA)
    width, height = overlay_size(CAMERA)
    assert drawn.shape == (height, width, 3)
    scale = overlay_scale(CAMERA)
    u, v = np.rint((pixels + 0.5) * scale - 0.5).astype(int).T
    assert (drawn[v, u] == line_color(3)[::-1]).all()
    # Elsewhere it stays grey.
    plain = draw_overlay(view(), CAMERA)
    far = np.any(drawn != plain, axis=2)
    far[:, 30 * scale : 290 * scale] = False
    assert not far[: CAMERA.height * scale].any()


def test_lines_out_of_the_graph_are_yellow_and_have_no_number():
    pixels = np.stack([np.linspace(40, 280, 25), np.full(25, 100.0)], axis=1)
    drawn = {known: draw_overlay(view(line(7, pixels, known)), CAMERA) for known in (True, False)}
    scale = overlay_scale(CAMERA)
    where = 100 * scale, 100 * scale
    assert tuple(drawn[True][where]) == line_color(7)[::-1]
    blue, green, red = drawn[False][where].tolist()
    assert min(red, green) > 200 > 60 > blue
    above = slice(80 * scale, 98 * scale)
    assert np.ptp(drawn[False][above].astype(int)) == 0
    assert np.ptp(drawn[True][above].astype(int)) > 100


@pytest.mark.parametrize("status", ["tracking", "dead reckoning"])
def test_the_strip_has_the_color_of_the_status(status):
    drawn = draw_overlay(view(status=status), CAMERA)
    chip = drawn[CAMERA.height * overlay_scale(CAMERA) + 15, 18]
    assert tuple(chip) == rgb(status_color(status))[::-1]


def test_dark_and_bright_images_come_out_alike():
    ramp = np.tile(np.linspace(0, 1, CAMERA.width), (CAMERA.height, 1))
    drawn = [
        draw_overlay(View(Frame(1, (low + span * ramp).astype(np.uint8)), (), "", 0.0), CAMERA)
        for low, span in ((0, 60), (90, 160))
    ]
    dark, bright = (float(image[:400].mean()) for image in drawn)
    assert dark == pytest.approx(bright, rel=0.05)
    assert 60.0 < dark < 120.0


def test_a_line_has_one_color_and_neighbours_differ():
    assert line_color(3) == line_color(23)
    assert len({line_color(number) for number in range(20)}) == 20
    assert all(0 <= part <= 255 for number in range(20) for part in line_color(number))
