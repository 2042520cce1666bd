# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far a run is, as it is said where there is no terminal."""

import time
from types import SimpleNamespace

import numpy as np

from ruledgraph.app.progress import progress_bar
from ruledgraph.app.steps import Step
from ruledgraph.core.measurements import Frame


def test_without_a_terminal_there_is_a_line_every_few_seconds(monkeypatch, capsys):
    now = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    window = SimpleNamespace(lines={1: None, 2: None})
    odometry = SimpleNamespace(window=window, status="degraded: too few lines")
    with progress_bar(40) as observe:
        for i in range(12):
            now += 1.0
            frame = Frame(10**18 + i * 10**8, np.zeros((4, 4), np.uint8))
            observe(Step(odometry, frame, [], [], []))
        now += 10.0
        observe(Step(odometry, None, [], [], []))
    assert capsys.readouterr().err.splitlines() == [
        "5 of 40 frames, 0.4 s, degraded, 2 lines",
        "10 of 40 frames, 0.9 s, degraded, 2 lines",
    ]
