# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph live` with sensors that are not what they should be."""

import re
import threading
import time

import numpy as np
import pytest

from ruledgraph.app import live_command as command
from ruledgraph.app import refusals
from ruledgraph.calibration import write_kalibr
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.recording import open_recording
from small_simulation import small_stream

OPTIONS = {
    "calibration_files": (),
    "camera": None,
    "imu": None,
    "readout": None,
    "resolution": "320x240",
    "rate": 30,
    "duration": 5.0,
    "record": None,
    "config_file": None,
    "settings": (),
    "force": False,
}


class Sensors(Closing):
    """Deliver measurements at the pace of their stamps."""

    def __init__(self, measurements, calibration):
        self.calibration = lambda _noise: calibration
        self._measurements = list(measurements)
        self._error = None

    def start(self, on_image, on_imu):
        self._thread = threading.Thread(target=self._play, args=(on_image, on_imu))
        self._thread.start()

    def _play(self, on_image, on_imu):
        late = time.monotonic() - 1e-9 * self._measurements[0].stamp
        try:
            for m in self._measurements:
                time.sleep(max(0.0, late + 1e-9 * m.stamp - time.monotonic()))
                if isinstance(m, Frame):
                    on_image(m.image, m.stamp)
                else:
                    on_imu(m.gyroscope, m.accelerometer, m.stamp)
        except RuledgraphError as error:
            self._error = error

    def check(self):
        if self._error is not None:
            raise self._error

    def close(self):
        self._thread.join()


@pytest.fixture
def run(monkeypatch):
    def run(measurements, **options):
        sensors = Sensors(measurements, small_stream()[1])
        monkeypatch.setattr(command, "RealSense", lambda *_: sensors)
        command.live_command(**{**OPTIONS, **options}, device=object())

    return run


def test_what_cannot_be_used_is_counted_and_the_run_goes_on(run, tmp_path, capsys):
    stream, _ = small_stream()
    images = [i for i, m in enumerate(stream) if isinstance(m, Frame)]
    samples = [i for i, m in enumerate(stream) if isinstance(m, ImuSample)]
    spoilt = {}
    for i in images[20:120:10]:
        late, small = stream[i].stamp - 3_000_000, stream[i].image[1:]
        spoilt[i] = [Frame(late, stream[i].image), Frame(stream[i].stamp + 5_000_000, small)]
    for i in samples[200:800:100]:
        nan = stream[i]._replace(stamp=stream[i].stamp + 1_000_000, gyroscope=np.full(3, np.nan))
        spoilt[i] = [stream[i]._replace(stamp=stream[i].stamp - 3_000_000), nan]
    fed = [m for i, good in enumerate(stream) for m in (good, *spoilt.get(i, ()))]
    run(fed, record=tmp_path / "room.mcap")
    out, err = capsys.readouterr()
    (estimates,) = re.findall(r"(\d+) estimates", out)
    assert int(estimates) > 40
    first_image, first_sample, *_, last = err.splitlines()
    assert re.fullmatch(r"warning: an image is left out: an image at .* of time", first_image)
    assert re.fullmatch(r"warning: an IMU sample is left out: an IMU sample .*", first_sample)
    assert last == "warning: 20 images and 12 IMU samples could not be used"
    assert err.count("left out:") == 2
    recorded = list(open_recording(tmp_path / "room.mcap").stream())
    assert sum(isinstance(m, ImuSample) for m in recorded) == len(samples)


def test_when_nothing_can_be_used_it_ends(run, monkeypatch):
    monkeypatch.setattr(refusals, "_LONGEST", 0.5)
    stream, _ = small_stream()
    turned = [Frame(m.stamp, m.image.T) if isinstance(m, Frame) else m for m in stream]
    with pytest.raises(RuledgraphError, match=r"^no image for 0.5 s could be used: .* 240x320"):
        run(turned)


def test_forces_in_another_unit_end_it(run):
    stream, _ = small_stream()
    in_g = [
        m._replace(accelerometer=m.accelerometer / 9.81) if isinstance(m, ImuSample) else m
        for m in stream
    ]
    with pytest.raises(RuledgraphError, match=r"^the accelerometer reads [01]\.?\d* on average"):
        run(in_g)


def test_a_calibration_of_another_size_is_refused_at_once(run, tmp_path):
    stream, calibration = small_stream()
    write_kalibr(calibration, tmp_path / "calib.yaml")
    with pytest.raises(RuledgraphError, match=r"will be 640x480, but .* --resolution 320x240"):
        run(stream, calibration_files=[tmp_path / "calib.yaml"], resolution="640x480")


def test_the_odometrys_warnings_are_printed(run, capsys):
    stream, _ = small_stream()
    frozen = stream[-1].stamp - 1_000_000_000
    still = next(m.image for m in stream if isinstance(m, Frame) and m.stamp > frozen)
    run(Frame(m.stamp, still) if isinstance(m, Frame) and m.stamp > frozen else m for m in stream)
    assert "warning: the camera is frozen" in capsys.readouterr().err
