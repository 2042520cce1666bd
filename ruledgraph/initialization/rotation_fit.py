# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The rotations of a camera by the gyroscope, fitted to those of its images.

Least squares in the time offset, the gyroscope's bias and the mounting; see `time_offset_finder`.
"""

import cv2
import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.image_rotation import (
    PointPairs,
    RotationEvidence,
    epipolar_error,
    rotation_evidence,
)
from ruledgraph.initialization.row_delays import at_middle_row, gyroscope_angles
from ruledgraph_factors import ImuSamples

PARAMETERS = 7
"""Of the offset (s), the bias (rad/s) and the mounting (rad)."""
MIN_RATE_VARIATION = 0.05
"""`rate_variation` without which nothing can be said, rad/s."""
# Of the derivative by the offset, s.
_DIFFERENCE = 0.004
# Standard deviation of a calibrated mounting's rotation, per axis, rad.
_MOUNTING = np.radians(1.0)
# Of Gauss-Newton, reweighted: further ones would move a simulated recording's bias and mounting by
# 0.2 to 0.5 standard deviations.
_STEPS = 2


def body_rotations(pairs: PointPairs, samples: ImuSamples, offset: float) -> FloatArray:
    """What the gyroscope says of the body's rotations between the images of pairs, (P, 3), rad."""
    times, angles = np.asarray(samples.times), gyroscope_angles(samples)
    ends = [
        np.stack([np.interp(t + offset, times, angle) for angle in angles.T], axis=1)
        for t in pairs.times.T
    ]
    return np.asarray(ends[1] - ends[0])


def rate_variation(pairs: PointPairs, samples: ImuSamples, offset: float) -> float:
    """How much the gyroscope's rate changes from pair to pair, root mean square, rad/s."""
    rates = body_rotations(pairs, samples, offset) / np.diff(pairs.times, axis=1)
    return float(np.sqrt(np.sum(np.var(rates, axis=0))))


class LinearFit:
    """Least squares in offset, bias and mounting, about some of these: (7,), s, rad/s, rad."""

    def __init__(
        self,
        parameters: FloatArray,
        evidence: RotationEvidence,
        jacobian: FloatArray,
        prior: FloatArray,
    ) -> None:
        self.parameters, self.evidence = parameters, evidence
        g, information = evidence.gradient, evidence.information
        # What the pairs' own best rotations leave, of all that is left.
        small = 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        own = np.einsum("pi,pi->", g, np.linalg.solve(information + small, g[..., None])[..., 0])
        self.variance = float(own) / (3 * len(g) - PARAMETERS)
        self._H = np.einsum("pji,pjk,pkl->il", jacobian, information, jacobian) / self.variance
        self._H += np.diag(prior)
        self._g = np.einsum("pji,pj->i", jacobian, g) / self.variance - prior * parameters

    def solution(self) -> FloatArray:
        """The parameters of least squares."""
        return np.asarray(self.parameters + np.linalg.solve(self._H, self._g))

    def solution_at_offset(self) -> FloatArray:
        """The best bias and mounting with the offset held fixed."""
        rest = np.linalg.solve(self._H[1:, 1:], self._g[1:])
        return np.asarray(self.parameters + np.concatenate([[0.0], rest]))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations, (7,)."""
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(self._H))))


class RotationFit:
    """Pairs of images, the gyroscope's samples, and how they go together."""

    def __init__(
        self,
        pairs: PointPairs,
        samples: ImuSamples,
        calibration: Calibration,
        bias_sigma: float,
    ) -> None:
        self._pairs, self._samples, self._calibration = pairs, samples, calibration
        self._cam_R_body = calibration.body_T_cam.rotation().matrix().T
        self._focal = calibration.camera.focal_length
        self._lengths = np.diff(pairs.times, axis=1)
        known = np.concatenate([[np.inf], np.repeat([bias_sigma, _MOUNTING], 3)])
        self._prior = 1.0 / known**2

    def rotations(self, parameters: FloatArray) -> FloatArray:
        """Turns of the pairs, w, (P, 3)."""
        in_body = body_rotations(self._pairs, self._samples, float(parameters[0]))
        in_cam = (in_body - self._lengths * parameters[1:4]) @ self._cam_R_body.T
        return np.asarray(in_cam @ cv2.Rodrigues(parameters[4:])[0])

    def evidence(self, parameters: FloatArray) -> RotationEvidence:
        """Of the pairs at the rotations of these parameters."""
        pairs = self._pairs_at(float(parameters[0]))
        return rotation_evidence(pairs, self.rotations(parameters), self._focal)

    def _pairs_at(self, offset: float) -> PointPairs:
        """As a global shutter would have seen them, if this is the offset, s."""
        if not self._calibration.readout:
            return self._pairs
        return at_middle_row(self._pairs, self._samples, self._calibration, offset)

    def best_at(self, offset: float) -> FloatArray:
        """The parameters with this offset and the best bias and mounting."""
        parameters = np.concatenate([[offset], np.zeros(6)])
        for _ in range(_STEPS):
            parameters = self.linearized(parameters).solution_at_offset()
        return parameters

    def profile(self, offsets: FloatArray) -> FloatArray:
        """Costs of the pairs for N offsets, (N, P)."""
        return np.array([self.evidence(self.best_at(offset)).costs for offset in offsets])

    @property
    def no_rotation_cost(self) -> float:
        """Of all pairs if the camera did not turn."""
        still = np.zeros((len(self._lengths), 3))
        return float(rotation_evidence(self._pairs, still, self._focal).costs.sum())

    def error(self, parameters: FloatArray) -> float:
        """How far points miss the gyroscope's rotations, see `epipolar_error`, px."""
        pairs = self._pairs_at(float(parameters[0]))
        return epipolar_error(pairs, self.rotations(parameters), self._focal)

    def linearized(self, parameters: FloatArray) -> LinearFit:
        """About these parameters."""
        rotations = self.rotations(parameters)
        step = np.array([0.5 * _DIFFERENCE, *np.zeros(6)])
        by_offset = (
            self.rotations(parameters + step) - self.rotations(parameters - step)
        ) / _DIFFERENCE
        by_bias = -self._lengths[..., None] * (cv2.Rodrigues(-parameters[4:])[0] @ self._cam_R_body)
        x, y, z = rotations.T
        o = np.zeros_like(x)
        by_mounting = np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)
        J = np.concatenate([by_offset[..., None], by_bias, by_mounting], axis=2)
        evidence = self.evidence(parameters)
        return LinearFit(parameters, evidence, J, self._prior)
