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
    tracker, threads = Tracker(CAMERA, EdgesConfig()), []

    def detector(image):
        threads.append(threading.current_thread())
        assert image is FRAME.image
        return CAMERA.distort(LEVEL).pixels[None]

    detection = Detection(tracker, detector)
    assert not detection.pending
    detection.start_tracks()
    assert tracker.tracks == []
    detection.begin(FRAME, 0.5)
    assert (detection.pending, detection.last) == (True, 0.5)
    assert tracker.tracks == []
    detection.start_tracks()
    (track,) = tracker.tracks
    assert (track.born, track.sightings[0].stamp) == (0.5, 7)
    assert threads != [threading.current_thread()]
    # Once.
    detection.start_tracks()
    assert not detection.pending
    assert tracker.tracks == [track]


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
