# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A video plays as fast as the recording, whatever the camera's rate."""

import cv2
import numpy as np
import pytest

from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.video import RATE, Video, VideoError
from ruledgraph.visualization.views import View, ViewQueue
from small_simulation import SMALL, small_stream


def views(times) -> list[View]:
    rng = np.random.default_rng(0)
    size = SMALL.camera.height, SMALL.camera.width
    return [
        View(Frame(k, rng.integers(0, 255, size, dtype=np.uint8)), (), "tracking", float(time))
        for k, time in enumerate(times)
    ]


def length(path) -> tuple[int, float]:
    """Images, and images a second."""
    video = cv2.VideoCapture(str(path))
    return int(video.get(cv2.CAP_PROP_FRAME_COUNT)), video.get(cv2.CAP_PROP_FPS)


@pytest.mark.parametrize("rate", [20, 30, 90])
def test_it_lasts_as_long_as_the_recording(tmp_path, rate):
    with Video(tmp_path / "run.mp4", SMALL.camera) as video:
        for view in views(5.0 + np.arange(rate) / rate):
            video.show(view)
    images, shown = length(tmp_path / "run.mp4")
    assert shown == pytest.approx(RATE)
    assert images == pytest.approx(RATE, abs=2)


def test_long_gaps_are_cut_short(tmp_path):
    with Video(tmp_path / "run.mp4", SMALL.camera) as video:
        for view in views([0.0, 1.0, 1e6, 1e6 + 1.0]):
            video.show(view)
    images, _ = length(tmp_path / "run.mp4")
    # A second, two of the gap, and a second.
    assert images == pytest.approx(4 * RATE, abs=3)


def test_its_images_are_the_overlays(tmp_path):
    stream, calibration = small_stream(moving=True)
    odometry, queue, drawn = Odometry(calibration), ViewQueue(), 0
    with Video(tmp_path / "run.mp4", calibration.camera) as video:
        for measurement in stream[: len(stream) // 2]:
            odometry.add(measurement)
            if isinstance(measurement, Frame):
                video.watch(odometry, measurement)
                drawn += len(queue.take(odometry, measurement))
    images, _ = length(tmp_path / "run.mp4")
    assert images == pytest.approx(drawn, abs=2)
    reader = cv2.VideoCapture(str(tmp_path / "run.mp4"))
    reader.set(cv2.CAP_PROP_POS_FRAMES, images - 2)
    _, image = reader.read()
    assert np.mean(np.ptp(image.astype(int), axis=2) > 80) > 0.002


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.avi", r"run\.avi: a video is an \.mp4 file"),
        ("nowhere/run.mp4", r"run\.mp4: cannot be written"),
        ("mine.mp4", r"mine\.mp4: exists already"),
    ],
)
def test_what_cannot_be_written_is_one_line(tmp_path, name, message):
    (tmp_path / "mine.mp4").write_text("mine")
    with pytest.raises(VideoError, match=message):
        Video(tmp_path / name, SMALL.camera)
    assert (tmp_path / "mine.mp4").read_text() == "mine"


def test_without_images_there_is_no_file(tmp_path):
    with Video(tmp_path / "run.mp4", SMALL.camera):
        pass
    assert list(tmp_path.iterdir()) == []
