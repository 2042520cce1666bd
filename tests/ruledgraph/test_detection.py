# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import threading

import numpy as np
import pytest

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.config import EdgesConfig
from ruledgraph.detection import Detection
from ruledgraph.measurements import Frame
from ruledgraph.tracks import Tracker

LEVEL = np.array([[-0.3, -0.2], [0.3, -0.15]])
FRAME = Frame(7, edge_image(CAMERA, [(line_through(*LEVEL), 60.0)]))


def test_tracks_start_in_the_frame_that_was_searched():
    tracker, begun = Tracker(CAMERA, EdgesConfig()), threading.Event()

    def detector(image):
        assert begun.wait(10.0), "`begin` waits for the detector"
        assert image is FRAME.image
        return CAMERA.distort(LEVEL).pixels[None]

    detection = Detection(tracker, detector)
    assert not detection.pending
    detection.start_tracks()
    assert tracker.tracks == []
    assert detection.is_due(0.0, 0.1)
    detection.begin(FRAME, 0.5)
    begun.set()
    assert detection.pending
    assert not detection.is_due(0.55, 0.1)
    assert detection.is_due(0.65, 0.1)
    assert tracker.tracks == []
    detection.start_tracks()
    (track,) = tracker.tracks
    assert (track.born, track.sightings[0].stamp) == (0.5, 7)
    # Once.
    detection.start_tracks()
    assert not detection.pending
    assert tracker.tracks == [track]


def test_the_clock_of_the_frames_is_corrected_in_between():
    tracker = Tracker(CAMERA, EdgesConfig())
    detection = Detection(tracker, lambda _: CAMERA.distort(LEVEL).pixels[None])
    detection.begin(FRAME, 0.5)
    detection.move(-0.02)
    assert not detection.is_due(0.57, 0.1)
    assert detection.is_due(0.59, 0.1)
    detection.start_tracks()
    assert tracker.tracks[0].born == tracker.tracks[0].last_seen == pytest.approx(0.48)


def test_lost_tracks_are_in_no_ones_way():
    tracker = Tracker(CAMERA, EdgesConfig(max_lines=2))
    detection = Detection(tracker, lambda _: CAMERA.distort(LEVEL).pixels[None])
    for _ in range(2):
        detection.begin(FRAME, 0.5)
        detection.start_tracks()
        (track,) = tracker.tracks
        track.give_up()
    assert track.number == 2


def test_what_is_forgotten_starts_nothing():
    tracker = Tracker(CAMERA, EdgesConfig())
    detection = Detection(tracker, lambda _: CAMERA.distort(LEVEL).pixels[None])
    detection.begin(FRAME, 0.5)
    detection.forget()
    detection.start_tracks()
    assert tracker.tracks == []


def test_what_goes_wrong_in_the_thread_is_raised():
    def detector(_):
        raise ValueError("no such image")

    detection = Detection(Tracker(CAMERA, EdgesConfig()), detector)
    detection.begin(FRAME, 0.5)
    with pytest.raises(ValueError, match="no such image"):
        detection.start_tracks()
