# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Pinhole cameras with distortion, and wide-angle lenses: rays to pixels and back."""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ruledgraph.calibration.wide_angle import (
    WIDE_ANGLE,
    magnification,
    parameter_fault,
    project,
    unproject,
)
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError

DistortionModel = Literal["none", "radtan", "equidistant", "omni", "eucm", "ds"]
_COEFFICIENTS: dict[str, tuple[int, ...]] = {
    "none": (0,),
    "radtan": (4, 5),
    "equidistant": (4,),
    "omni": (1, 5),
    "eucm": (2,),
    "ds": (2,),
}
# Newton's iteration on the distortion stops here (normalised units, 1e-7 px at 1,000 px focal
# length) or gives up after so many steps.
_CONVERGED = 1e-10
_MAX_STEPS = 50


class Distorted(NamedTuple):
    """Pixels (N, 2) and their derivative in the normalised coordinates (N, 2, 2)."""

    pixels: FloatArray
    jacobian: FloatArray


@dataclass(frozen=True)
class CameraModel:
    """Pinhole camera with distortion; pixel (0, 0) is the centre of the top left pixel.

    Normalised coordinates (x, y) = (X/Z, Y/Z) map to pixels by the distortion d, then
    u = fx d_x + cx, v = fy d_y + cy. Distortion models and the order of the coefficients are
    Kalibr's and OpenCV's: `radtan` (k1, k2, p1, p2[, k3]), Brown 1966; `equidistant` (k1..k4),
    Kannala and Brandt 2006; of the wide-angle models in `wide_angle`: `omni` (xi[, k1, k2, p1,
    p2]), with `radtan` after it, `eucm` (alpha, beta), `ds` (xi, alpha).

    Raises:
        RuledgraphError: for a size or focal length that is not positive, a number that is not
            finite, an unknown model or the wrong number of coefficients.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: DistortionModel = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        # Of any sequence: a camera has to be hashable.
        object.__setattr__(self, "coefficients", tuple(map(float, self.coefficients)))
        if self.width < 1 or self.height < 1:
            raise RuledgraphError(f"image size {self.width}x{self.height} is not positive")
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.coefficients)
        if not np.all(np.isfinite(numbers)):
            raise RuledgraphError(f"camera parameters {numbers} are not all finite")
        if self.fx <= 0.0 or self.fy <= 0.0:
            raise RuledgraphError(f"focal lengths {self.fx}, {self.fy} are not positive")
        if self.distortion not in _COEFFICIENTS:
            raise RuledgraphError(
                f"unknown distortion model {self.distortion!r}; "
                f"use one of {', '.join(_COEFFICIENTS)}"
            )
        if len(self.coefficients) not in _COEFFICIENTS[self.distortion]:
            wanted = " or ".join(map(str, _COEFFICIENTS[self.distortion]))
            raise RuledgraphError(
                f"distortion model {self.distortion} takes {wanted} coefficients, "
                f"got {len(self.coefficients)}"
            )

        if fault := parameter_fault(self.distortion, self.coefficients):
            raise RuledgraphError(fault)

    def with_focal_ratio(self, ratio: float) -> "CameraModel":
        """The same with focal lengths `ratio` times as long."""
        return replace(self, fx=self.fx * ratio, fy=self.fy * ratio)

    @property
    def focal_length(self) -> float:
        """Px: converts pixels to normalised units near the image centre; of a pinhole the mean of
        fx and fy.
        """
        mean = 0.5 * (self.fx + self.fy)
        if self.distortion in WIDE_ANGLE:
            return mean * magnification(self.distortion, self.coefficients)
        return mean

    def bent_by(self, ratio: float) -> "CameraModel":
        """The same with the distortion of a camera whose focal length is `ratio` times as long:
        q = ratio d^-1((u - c) / (ratio f)), near the centre (u - c) / f as before.

        For `radtan`, which stays one. Other models stay as they are.
        """
        if self.distortion != "radtan":
            return self
        powers = (2, 4, 1, 1, 6)  # of k1, k2, p1, p2, k3
        bent = (c / ratio**n for c, n in zip(self.coefficients, powers, strict=False))
        return replace(self, coefficients=tuple(bent))

    def distort(self, normalised: ArrayLike) -> Distorted:
        """Pixels of normalised coordinates (N, 2), and the derivative."""
        xy = np.asarray(normalised, dtype=np.float64)
        if self.distortion == "radtan":
            d, jacobian = _radtan(xy, self.coefficients)
        elif self.distortion == "equidistant":
            d, jacobian = _equidistant(xy, self.coefficients)
        elif self.distortion in WIDE_ANGLE:
            d, jacobian = project(self.distortion, xy, self.coefficients)
            if self.distortion == "omni" and len(self.coefficients) > 1:
                d, bent = _radtan(d, self.coefficients[1:])
                jacobian = bent @ jacobian
        else:
            d, jacobian = xy, np.tile(np.eye(2), (len(xy), 1, 1))
        focal = np.array([self.fx, self.fy])
        return Distorted(d * focal + [self.cx, self.cy], jacobian * focal[:, None])

    def undistort(self, pixels: ArrayLike, near: FloatArray | None = None) -> FloatArray:
        """Normalised coordinates of pixels, (N, 2); NaN where the model has no solution.

        Newton's method on `distort`, from `near` (N, 2) if given: a guess saves steps.
        """
        uv = np.asarray(pixels, dtype=np.float64)
        target = (uv - [self.cx, self.cy]) / [self.fx, self.fy]
        if self.distortion == "none":
            return np.asarray(target)
        xy = target.copy() if near is None else near
        if near is None and self.distortion == "equidistant":
            # From the undistorted fisheye: the angle is the distance from the centre.
            angle = np.linalg.norm(target, axis=1, keepdims=True)
            xy *= np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-12)
        elif near is None and self.distortion in WIDE_ANGLE:
            if self.distortion == "omni" and len(self.coefficients) > 1:
                lens = replace(self, distortion="radtan", coefficients=self.coefficients[1:])
                target = lens.undistort(uv)
            xy = unproject(self.distortion, target, self.coefficients)
        scale = np.array([self.fx, self.fy])
        error = np.full_like(uv, np.inf)
        for _ in range(_MAX_STEPS):
            distorted = self.distort(xy)
            error = (distorted.pixels - uv) / scale
            if np.nanmax(np.abs(error), initial=0.0) < _CONVERGED:
                break
            J = distorted.jacobian / scale[:, None]
            determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                # Where the distortion folds over, there is no inverse.
                determinant = np.where(determinant > 1e-9, determinant, np.nan)
                step_x = (J[:, 1, 1] * error[:, 0] - J[:, 0, 1] * error[:, 1]) / determinant
                step_y = (J[:, 0, 0] * error[:, 1] - J[:, 1, 0] * error[:, 0]) / determinant
            xy = xy - np.stack([step_x, step_y], axis=1)
        with np.errstate(invalid="ignore"):
            failed = ~(np.abs(error).max(axis=1, initial=0.0) < _CONVERGED)
        return np.asarray(np.where(failed[:, None], np.nan, xy))

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels (N, 2) of points in the camera frame, (N, 3), m, which must lie in front of it."""
        in_cam = np.asarray(points, dtype=np.float64)
        return self.distort(in_cam[:, :2] / in_cam[:, 2:]).pixels


def _radtan(xy: FloatArray, coefficients: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    k1, k2, p1, p2, k3 = (*coefficients, 0.0)[:5]
    x, y = xy[:, 0], xy[:, 1]
    xx, yy, xy_ = x * x, y * y, x * y
    r2 = xx + yy
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d r2, times 2
    d = np.stack(
        [
            x * radial + 2.0 * p1 * xy_ + p2 * (r2 + 2.0 * xx),
            y * radial + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * xy_,
        ],
        axis=1,
    )
    jacobian = np.empty((len(xy), 2, 2))
    jacobian[:, 0, 0] = radial + xx * slope + 2.0 * p1 * y + 6.0 * p2 * x
    jacobian[:, 1, 1] = radial + yy * slope + 6.0 * p1 * y + 2.0 * p2 * x
    jacobian[:, 0, 1] = jacobian[:, 1, 0] = xy_ * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return d, jacobian


def _equidistant(xy: FloatArray, coefficients: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    k1, k2, k3, k4 = coefficients
    r = np.linalg.norm(xy, axis=1)
    theta = np.arctan(r)
    t2 = theta * theta
    bent = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
    safe = np.maximum(r, 1e-9)
    scale = np.where(r > 1e-9, bent / safe, 1.0)
    # d = scale(r) xy; along the radius the derivative is d bent / d r, across it is the scale.
    radial = slope / (1.0 + r * r)
    unit = xy / safe[:, None]
    outer = unit[:, :, None] * unit[:, None, :]
    jacobian = scale[:, None, None] * np.eye(2) + (radial - scale)[:, None, None] * outer
    return xy * scale[:, None], jacobian
