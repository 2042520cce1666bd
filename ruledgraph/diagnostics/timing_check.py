# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a sensor's stamps are those of its measurements, and whether any are missing."""

from collections.abc import Iterator

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.diagnostics.finding import Finding

# Hz; below these the motion between two measurements is guessed.
_MIN_RATES = {"camera": 10.0, "IMU": 100.0}
_NEARLY = 0.98
# The usual step is that of so many in a row: what comes in bunches has short steps and long ones.
_IN_A_ROW = 10
# A step this much longer than the usual one is a loss; more losses than this share are too many.
_LOSS, _MAX_LOST = 1.6, 0.02
# Scatter of the steps below this is rounding, s.
_FINEST = 1e-6
# Standard deviation of the steps that is still regular, of the usual step.
_REGULAR = 0.25
# Losses make longer steps only; where more than this share are shorter than half the usual one,
# stamps are uneven, and a long step is no loss.
_SHORT, _MAX_SHORT = 0.5, 0.05


def examine_timing(name: str, times: FloatArray) -> Iterator[Finding]:
    """Rate, losses and unevenness of the stamps (s) of a sensor, `camera` or `IMU`."""
    steps = np.diff(times)
    usual = float(np.median(times[_IN_A_ROW:] - times[:-_IN_A_ROW])) / _IN_A_ROW
    rate = 1.0 / usual
    if rate < _NEARLY * _MIN_RATES[name]:
        least = f"{_MIN_RATES[name]:.0f} Hz"
        yield Finding(False, f"the {name} runs at {rate:.3g} Hz; record at {least} at the least")
    if np.mean(steps < _SHORT * usual) > _MAX_SHORT:
        yield _uneven(name, float(np.abs(steps - usual).mean()) / usual)
        return
    kept = steps[steps < _LOSS * usual]
    lost = int(np.round(steps[steps >= _LOSS * usual] / usual - 1.0).sum())
    jitter = float(kept.std()) / usual
    share = lost / (lost + len(times))
    if share > _MAX_LOST:
        yield Finding(
            False,
            f"{share:.0%} of the {name}'s measurements are missing; record fewer topics, "
            "uncompressed, to a faster disk",
        )
    if jitter > _REGULAR:
        yield _uneven(name, jitter)
    elif share <= _MAX_LOST:
        scatter = max(float(kept.std()), _FINEST)
        even = f"less than {1e3 * _FINEST:.3f}" if scatter == _FINEST else f"{1e3 * scatter:.2g}"
        yield Finding(
            True,
            f"the {name}'s stamps come every {1e3 * usual:.3g} ms, even to {even} ms; "
            f"{lost} missing",
        )


def _uneven(name: str, jitter: float) -> Finding:
    return Finding(
        False,
        f"the {name}'s stamps are {jitter:.0%} of a step uneven; are they times of arrival? "
        "Record with the sensor's own clock",
    )
