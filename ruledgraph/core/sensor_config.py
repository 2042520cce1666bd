# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the IMU, and of how camera and IMU go together."""

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.section import Section, number


class TimeOffsetConfig(Section):
    """The time offset between camera and IMU."""

    estimate: bool = True
    """Whether it is estimated, before the start and while running; otherwise, and where the
    calibration says that it is exact (`timeshift_exact: true`), the calibration's stands."""
    sigma: float = number(0.01, "s", 1e-5, 0.1)
    """Standard deviation of the calibration's."""
    random_walk: float = number(1e-3, "s", 1e-6, 0.01)
    """How fast it changes: standard deviation after one second. Stamps of arrival wander, and a
    camera that exposes by itself moves the middle of its exposures: by 10 ms in 100 s."""
    max_step: float = number(2e-3, "s", 1e-5, 0.1)
    """The frames' times follow the estimate by this much a state at most: they stay in order."""
    warn_offset: float = number(3e-3, "s", 1e-6, 1.0)
    """An offset that far from the calibration's, and by three of its standard deviations, is worth
    a warning ..."""
    settled_states: int = number(13, "", 1, 1000)
    """... when it is at so many states in a row: those of 2.5 s."""


class ExtrinsicsConfig(Section):
    """The camera's pose in the body."""

    estimate: bool = True
    """Whether it is estimated while running; otherwise the calibration's stands."""
    rotation_sigma: float = number(0.0175, "rad", 1e-6, 0.5)
    """Standard deviation of the calibration's rotation, per axis: a degree."""
    translation_sigma: float = number(1e-3, "m", 1e-6, 0.5)
    """The same of its translation, which only fast turns show."""
    rotation_random_walk: float = number(1e-4, "rad", 1e-7, 0.01)
    """How fast it turns: standard deviation after one second. A mounting gives and warms up ..."""
    translation_random_walk: float = number(1e-4, "m", 1e-7, 0.01)
    """... and the same of its translation."""
    from_images: bool = False
    """Whether a rotation that fits the images far better, with axes exchanged or the other way
    round, replaces the calibration's before the start."""
    warn_rotation: float = number(8.7e-3, "rad", 1e-6, 1.0)
    """A rotation that far from the calibration's, half a degree, and by three of its standard
    deviations, is worth a warning ..."""
    settled_states: int = number(13, "", 1, 1000)
    """... when it is at so many states in a row: those of 2.5 s."""


class IntrinsicsConfig(Section):
    """The camera's focal length."""

    estimate: bool = True
    """Whether it is estimated while running; otherwise the calibration's stands."""
    focal_sigma: float = number(0.01, "", 1e-6, 0.2)
    """Standard deviation of the calibration's focal length, as a share of it: 1 %. A good target
    and program come to 0.2 %, a few photographs of a printed board are off by some per cent."""
    focal_random_walk: float = number(1e-5, "", 1e-9, 0.01)
    """How fast it changes: standard deviation after one second, as a share. A lens that warms up by
    10 K changes by 1e-4 in some minutes."""
    warn_change: float = number(0.01, "", 1e-6, 1.0)
    """A focal length that far from the calibration's, as a share, and by three of its standard
    deviations, is worth a warning ..."""
    settled_states: int = number(13, "", 1, 1000)
    """... when it is at so many states in a row: those of 2.5 s."""


class ImuConfig(Section):
    """Gravity, outages, spikes and the range of the IMU."""

    gravity: float = number(9.81, "m/s^2", 0.1, 100.0)
    """Magnitude of gravity where the recording is made: 9.780 at the equator, 9.832 at the poles.
    The accelerometer's bias takes up most of what it is off by."""
    min_accelerometer_noise: float = number(0.01, "m/s^2/sqrt(Hz)", 0.0, 10.0)
    """White noise of an accelerometer in motion: no less is assumed, whatever the calibration says.
    Scale factors, misalignment and vibration are not in the figures of an IMU at rest. Kalibr's
    example has this for an ADIS16448, whose data sheet says 0.0023. 0: as the calibration says."""
    min_gyroscope_noise: float = number(5e-4, "rad/s/sqrt(Hz)", 0.0, 10.0)
    """The same of a gyroscope, three times its data sheet's figure."""
    accelerometer_scale_sigma: float = number(0.01, "", 0.0, 0.2)
    """Standard deviation of the accelerometer's scale factors and of the angles (rad) between its
    axes: as the body turns the bias changes by so much of what gravity changes in its axes. 0.01 is
    half a degree; 0: only the calibration's random walk."""

    max_sample_interval: float = number(0.05, "s", 1e-3, 1.0)
    """A longer stretch without a new reading is a dropout."""
    max_dropout: float = number(0.12, "s", 1e-3, 10.0)
    """After a longer dropout lines are no longer where they are expected."""
    unsure_time: float = number(1.0, "s", 0.0, 60.0)
    """How long after such a dropout or a clipped reading estimates are called degraded."""
    dropout_rate_sigma: float = number(0.5, "rad/s", 0.0, 100.0)
    """Standard deviation of the rate within a long dropout from the line between its ends."""
    dropout_force_sigma: float = number(1.5, "m/s^2", 0.0, 1e3)
    """The same of the specific force."""
    long_dropout: float = number(0.2, "s", 1e-3, 10.0)
    """Where that is reached; in a shorter dropout it is less by the square of its length."""
    frozen_repeats: int = number(4, "", 1, 1000)
    """A reading repeated so often, to the last bit, is that of a frozen IMU, unless the image
    rests."""
    silent_time: float = number(1.0, "s", 0.1, 60.0)
    """When camera or IMU are so far behind the other one, they are waited for."""
    max_frame_wait: float = number(2.0, "s", 0.1, 60.0)
    """So much of the camera's frames waits for the IMU at most; older ones are dropped."""
    spike_rate: float = number(0.2, "rad/s", 0.0, 100.0)
    """A spike's rate is further from the reading before than this ..."""
    spike_force: float = number(2.0, "m/s^2", 0.0, 1e3)
    """... or its specific force further than this ..."""
    spike_factor: float = number(4.0, "", 1.0, 100.0)
    """... and than so many times the largest recent change; hard landings stay below 3."""
    spike_return: float = number(0.3, "", 0.0, 1.0)
    """The reading after a spike is back to less than this share of its jump."""
    spike_memory: float = number(0.25, "s", 1e-3, 60.0)
    """Time constant with which the largest recent change is forgotten."""
    spike_watch_time: float = number(0.1, "s", 0.0, 60.0)
    """How long changes are watched before anything is taken for a spike."""
    range_touches: int = number(5, "", 2, 1000)
    """An axis that reads its farthest value, to the last bit, so often ends there ..."""
    range_span: float = number(0.3, "s", 0.01, 60.0)
    """... within so long ..."""
    range_steps: float = number(20.0, "", 1.0, 1e4)
    """... if it came from further off than so many of its steps ..."""
    range_share: float = number(0.9, "", 0.0, 1.0)
    """... and if that is no less than this share of what any axis of the sensor has read: they have
    one range, but for their scale factors and biases."""
    range_open_share: float = number(0.5, "", 0.0, 10.0)
    """Standard deviation of a clipped reading, as a share of the range's end."""
    range_join_time: float = number(0.03, "s", 0.0, 1.0)
    """Clipped readings no further apart are one stretch."""

    @property
    def gravity_in_world(self) -> FloatArray:
        """Downwards, (3,), m/s^2."""
        return np.array([0.0, 0.0, -self.gravity])
