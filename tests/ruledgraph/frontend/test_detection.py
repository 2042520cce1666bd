# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import threading

import numpy as np
import pytest

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.core.config import EdgesConfig, TracksConfig
from ruledgraph.core.measurements import Frame
from ruledgraph.frontend.detection import Detection
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.tracker import Tracker
from ruledgraph.odometry import Odometry
from small_simulation import small_stream

LEVEL = np.array([[-0.3, -0.2], [0.3, -0.15]])
FRAME = Frame(7, edge_image(CAMERA, [(line_through(*LEVEL), 60.0)]))
GRADIENT = Gradient(FRAME.image)


def test_tracks_start_in_the_frame_that_was_searched():
    tracker, begun = Tracker(CAMERA, EdgesConfig(), TracksConfig()), threading.Event()

    def detector(image):
        assert begun.wait(10.0), "`begin` waits for the detector"
        assert image is FRAME.image
        return CAMERA.distort(LEVEL).pixels[None]

    detection = Detection(tracker, detector)
    assert not detection.pending
    detection.start_tracks()
    assert tracker.tracks == []
    assert detection.is_due(0.0, 0.1)
    detection.begin(FRAME, GRADIENT, 0.5)
    begun.set()
    assert detection.pending
    assert not detection.is_due(0.55, 0.1)
    assert detection.is_due(0.65, 0.1)
    assert tracker.tracks == []
    detection.start_tracks()
    (track,) = tracker.tracks
    assert (track.first_time, track.sightings[0].stamp) == (0.5, 7)
    # Once.
    detection.start_tracks()
    assert not detection.pending
    assert tracker.tracks == [track]


def test_the_clock_of_the_frames_is_corrected_in_between():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    detection = Detection(tracker, lambda _: CAMERA.distort(LEVEL).pixels[None])
    detection.begin(FRAME, GRADIENT, 0.5)
    detection.retime(-0.02)
    assert not detection.is_due(0.57, 0.1)
    assert detection.is_due(0.59, 0.1)
    detection.start_tracks()
    assert tracker.tracks[0].first_time == tracker.tracks[0].last_seen == pytest.approx(0.48)


def test_lost_tracks_are_in_no_ones_way():
    tracker = Tracker(CAMERA, EdgesConfig(max_lines=2), TracksConfig())
    detection = Detection(tracker, lambda _: CAMERA.distort(LEVEL).pixels[None])
    for _ in range(2):
        detection.begin(FRAME, GRADIENT, 0.5)
        detection.start_tracks()
        (track,) = tracker.tracks
        track.mark_lost()
    assert track.id == 2


def test_what_is_forgotten_starts_nothing():
    tracker = Tracker(CAMERA, EdgesConfig(), TracksConfig())
    detection = Detection(tracker, lambda _: CAMERA.distort(LEVEL).pixels[None])
    detection.begin(FRAME, GRADIENT, 0.5)
    detection.forget()
    detection.start_tracks()
    assert tracker.tracks == []


def test_what_goes_wrong_in_the_thread_is_raised():
    def detector(_):
        raise ValueError("no such image")

    detection = Detection(Tracker(CAMERA, EdgesConfig(), TracksConfig()), detector)
    detection.begin(FRAME, GRADIENT, 0.5)
    with pytest.raises(ValueError, match="no such image"):
        detection.start_tracks()


def frames(count: int) -> list[Frame]:
    """At 20 Hz."""
    return [Frame(50_000_000 * i, FRAME.image.copy()) for i in range(count)]


def test_what_is_prefetched_is_searched_once_and_the_same():
    coming, begun = frames(50), []
    searched, done = [], {id(frame.image): threading.Event() for frame in coming}

    def detector(image):
        searched.append(id(image))
        done[id(image)].set()
        return CAMERA.distort(LEVEL).pixels[None]

    detection = Detection(Tracker(CAMERA, EdgesConfig(), TracksConfig()), detector)
    for i in range(40):
        # The reader is ten frames ahead. Every fourth frame is searched, later every tenth.
        detection.prefetch(coming[i + 10])
        if i % 4 == 0 if i < 24 else i % 10 == 4:
            # Prefetched since two searches showed the rhythm and the reader came to a turn of it.
            if 16 <= i < 24:
                assert done[id(coming[i].image)].wait(10.0)
            detection.begin(coming[i], GRADIENT, 0.05 * i)
            begun.append(id(coming[i].image))
            detection.start_tracks()
    assert len(begun) == 8
    assert set(begun) <= set(searched)
    assert len(set(searched)) == len(searched)


def test_another_image_of_the_same_stamp_is_searched_itself():
    searched = []

    def detector(image):
        searched.append(image)
        return np.zeros((0, 2, 2))

    coming = frames(9)
    detection = Detection(Tracker(CAMERA, EdgesConfig(), TracksConfig()), detector)
    for i in (0, 4):
        detection.begin(coming[i], GRADIENT, 0.05 * i)
    for frame in coming[5:]:
        detection.prefetch(frame)
    black = Frame(coming[8].stamp, np.zeros_like(FRAME.image))
    detection.begin(black, GRADIENT, 0.4)
    detection.start_tracks()
    assert searched[-1] is black.image


def test_frames_that_are_never_searched_do_not_pile_up():
    searched = []

    def detector(image):
        searched.append(image)
        return np.zeros((0, 2, 2))

    detection = Detection(Tracker(CAMERA, EdgesConfig(), TracksConfig()), detector)
    coming = frames(400)
    for i in (0, 4):
        detection.begin(coming[i], GRADIENT, 0.05 * i)
    for frame in coming[5:]:
        detection.prefetch(frame)
    detection.begin(coming[-1], GRADIENT, 20.0)
    detection.start_tracks()
    assert len(searched) < 20


def test_the_odometry_is_the_same_whether_it_prefetches_or_not():
    stream, calibration = small_stream()
    estimates = []
    for ahead in (0, 40):
        odometry = Odometry(calibration)
        for i, measurement in enumerate(stream):
            coming = stream[min(i + ahead, len(stream) - 1)]
            if ahead and isinstance(coming, Frame):
                odometry.prefetch(coming)
            odometry.add(measurement)
        estimates.append(odometry.take_live())
    assert len(estimates[0]) > 30
    for one, other in zip(*estimates, strict=True):
        assert one.world_T_body.equals(other.world_T_body, 0.0)
        assert one.lines == other.lines
