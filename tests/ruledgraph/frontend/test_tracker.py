# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.core.config import EdgesConfig, TracksConfig
from ruledgraph.frontend.edge_batch import Rulings
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.image_motion import image_motion
from ruledgraph.frontend.ruling_prediction import by_rotation
from ruledgraph.frontend.tracker import Tracker
from ruledgraph_factors import GeometricPoints

LEVEL, STEEP = np.array([[-0.3, -0.2], [0.3, -0.15]]), np.array([[-0.2, -0.05], [0.0, 0.3]])


def scene(*lines: np.ndarray) -> Gradient:
    return Gradient(edge_image(CAMERA, [(line_through(*ends), 60.0) for ends in lines]))


def in_pixels(*lines: np.ndarray) -> np.ndarray:
    return np.array([CAMERA.distort(ends).pixels for ends in lines])


def where_they_are(tracker: Tracker, sigma: float = 3.0) -> Rulings:
    """Rulings that predict no motion."""
    return Rulings(
        np.array([track.ends for track in tracker.tracks]).reshape(-1, 2, 2),
        np.full((len(tracker.tracks), 2), sigma),
        np.array([track.slope for track in tracker.tracks]),
    )


def started(tracker: Tracker, gradient: Gradient, *lines: np.ndarray) -> list[int]:
    before = {track.id for track in tracker.tracks}
    tracker.start_new(0, 0.0, in_pixels(*lines).reshape(-1, 2, 2), gradient)
    return [track.id for track in tracker.tracks if track.id not in before]


def test_a_line_is_started_once_whether_it_comes_twice_or_again():
    tracker, gradient = Tracker(CAMERA, EdgesConfig(), TracksConfig()), scene(LEVEL, STEEP)
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
    two = Tracker(CAMERA, EdgesConfig(max_lines=2), TracksConfig())
    third = np.array([[-0.1, 0.35], [0.35, 0.2]])
    gradient = scene(LEVEL, STEEP, third)
    assert started(two, gradient, LEVEL, STEEP, third) == [1, 2]
    assert started(two, gradient, third) == []
    blank = Gradient(np.full((CAMERA.height, CAMERA.width), 90, np.uint8))
    assert started(Tracker(CAMERA, EdgesConfig(), TracksConfig()), blank, LEVEL, STEEP) == []


@pytest.mark.parametrize("oldest", [0, 1])
def test_of_tracks_on_one_line_the_oldest_stays(oldest):
    tracker, gradient = Tracker(CAMERA, EdgesConfig(), TracksConfig()), scene(LEVEL, STEEP)
    assert started(tracker, gradient, LEVEL, STEEP) == [1, 2]
    for i, track in enumerate(tracker.tracks):
        track.first_time = float(i != oldest)
        track.ends, track.slope = LEVEL + 0.001 * i, 20.0
    kept = tracker.tracks[oldest]
    tracker.drop_duplicates()
    assert tracker.tracks == [kept]


def turned(ends: np.ndarray, degrees: float, length_px: float) -> np.ndarray:
    """A segment about the middle of another, turned."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    half = 0.5 * length_px / CAMERA.focal_length * np.array([[c, -s], [s, c]]) @ along
    return ends.mean(axis=0) + np.array([-half, half])


@pytest.mark.parametrize(
    ("degrees", "slope", "is_other"), [(2.0, 20.0, False), (14.0, 20.0, True), (2.0, -20.0, True)]
)
def test_lines_that_cross_and_edges_of_other_polarity_are_not_the_same(degrees, slope, is_other):
    """However close: 40 px long, each turned segment stays within 5 px of the long one."""
    tracker, gradient = Tracker(CAMERA, EdgesConfig(), TracksConfig()), scene(LEVEL, STEEP)
    assert started(tracker, gradient, LEVEL, STEEP) == [1, 2]
    tracker.tracks[0].slope = 20.0
    tracker.tracks[1].ends, tracker.tracks[1].slope = turned(LEVEL, degrees, 40.0), slope
    tracker.drop_duplicates()
    assert [track.id for track in tracker.tracks] == ([1, 2] if is_other else [1])


def test_a_steady_motion_of_a_line_is_learnt():
    """3 px a frame at one end and 1 px at the other, in frames of 50 ms; the camera is still."""
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    places = [
        LEVEL + i * np.array([[0.0, 3.0], [0.0, 1.0]]) / CAMERA.focal_length for i in range(8)
    ]
    assert started(tracker, scene(LEVEL), LEVEL) == [1]
    (track,) = tracker.tracks
    for i, place in enumerate(places[1:-1], start=1):
        predicted = by_rotation([track], np.eye(3), 0.05, CAMERA.focal_length)
        assert tracker.track(i, 0.05 * i, scene(place), predicted) == [track]
    (next_one,) = by_rotation([track], np.eye(3), 0.05, CAMERA.focal_length).one_by_one()
    homogeneous = np.column_stack([next_one.ends, np.ones(2)])
    # A line that was thought to stand still would be up to 3 px away.
    assert np.abs(homogeneous @ line_through(*places[-1])).max() * CAMERA.focal_length < 0.5


def test_sightings_are_forgotten_from_the_oldest_on():
    tracker, gradient = Tracker(CAMERA, EdgesConfig(), TracksConfig()), scene(LEVEL)
    assert started(tracker, gradient, LEVEL) == [1]
    for i in (1, 2, 3):
        tracker.track(i, 0.05 * i, gradient, where_they_are(tracker))
    tracker.forget(2)
    assert [sighting.stamp for sighting in tracker.tracks[0].sightings] == [2, 3]
    assert [sighting.stamp for sighting in tracker.observed()[0].sightings] == [2, 3]


def test_motion_of_the_image_is_that_across_lines_since_a_frame():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    lines = LEVEL, STEEP, np.array([[-0.1, 0.35], [0.35, 0.2]])
    assert len(started(tracker, scene(*lines), *lines)) == 3
    assert image_motion(*tracker.lines_moved(since=0), 0.4, 1) == 0.0
    for i in (1, 2):
        down = np.array([0.0, 2.0 * i / CAMERA.focal_length])
        moved = [ends + down for ends in lines]
        rulings = where_they_are(tracker)
        assert tracker.track(i, 0.05 * i, scene(*moved), rulings) == tracker.tracks
    # Downwards by 4 px, seen across the line that moves neither most nor least.
    along = np.diff(lines, axis=1)[:, 0]
    across = 4.0 * float(np.median(np.abs(along[:, 0]) / np.linalg.norm(along, axis=1)))
    assert image_motion(*tracker.lines_moved(since=0), 0.4, 1) == pytest.approx(across, abs=0.2)
    assert image_motion(*tracker.lines_moved(since=1), 0.4, 1) == pytest.approx(
        0.5 * across, abs=0.2
    )
    assert image_motion(*tracker.lines_moved(since=7), 0.4, 1) == np.inf


def test_a_frame_counts_for_no_more_than_was_configured():
    edges = EdgesConfig(effective_points=12.0)
    tracker, gradient = Tracker(CAMERA, edges, TracksConfig()), scene(LEVEL)
    assert started(tracker, gradient, LEVEL) == [1]
    tracker.track(1, 0.05, gradient, where_they_are(tracker))
    first, second = tracker.tracks[0].sightings
    for sighting in (first, second):
        assert len(sighting.points) > 12
        C = GeometricPoints.from_frames([sighting.points], effective_points=12.0).statistics[0]
        mine = sighting.statistics
        np.testing.assert_allclose(mine.T @ mine, C.T @ C, atol=1e-12)


def test_a_line_that_is_not_there_is_missed_until_it_is_lost():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    assert started(tracker, scene(LEVEL, STEEP), LEVEL, STEEP) == [1, 2]
    level, steep = tracker.tracks
    for i in range(1, 5):
        assert not steep.lost
        rulings = where_they_are(tracker)
        rulings.ends[1] += 0.001
        assert tracker.track(i, 0.02 * i, scene(LEVEL), rulings) == [level]
        # It goes on as predicted, less and less sure.
        np.testing.assert_allclose(steep.ends, rulings.ends[1], atol=1e-12)
        assert steep.misses == i
    assert steep.lost
    assert (level.misses, level.last_seen) == (0, 0.08)
    assert len(steep.sightings) == 1
    tracker.drop_lost()
    assert tracker.tracks == [level]


def test_what_a_lost_line_saw_is_kept_until_it_is_forgotten():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    assert started(tracker, scene(LEVEL, STEEP), LEVEL, STEEP) == [1, 2]
    tracker.track(1, 0.05, scene(LEVEL, STEEP), where_they_are(tracker))
    tracker.tracks[1].mark_lost()
    tracker.drop_lost()
    level, steep = tracker.observed()
    assert (level.id, steep.id) == (1, 2)
    assert (level.in_view, steep.in_view) == (True, False)
    assert [sighting.stamp for sighting in steep.sightings] == [0, 1]
    tracker.retime(0.5)
    assert tracker.observed()[1].first_time == pytest.approx(steep.first_time + 0.5)
    tracker.forget(1)
    assert [sighting.stamp for sighting in tracker.observed()[1].sightings] == [1]
    tracker.forget(2)
    assert [track.id for track in tracker.observed()] == [1]


def test_what_a_rejected_line_saw_is_forgotten():
    """Whether it has ended or not."""
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    assert started(tracker, scene(LEVEL, STEEP), LEVEL, STEEP) == [1, 2]
    tracker.tracks[1].mark_lost()
    tracker.drop_lost()
    tracker.reject({1, 2})
    assert [list(track.sightings) for track in tracker.observed()] == [[], []]
    tracker.drop_lost()
    tracker.forget(0)
    assert tracker.observed() == []


def test_when_all_is_forgotten_so_are_ended_lines():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    assert started(tracker, scene(LEVEL, STEEP), LEVEL, STEEP) == [1, 2]
    tracker.tracks[1].mark_lost()
    tracker.drop_lost()
    tracker.clear()
    assert tracker.observed() == []


def test_a_line_out_of_view_is_lost_at_once():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    assert started(tracker, scene(LEVEL, STEEP), LEVEL, STEEP) == [1, 2]
    rulings = where_they_are(tracker)
    rulings.ends[0] += [0.0, 3.0]
    assert tracker.track(1, 0.05, scene(LEVEL, STEEP), rulings) == tracker.tracks[1:]
    assert tracker.tracks[0].lost


def test_of_two_lines_in_the_band_neither_is_taken():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    assert started(tracker, scene(LEVEL), LEVEL) == [1]
    apart = np.array([0.0, 6.0 / CAMERA.focal_length])
    # A bright stripe's two edges have opposite slopes: two steps of like polarity instead.
    steps = Gradient(
        edge_image(CAMERA, [(line_through(*(LEVEL + side * apart)), 40.0) for side in (-1, 1)])
    )
    assert tracker.track(1, 0.05, steps, where_they_are(tracker, sigma=4.0)) == []
    assert tracker.tracks[0].misses == 1


def test_every_track_needs_its_ruling():
    tracker, gradient = Tracker(CAMERA, EdgesConfig(), TracksConfig()), scene(LEVEL, STEEP)
    assert started(tracker, gradient, LEVEL, STEEP) == [1, 2]
    with pytest.raises(ValueError, match="shorter"):
        tracker.track(1, 0.05, gradient, where_they_are(tracker).part([0]))


def test_a_new_track_is_expected_to_move_as_those_around_it():
    """By 20 px a frame, further than a new line is searched for where nothing is known."""
    step = np.array([20.0 / CAMERA.focal_length, 0.0])
    lines = [STEEP, STEEP - np.array([0.2, 0.0]), STEEP + np.array([0.1, 0.0])]
    at = [[ends + i * step for ends in lines] for i in range(5)]
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    started(tracker, scene(*at[0]), *at[0][:2])
    for i in range(1, 4):
        rulings = by_rotation(tracker.tracks, np.eye(3), 0.05, CAMERA.focal_length)
        wide = np.full_like(rulings.sigmas, 8.0)
        tracker.track(i, 0.05 * i, scene(*at[i]), rulings._replace(sigmas=wide))
    (new,) = started(tracker, scene(*at[3]), at[3][2])
    rulings = by_rotation(tracker.tracks, np.eye(3), 0.05, CAMERA.focal_length)
    expected = rulings.ends[[track.id for track in tracker.tracks].index(new)]
    off = line_through(*at[4][2]) @ np.column_stack([expected, np.ones(2)]).T
    assert np.abs(off).max() * CAMERA.focal_length < 10.0
    found = tracker.track(4, 0.2, scene(*at[4]), rulings)
    assert new in [track.id for track in found]
