# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from recorded_runs import at_slower_stamps
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import GroundTruth


def eight(step: float, begin: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, positions and orientations along a figure of eight, 2 m wide, in four seconds."""
    times = np.arange(begin, 8.0, step)
    phase = 0.5 * np.pi * times
    positions = np.stack([np.sin(phase), 0.5 * np.sin(2.0 * phase), np.zeros_like(phase)], axis=1)
    return (
        (1e9 * times).round().astype(np.int64),
        positions,
        np.tile([0.0, 0, 0, 1], (len(times), 1)),
    )


@pytest.mark.parametrize(("step", "begin", "of_truth"), [(0.05, 0.02, 0.2), (0.2, 0.1, 0.01)])
def test_the_faster_is_interpolated(step: float, begin: float, of_truth: float):
    """With stamps that never agree, too."""
    estimate, truth = Trajectory(*eight(step, begin)), GroundTruth(*eight(of_truth))
    at, true = at_slower_stamps(estimate, truth)
    np.testing.assert_array_equal(at.stamps, true.stamps)
    assert set(at.stamps) <= set(max(estimate, truth, key=lambda t: np.diff(t.stamps)[0]).stamps)
    assert len(at) >= 38  # 8 s of steps of 0.2 s, but for the ends
    # Between samples 0.05 s apart a line misses the curve by a'' step^2 / 8, a'' = 5.5 m/s^2.
    assert np.linalg.norm(at.positions - true.positions, axis=1).max() < 2e-3
