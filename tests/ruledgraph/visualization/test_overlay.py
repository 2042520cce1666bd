# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures over the camera's images show the lines of the very image they are drawn on."""

import cv2
import numpy as np

from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.overlay import FrameQueue, line_color
from ruledgraph.visualization.plots import Sketches
from small_simulation import small_stream


def test_frames_are_handed_out_when_the_tracks_are_theirs():
    stream, calibration = small_stream()
    odometry, queue = Odometry(calibration), FrameQueue()
    added, handed_out = [], []
    for measurement in stream[: len(stream) // 3]:
        odometry.add(measurement)
        if isinstance(measurement, Frame):
            added.append(measurement.stamp)
            newest = [t.sightings[-1].stamp for t in odometry.tracker.tracks if t.sightings]
            for frame in queue.take(odometry, measurement):
                handed_out.append(frame.stamp)
                # Tracks start in a frame with the next one: the first frame comes late.
                assert frame.stamp == max(newest) or handed_out == added[:1]
    assert len(handed_out) > 20
    # Each once, in order; the last ones wait.
    assert handed_out == added[: len(handed_out)]
    assert len(added) - len(handed_out) <= 2


def test_frames_without_any_line_do_not_pile_up():
    stream, calibration = small_stream()
    odometry, queue = Odometry(calibration), FrameQueue()
    template = next(m for m in stream if isinstance(m, Frame))
    dark = [Frame(10**9 + i, 0 * template.image) for i in range(30)]
    taken = [frame.stamp for each in dark for frame in queue.take(odometry, each)]
    assert taken == [frame.stamp for frame in dark[: len(taken)]]
    assert len(dark) - len(taken) < 10


def test_a_sketch_is_drawn_on_the_frame_of_its_lines(tmp_path):
    stream, calibration = small_stream(moving=True)
    odometry, sketches = Odometry(calibration), Sketches(calibration.camera)
    images, points = {}, {}
    for measurement in stream:
        odometry.add(measurement)
        if isinstance(measurement, Frame):
            images[measurement.stamp] = measurement.image
            for track in odometry.tracker.tracks:
                last = track.sightings[-1]
                points.setdefault(last.stamp, {})[track.number] = last.points
            sketches.watch(odometry, measurement)
    (tmp_path / "run").mkdir()
    sketches.draw(tmp_path / "run", None)
    drawn = sorted((tmp_path / "run" / "plots").glob("overlay_*.png"))
    assert len(drawn) >= 3
    for path in drawn:
        stamp = int(path.stem.removeprefix("overlay_"))
        changed = np.any(cv2.imread(str(path)) != images[stamp][:, :, None], axis=2)
        assert 0.001 < changed.mean() < 0.3
        normalised = np.concatenate(list(points[stamp].values()))
        u, v = np.rint(calibration.camera.distort(normalised).pixels).astype(int).T
        assert changed[v, u].mean() > 0.95


def test_a_line_has_one_color_and_neighbours_differ():
    assert line_color(3) == line_color(23)
    assert len({line_color(number) for number in range(20)}) == 20
    assert all(0 <= part <= 255 for number in range(20) for part in line_color(number))
