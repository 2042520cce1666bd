# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""All settings: every number that shapes an estimate, with its unit, range and meaning.

A section belongs to a stage, which gets that section alone. `settings.py` reads and writes them.
"""

import numpy as np
from pydantic import model_validator
from typing_extensions import Self

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.image_config import EdgesConfig as EdgesConfig
from ruledgraph.core.image_config import TracksConfig as TracksConfig
from ruledgraph.core.section import Section, number
from ruledgraph.core.sensor_config import ExtrinsicsConfig as ExtrinsicsConfig
from ruledgraph.core.sensor_config import ImuConfig as ImuConfig
from ruledgraph.core.sensor_config import IntrinsicsConfig as IntrinsicsConfig
from ruledgraph.core.sensor_config import TimeOffsetConfig as TimeOffsetConfig


class LinesConfig(Section):
    """The life of a line in the graph."""

    cauchy_scale_px: float = number(0.5, "px", 0.0, 100.0)
    """Scale of the Cauchy loss, with which a start in motion ends, too: offset of the whole line in
    every frame; 0: quadratic loss, of a start 1 px. With 20 points of `edges.sigma_px` an offset's
    standard deviation is 0.22 px: the loss is 95 % efficient for normal errors (2.385 of them is
    0.53 px)."""
    weight_prior: float = number(5.0, "", 0.1, 1e6)
    """Intervals between states, a second of them, that a line's points count for as noisy as those
    of other lines, beside those in which it was seen: degrees of freedom of Student's t."""
    min_sightings: int = number(3, "", 2, 100)
    """Frames that must have seen a line before it is triangulated."""
    max_new_misfit_px: float = number(1.5, "px", 0.01, 100.0)
    """A triangulated line that misses its points by more (root mean square) does not enter."""
    max_misfit_px: float = number(2.0, "px", 0.01, 100.0)
    """A line that misses its newest points by more (root mean square) does not fit."""
    max_bad_states: int = number(2, "", 1, 100)
    """A line that does not fit at so many states in a row is rejected."""
    min_distance: float = number(0.05, "m", 1e-3, 10.0)
    """Nearer to its first camera a new line is taken for an error."""
    behind_sigmas: float = number(2.0, "", 0.0, 100.0)
    """A line whose inverse distance is so many standard deviations below zero is rejected."""
    recentre_change: float = number(0.1, "", 1e-6, 1e3)
    """A line moved so far (chart coordinates, rad) from its linearisation gets a new variable."""
    prior_distance: float = number(3.0, "m", 0.01, 1e4)
    """Distance of a line from the camera, before any is known; it counts as one line's among those
    that are known, whose geometric mean a new one is expected at."""
    prior_distance_factor: float = number(4.0, "", 1.01, 1e3)
    """By what factor that may be wrong, one standard deviation."""
    covariances_per_state: int = number(4, "", 1, 200)
    """Lines whose covariance is computed anew at a state; each takes as long as ten factors."""
    extent_outliers: float = number(0.1, "", 0.0, 0.49)
    """Share of a line's sightings whose ends may lie beyond the reported ones."""


class MapConfig(Section):
    """Which lines of the map are one physical line, seen several times."""

    confidence: float = number(0.99, "", 0.5, 0.9999)
    """Of the chi-square test of their difference, 4 DoF: one in a hundred pairs of sightings stays
    apart if the covariances are right."""
    spacing: float = number(0.1, "m", 0.0, 10.0)
    """From a line to the next one beside it: lines stay apart when the ellipse in which they are
    taken for one is larger than its square; 0: all lines stay apart."""
    extent_tolerance: float = number(0.05, "m", 0.0, 10.0)
    """How well ends are known along a line: over a longer gap lines are two, and lines that were
    seen at one time overlap by less if they are one."""


class WindowConfig(Section):
    """States, lag and solution of the fixed-lag smoother."""

    state_interval: float = number(0.2, "s", 0.01, 1.0)
    """Time between states."""
    lag: float = number(4.0, "s", 0.04, 60.0)
    """Length of the window; what leaves it is linearized for good. The longer, the more accurate
    and the slower: in random parts of recordings 4 s leave 0.9 (live) and 0.8 (smoothed) of the
    error of 2.5 s, in 1.2 times the time. The paper's is 1.55 s (140 frames at 90 fps)."""
    camera_period: float = number(1.0, "s", 0.0, 60.0)
    """For so long the camera's pose in the body and its focal length count as constant: they hardly
    change in a second, and every variable costs time."""
    updates: int = number(1, "", 0, 20)
    """Further iSAM2 updates at most, at states that are not where the IMU predicted them; and how
    often a state is solved again at most while lines move far (`lines.recentre_change`)."""
    step_position: float = number(0.003, "m", 0.0, 10.0)
    """A state further from the IMU's prediction gets such an update ..."""
    step_velocity: float = number(0.010, "m/s", 0.0, 10.0)
    """... or one whose velocity departs by more."""
    jump_position: float = number(1.0, "m", 0.001, 1e3)
    """A state further from the IMU's prediction shows that the smoother has diverged ..."""
    jump_velocity: float = number(3.0, "m/s", 0.001, 1e3)
    """... as does a velocity that departs by more."""
    relinearize: float = number(1e-3, "", 0.0, 1.0)
    """Estimates that move by less (rad, m, m/s, ...) are not linearised anew."""
    dogleg_updates: int = number(20, "", 1, 10_000)
    """Updates by Dogleg steps with QR after trouble, before the fast solver gets another try."""


class StartConfig(Section):
    """Start at rest or in motion."""

    between_attempts: float = number(0.25, "s", 0.01, 10.0)
    """Time between two attempts."""
    shortest: float = number(0.9, "s", 0.2, 10.0)
    """Shortest first window of a start in motion: in less time a wrong motion explains the lines
    too often."""
    longest: float = number(2.5, "s", 0.2, 60.0)
    """Longest first window, of a start with weak motion; no longer than the smoother's lag."""
    velocity_sigma: float = number(0.12, "m/s", 1e-3, 1.0)
    """Accepted standard deviation of the velocity at both ends, gravity and biases being unknown:
    a tenth of a walk, and so of the scale."""
    outlier_share: float = number(0.35, "", 0.0, 0.5)
    """Accepted share of sightings that contradict the start: tracks on other edges or things that
    move. On two real cameras a quarter of the tracks miss a straight line by more than 0.4 px; from
    a half on no robust loss holds."""
    confidence: float = number(0.99, "", 0.5, 0.9999)
    """Of the tests of sightings, of rival hypotheses, of whether there is any speed, of biases."""
    velocity: float = number(3.0, "m/s", 0.1, 100.0)
    """Standard deviation of the velocity before the start: of what is carried or flown."""
    tilt: float = number(0.5, "rad", 0.01, 1.5)
    """Standard deviation of the tilt from the mean specific force: 5 m/s^2 of acceleration."""
    gyroscope_bias: float = number(0.1, "rad/s", 1e-4, 1.0)
    """Standard deviation of the gyroscope's bias before the start."""
    accelerometer_bias: float = number(0.3, "m/s^2", 1e-3, 5.0)
    """Standard deviation of the accelerometer's bias before the start: consumer and MAV IMUs have
    up to 0.6."""
    rest_velocity_sigma: float = number(0.01, "m/s", 1e-5, 1.0)
    """Standard deviation of the velocity of a body at rest."""
    rest_gyroscope_sigma: float = number(2e-3, "rad/s", 1e-6, 0.1)
    """Standard deviation of the gyroscope's bias from its mean over a rest."""
    gravity_share: float = number(0.15, "", 0.0, 1.0)
    """The specific force at rest is gravity to this share; in g, or without gravity, it is not."""

    @property
    def bias_sigmas(self) -> FloatArray:
        """Of the IMU's biases before a start, accelerometer (m/s^2) first, (6,)."""
        return np.repeat([self.accelerometer_bias, self.gyroscope_bias], 3)


class IntegrityConfig(Section):
    """Status and covariances of estimates, and when a segment ends."""

    max_speed: float = number(50.0, "m/s", 0.1, 1e3)
    """A faster estimate has diverged."""
    max_gyroscope_bias: float = number(0.5, "rad/s", 1e-3, 10.0)
    """An estimate with a larger bias has diverged."""
    max_accelerometer_bias: float = number(3.0, "m/s^2", 1e-2, 100.0)
    """An estimate with a larger bias has diverged."""
    tracking_velocity_sigma: float = number(0.05, "m/s", 1e-3, 10.0)
    """An estimate is called `tracking` while the standard deviation of its velocity is below this
    along every axis: three of them are a tenth of a walk ..."""
    tracking_position_sigma: float = number(3.0, "m", 1e-3, 1e3)
    """... and that of its position since the segment began below this: half a room."""
    trial_time: float = number(0.7, "s", 0.0, 60.0)
    """How long a start in motion is on trial: at least, and `lost_time` more at most, until lines
    and estimate agree."""
    trial_min_stay: float = number(0.5, "", 0.0, 1.0)
    """Share of its lines that must stay in the graph on trial."""
    misfit_span: float = number(1.01, "s", 0.05, 60.0)
    """Time over which lines are compared with their points: a little over five intervals, so that
    rounding drops none."""
    min_intervals: int = number(5, "", 2, 1000)
    """Fewest intervals between states that are checked."""
    min_observations: int = number(10, "", 1, 10_000)
    """Fewest lines compared with their points, for the share that does not fit."""
    confidence: float = number(0.9999, "", 0.5, 0.999999)
    """Images and IMU disagree where an innovation needs more noise than the figures and the
    innovations before it have shown: the confidence of this F-test. There are 5 states a second."""
    jump_confidence: float = number(0.95, "", 0.5, 0.9999)
    """Biases jump where most lines fit better with a jump: the confidence of this sign test. Of
    fewer than five lines none can tell."""
    innovation_span: float = number(2.5, "s", 0.04, 60.0)
    """How long the IMU carries a state on to predict the one that an innovation is of: its slow
    errors (biases, scale) show, and still are so small that they count as linear."""
    variance_prior: float = number(5.0, "", 3.0, 1e3)
    """Degrees of freedom that the noise figures count for, beside the innovations: one of a
    moving camera has about ten."""
    variance_memory: float = number(5.0, "s", 0.1, 1e4)
    """Time constant with which innovations are forgotten: two spans of them."""
    max_misfit: float = number(0.3, "", 0.001, 1.0)
    """Share from which lines and estimate disagree; blurred flights reach 0.28."""
    agreed_misfit: float = number(0.2, "", 0.001, 1.0)
    """Share below which they agree again, and agree at the end of a start's trial."""
    lost_misfit: float = number(0.5, "", 0.001, 1.0)
    """Share from which the estimate is lost at once: no robust loss holds from a half on ..."""
    lost_time: float = number(1.0, "s", 0.0, 60.0)
    """... or when lines and estimate have disagreed for so long."""
    min_lines: int = number(2, "", 1, 100)
    """With fewer lines in view the IMU alone carries the estimate ..."""
    lines_missing_time: float = number(0.3, "s", 0.0, 60.0)
    """... when it is so for longer than this."""
    parallel_spread: float = number(0.02, "", 0.0, 1.0)
    """Lines are parallel when less than this share of their squared directions is across one."""
    parallel_time: float = number(1.0, "s", 0.0, 60.0)
    """How long lines are parallel before the motion along them counts as unknown."""
    gap_velocity_time: float = number(0.5, "s", 0.01, 60.0)
    """Time constant with which a velocity is forgotten between two segments."""
    gap_acceleration: float = number(1.0, "m/s^2", 0.0, 100.0)
    """Standard deviation of the acceleration in a gap between two segments."""
    gap_rotation_rate: float = number(0.3, "rad/s", 0.0, 10.0)
    """Standard deviation of the turn about the vertical in such a gap."""


class RestConfig(Section):
    """When body and image rest, and what is concluded from it."""

    duration: float = number(0.4, "s", 0.05, 10.0)
    """How long rest must last."""
    image_motion_px: float = number(0.4, "px", 0.0, 10.0)
    """Lines move across themselves by less at rest, their median."""
    min_lines: int = number(3, "", 1, 100)
    """Fewer lines say nothing of whether the image moves."""
    velocity_sigma: float = number(0.005, "m/s", 1e-6, 1.0)
    """Standard deviation of the velocity of a state at rest. A body whose velocity by the IMU
    changes by more than three of them does not rest."""
    pose_sigma: float = number(3e-3, "rad, m", 1e-6, 1.0)
    """Standard deviation of the motion since the first state of a rest. A body that turns by more
    than three of them, by the IMU, does not rest."""
    settle_time: float = number(0.15, "s", 0.0, 10.0)
    """States closer to the end of a rest get no such factors: they may have begun to move."""
    confidence: float = number(0.95, "", 0.5, 0.9999)
    """A rest that the IMU denies goes on where lines that have not moved say so: of this test of
    rival hypotheses."""
    solve_interval: float = number(0.8, "s", 0.01, 60.0)
    """At rest the window is solved, and new lines are looked for, this often ..."""
    unmoved_px: float = number(0.2, "px", 0.0, 10.0)
    """... while the image has moved less than this since."""
    slide_warning: float = number(0.03, "m", 0.0, 10.0)
    """An estimate that moves so far at rest is worth a warning."""

    @property
    def max_undecided_time(self) -> float:
        """How long it may be undecided whether a rest that the IMU denies goes on, s: twice as long
        as the IMU needs to show one.
        """
        return 2.0 * self.duration


class Config(Section):
    """Everything."""

    edges: EdgesConfig = EdgesConfig()
    tracks: TracksConfig = TracksConfig()
    lines: LinesConfig = LinesConfig()
    map: MapConfig = MapConfig()
    window: WindowConfig = WindowConfig()
    start: StartConfig = StartConfig()
    time_offset: TimeOffsetConfig = TimeOffsetConfig()
    extrinsics: ExtrinsicsConfig = ExtrinsicsConfig()
    intrinsics: IntrinsicsConfig = IntrinsicsConfig()
    integrity: IntegrityConfig = IntegrityConfig()
    rest: RestConfig = RestConfig()
    imu: ImuConfig = ImuConfig()

    def for_time_offset(self, exact: bool) -> Self:
        """These settings for a calibration whose time offset is exact, or not."""
        estimate = self.time_offset.estimate and not exact
        time_offset = self.time_offset.model_copy(update={"estimate": estimate})
        return self.model_copy(update={"time_offset": time_offset})

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        lag = self.window.lag
        for fits, wrong in (
            (4.0 * self.window.state_interval <= lag, "hold 4 times window.state_interval"),
            (self.tracks.min_track_age < lag, "exceed tracks.min_track_age"),
        ):
            if not fits:
                raise ValueError(f"window.lag must {wrong}: change both, or neither")
        return self


DEFAULTS = Config()
"""For what is used without settings of its own."""
