# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.config import EdgesConfig
from ruledgraph.edges.batch import Rulings
from ruledgraph.edges.gradient import Gradient
from ruledgraph.tracks import Tracker

LEVEL, STEEP = np.array([[-0.3, -0.2], [0.3, -0.15]]), np.array([[-0.2, -0.05], [0.0, 0.3]])


def scene(*lines: np.ndarray) -> Gradient:
    return Gradient(edge_image(CAMERA, [(line_through(*ends), 60.0) for ends in lines]))


def in_pixels(*lines: np.ndarray) -> np.ndarray:
    return np.array([CAMERA.distort(ends).pixels for ends in lines])


def started(tracker: Tracker, gradient: Gradient, *lines: np.ndarray) -> list[int]:
    before = {track.number for track in tracker.tracks}
    tracker.start_new(0, 0.0, in_pixels(*lines).reshape(-1, 2, 2), gradient)
    return [track.number for track in tracker.tracks if track.number not in before]


def test_a_line_is_started_once_whether_it_comes_twice_or_again():
    tracker, gradient = Tracker(CAMERA, EdgesConfig()), scene(LEVEL, STEEP)
    # The second one is a part of the first, 2 px beside it.
    part = LEVEL[0] + [[0.1], [0.8]] * (LEVEL[1] - LEVEL[0]) + [0.0, 2.0 / CAMERA.focal_length]
    assert started(tracker, gradient, LEVEL, part, STEEP) == [1, 2]
    assert started(tracker, gradient, LEVEL, part, STEEP) == []
    assert started(tracker, gradient) == []
    for track, ends in zip(tracker.tracks, (LEVEL, STEEP), strict=True):
        (sighting,) = track.sightings
        points = np.column_stack([sighting.points, np.ones(len(sighting.points))])
        # px; more than noise where the two edges cross.
        assert np.abs(points @ line_through(*ends)).max() * CAMERA.focal_length < 0.5


def test_no_more_lines_than_wanted_and_none_where_nothing_is():
    two = Tracker(CAMERA, EdgesConfig(max_lines=2))
    third = np.array([[-0.1, 0.35], [0.35, 0.2]])
    gradient = scene(LEVEL, STEEP, third)
    assert started(two, gradient, LEVEL, STEEP, third) == [1, 2]
    assert started(two, gradient, third) == []
    blank = Gradient(np.full((CAMERA.height, CAMERA.width), 90, np.uint8))
    assert started(Tracker(CAMERA, EdgesConfig()), blank, LEVEL, STEEP) == []


@pytest.mark.parametrize("oldest", [0, 1])
def test_of_tracks_on_one_line_the_oldest_stays(oldest):
    tracker, gradient = Tracker(CAMERA, EdgesConfig()), scene(LEVEL, STEEP)
    assert started(tracker, gradient, LEVEL, STEEP) == [1, 2]
    for i, track in enumerate(tracker.tracks):
        track.born = float(i != oldest)
        track.ends, track.slope = LEVEL + 0.001 * i, 20.0
    kept = tracker.tracks[oldest]
    tracker.drop_twins()
    assert tracker.tracks == [kept]


def test_motion_of_the_image_is_that_across_lines_since_a_frame():
    tracker = Tracker(CAMERA, EdgesConfig())
    lines = LEVEL, STEEP, np.array([[-0.1, 0.35], [0.35, 0.2]])
    assert len(started(tracker, scene(*lines), *lines)) == 3
    assert tracker.image_motion(since=0) == 0.0
    for i in (1, 2):
        down = np.array([0.0, 2.0 * i / CAMERA.focal_length])
        moved = [ends + down for ends in lines]
        rulings = Rulings(
            np.array([track.ends for track in tracker.tracks]),
            np.full((3, 2), 3.0),
            np.array([track.slope for track in tracker.tracks]),
        )
        assert tracker.follow(i, 0.05 * i, scene(*moved), rulings) == tracker.tracks
    # Downwards by 4 px, seen across the line that moves neither most nor least.
    along = np.diff(lines, axis=1)[:, 0]
    across = 4.0 * float(np.median(np.abs(along[:, 0]) / np.linalg.norm(along, axis=1)))
    assert tracker.image_motion(since=0) == pytest.approx(across, abs=0.2)
    assert tracker.image_motion(since=1) == pytest.approx(0.5 * across, abs=0.2)
    assert tracker.image_motion(since=7) == np.inf
