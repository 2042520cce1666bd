# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The native kernel, `factors/src/native.cpp`: internal, called by this package alone.

All arrays are float64 and, where they have rows, C-contiguous. Sizes that do not fit together raise
ValueError; types and shapes that do not fit the signature raise TypeError.
"""

from collections.abc import Sequence

from ruledgraph_factors.validation import FloatArray, IntArray

class Geometry:
    """What brings a line into the cameras of n frames; as `ruled_surface.Geometry`."""

    def __init__(
        self,
        world_T_anchor: FloatArray,
        basis: FloatArray,
        angle: float,
        body_T_cam: FloatArray,
        elapsed: FloatArray,
        preintegrated: FloatArray,
        bias_jacobian: FloatArray,
        bias: FloatArray,
        time_jacobian: FloatArray | None,
    ) -> None:
        """Take a `LineChart` and the extrinsic, poses as (4, 4), and a `FrameMotion`'s arrays."""

class _Surface:
    def evaluate(
        self,
        world_T_body: FloatArray,
        velocity: FloatArray,
        bias: FloatArray,
        gravity: FloatArray,
        line: FloatArray,
        time_shift: float,
        body_T_cam: FloatArray | None,
        focal_ratio: float | None,
        residual: FloatArray,
        jacobian: FloatArray | None,
    ) -> None:
        """Write the residual (rows,) at a state and, unless None, its Jacobian (rows, 22), with one
        column more when there is a `time_jacobian`, six more with `body_T_cam`, and one more with
        `focal_ratio`.

        The state is that of `ruled_surface.State`. `jacobian` has Fortran order.
        """

    def fit_line(
        self,
        world_T_body: FloatArray,
        velocity: FloatArray,
        bias: FloatArray,
        gravity: FloatArray,
        starts: list[FloatArray],
        information: float,
        prior: FloatArray,
        descents: int,
    ) -> tuple[FloatArray, float, FloatArray]:
        """As `line_fit.fit_line_in_numpy`."""

class GeometricSurface(_Surface):
    """As `ruled_surface.geometric_residual`."""

    def __init__(self, geometry: Geometry, statistics: FloatArray) -> None:
        """Take the statistics (n, 3, 3) of `GeometricPoints`."""

class ReprojectionSurface(_Surface):
    """As `ruled_surface.reprojection_residual`."""

    def __init__(
        self, geometry: Geometry, points: FloatArray, sqrt_weights: FloatArray, frame: IntArray
    ) -> None:
        """Take the three arrays of `ReprojectionPoints`."""

def plucker(
    world_T_anchor: FloatArray, basis: FloatArray, angle: float, delta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """As `LineChart.plucker`; the anchor is (4, 4)."""

def line_angle(
    world_T_anchor: FloatArray,
    basis: FloatArray,
    angle: float,
    delta: FloatArray,
    world_T_body: FloatArray,
) -> tuple[float, FloatArray, FloatArray]:
    """As `line_distance.line_angle_in_numpy`; poses are (4, 4)."""

def triangulate_line(
    world_T_cams: FloatArray, statistics: FloatArray, sigma: float
) -> tuple[FloatArray, float, FloatArray, float, int, str]:
    """As `triangulation.triangulate_line_in_numpy`, from poses (n, 4, 4) and the statistics
    (n, 3, 3) of `GeometricPoints`: basis and angle of the chart, covariance, rms, which of
    `triangulation.STATUSES`, and the reason.
    """

def robust_lines(
    surfaces: Sequence[_Surface],
    precision: float,
    chunk: int,
    scales: FloatArray,
    world_T_body: FloatArray,
    velocity: FloatArray,
    bias: FloatArray,
    gravity: FloatArray,
    time_shift: float,
    lines: FloatArray,
    losses: FloatArray,
    information: FloatArray | None,
    gradient: FloatArray | None,
) -> None:
    """Write what `robust_lines.RobustLines` says of N lines at deltas (N, 4): losses (N,) and,
    unless None, information (N, n, n) and gradient (N, n).

    `surfaces` are `GeometricSurface`; `scales` are those of all chunks, line after line;
    `precision` is one over sigma.
    """

def compress(points: FloatArray, sqrt_weights: FloatArray, counts: IntArray) -> FloatArray:
    """As `observations.compress_in_numpy`."""

def segments(
    times: FloatArray, force: FloatArray, rate: FloatArray, breaks: list[float], bias: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `integration.segments_in_numpy`."""

def integrate(
    force: FloatArray, rate: FloatArray, dt: FloatArray, delta: FloatArray, d_bias: FloatArray
) -> int:
    """As `integration.integrate_in_numpy`."""
