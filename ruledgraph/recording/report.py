# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a pass over a recording met: counts, faults, and the lines that say so."""

import math
from collections import Counter
from dataclasses import dataclass, field

from ruledgraph.core.measurements import Frame, Gap, ImuSample

_MAX_DAMAGE_LINES = 5
# Fewer samples say little about units.
_ENOUGH_SAMPLES = 100
# m/s^2; specific force averages to about gravity over any motion but a fall.
_PLAUSIBLE_FORCE = (5.0, 20.0)
# rad/s; a camera that turns faster than this on average sees nothing but blur.
_PLAUSIBLE_RATE = 6.0


@dataclass
class StampRange:
    """First and last stamp of a kind of measurement, ns, and the longest step between two."""

    count: int = 0
    first: int = 0
    last: int = 0
    longest_step: int = 0

    def add(self, stamp: int) -> None:
        """Note the next stamp, which must not be earlier than the last."""
        if self.count:
            self.longest_step = max(self.longest_step, stamp - self.last)
        else:
            self.first = stamp
        self.last = stamp
        self.count += 1

    @property
    def rate(self) -> float:
        """Mean rate, Hz; 0 for fewer than two stamps."""
        return (self.count - 1) * 1e9 / (self.last - self.first) if self.last > self.first else 0.0


@dataclass
class Report:
    """Counts of one pass; complete when the stream has ended, correct so far at any time."""

    frames: StampRange = field(default_factory=StampRange)
    """The frames delivered."""
    imu: StampRange = field(default_factory=StampRange)
    """The IMU samples delivered."""
    skipped_frames: Counter[str] = field(default_factory=Counter)
    """Reason -> number of frames not delivered."""
    skipped_imu: Counter[str] = field(default_factory=Counter)
    """Reason -> number of IMU messages not delivered."""
    reordered: int = 0
    """Messages that came after one with a later stamp and were sorted in."""
    imu_gaps: list[Gap] = field(default_factory=list)
    damage: dict[str, int] = field(default_factory=dict)
    """What is damaged in the file -> bytes that could not be read for it."""
    force_sum: float = 0.0
    rate_sum: float = 0.0

    @property
    def bytes_lost(self) -> int:
        """Bytes of the recording that could not be read."""
        return sum(self.damage.values())

    def add(self, measurement: Frame | ImuSample) -> None:
        """Count a measurement that is delivered."""
        if isinstance(measurement, Frame):
            self.frames.add(measurement.stamp)
        else:
            self.imu.add(measurement.stamp)
            self.force_sum += math.hypot(*measurement.accelerometer.tolist())
            self.rate_sum += math.hypot(*measurement.gyroscope.tolist())

    @property
    def warnings(self) -> list[str]:
        """One line for each thing that is not as it should be."""
        lines = [*self.unit_warnings, *list(self.damage)[:_MAX_DAMAGE_LINES]]
        if len(self.damage) > _MAX_DAMAGE_LINES:
            lines.append(f"{len(self.damage) - _MAX_DAMAGE_LINES} more places are damaged")
        lines += [
            f"{n} {_plural('frame', n)} skipped: {why}" for why, n in self.skipped_frames.items()
        ]
        lines += [
            f"{n} IMU {_plural('message', n)} skipped: {why}" for why, n in self.skipped_imu.items()
        ]
        if self.reordered:
            lines.append(f"{self.reordered} messages came out of stamp order and were sorted")
        if self.imu_gaps:
            longest = max(gap.stop - gap.start for gap in self.imu_gaps) * 1e-9
            n = len(self.imu_gaps)
            lines.append(
                f"the IMU was silent {n} {_plural('time', n)}, for up to {longest:.2f} s: "
                "each gap ends a segment"
            )
        return lines

    @property
    def unit_warnings(self) -> list[str]:
        """What the mean norms of the readings say of their units, where these look wrong."""
        if self.imu.count < _ENOUGH_SAMPLES:
            return []
        lines = []
        force, rate = self.force_sum / self.imu.count, self.rate_sum / self.imu.count
        if not _PLAUSIBLE_FORCE[0] < force < _PLAUSIBLE_FORCE[1]:
            lines.append(
                f"the mean accelerometer norm is {force:.4g}, not near 9.81 m/s^2{_guess(force)}"
            )
        if rate > _PLAUSIBLE_RATE:
            lines.append(
                f"the mean gyroscope norm is {rate:.3g} rad/s, faster than a camera can follow; "
                "is it in degrees per second?"
            )
        return lines


def _guess(force: float) -> str:
    """What the mean norm of an accelerometer's readings can mean."""
    if 0.9 < force < 1.2:
        return "; is it in g? Multiply it by 9.81, that of iOS, which has the other sign, by -9.81"
    if 900.0 < force < 1200.0:
        units = ["in cm/s^2 (multiply it by 0.01)", "in mg (multiply it by 0.00981)"]
        # Gravity is 981 of the former and 1000 of the latter.
        first, second = units if force < 990.0 else units[::-1]
        return f"; is it {first}, or {second}?"
    if force < _PLAUSIBLE_FORCE[0]:
        return "; was gravity taken out? Record the accelerometer, not the linear acceleration"
    return ""


def _plural(noun: str, n: int) -> str:
    return noun if n == 1 else f"{noun}s"
