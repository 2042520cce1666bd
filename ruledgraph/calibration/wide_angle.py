# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Camera models whose lens is not a pinhole's: omni, EUCM and double sphere, as Kalibr names them.

Each takes a point P = (x, y, 1) of normalised coordinates, r^2 = x^2 + y^2, to m = (x, y) / h(r^2):

- `omni` (xi): the unit sphere seen from xi behind its centre, h = 1 + xi sqrt(r^2 + 1); Mei and
  Rives, ICRA 2007;
- `eucm` (alpha, beta): h = alpha sqrt(beta r^2 + 1) + 1 - alpha; Khomutenko, Garcia and Martinet,
  RA-L 2016;
- `ds` (xi, alpha): h = alpha sqrt(r^2 + k^2) + (1 - alpha) k, k = xi sqrt(r^2 + 1) + 1; Usenko,
  Demmel and Cremers, 3DV 2018.

Only what lies in front of the camera, z > 0, has normalised coordinates.
"""

import numpy as np

from ruledgraph.core.arrays import FloatArray

WIDE_ANGLE = ("omni", "eucm", "ds")


def parameter_fault(model: str, parameters: tuple[float, ...]) -> str:
    """What is wrong with a model's own parameters, empty if nothing is."""
    if model == "omni" and not 0.0 <= parameters[0] <= 10.0:
        return f"xi = {parameters[0]:g} of omni is not within 0 to 10"
    if model == "eucm" and not (0.0 <= parameters[0] <= 1.0 and parameters[1] > 0.0):
        return f"alpha, beta = {parameters} of eucm: alpha lies within 0 to 1, beta is positive"
    if model == "ds" and not (-1.0 < parameters[0] < 1.0 and 0.0 <= parameters[1] <= 1.0):
        return f"xi, alpha = {parameters} of ds: xi lies between -1 and 1, alpha within 0 to 1"
    return ""


def magnification(model: str, parameters: tuple[float, ...]) -> float:
    """|m| / r at the optical axis."""
    return 1.0 if model == "eucm" else 1.0 / (1.0 + parameters[0])


def project(
    model: str, xy: FloatArray, parameters: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """M (N, 2) of normalised coordinates (N, 2), and the derivative (N, 2, 2)."""
    r2 = np.sum(xy * xy, axis=1)
    if model == "eucm":
        alpha, beta = parameters[:2]
        root = np.sqrt(beta * r2 + 1.0)
        h, slope = alpha * root + 1.0 - alpha, 0.5 * alpha * beta / root
    else:
        xi = parameters[0]
        root = np.sqrt(r2 + 1.0)
        h, slope = xi * root + 1.0, 0.5 * xi / root
        if model == "ds":
            alpha, k, k_slope = parameters[1], h, slope
            outer = np.sqrt(r2 + k * k)
            h = alpha * outer + (1.0 - alpha) * k
            slope = alpha * (0.5 + k * k_slope) / outer + (1.0 - alpha) * k_slope
    # d m = d xy / h - xy (2 slope xy^T d xy) / h^2.
    bend = -2.0 * slope / (h * h)
    jacobian = bend[:, None, None] * xy[:, :, None] * xy[:, None, :]
    jacobian[:, 0, 0] += 1.0 / h
    jacobian[:, 1, 1] += 1.0 / h
    return xy / h[:, None], jacobian


def unproject(model: str, m: FloatArray, parameters: tuple[float, ...]) -> FloatArray:
    """Normalised coordinates of m, (N, 2), in closed form; NaN where there is no point in front."""
    r2 = np.sum(m * m, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        if model == "eucm":
            alpha, beta = parameters[:2]
            root = np.sqrt(1.0 - (2.0 * alpha - 1.0) * beta * r2)
            z = (1.0 - beta * alpha * alpha * r2) / (alpha * root + 1.0 - alpha)
            scale = 1.0 / z
        else:
            xi = parameters[0]
            mz = np.ones_like(r2)
            if model == "ds":
                alpha = parameters[1]
                root = np.sqrt(1.0 - (2.0 * alpha - 1.0) * r2)
                mz = (1.0 - alpha * alpha * r2) / (alpha * root + 1.0 - alpha)
            eta = (mz * xi + np.sqrt(mz * mz + (1.0 - xi * xi) * r2)) / (mz * mz + r2)
            scale = eta / (eta * mz - xi)
        scale = np.where(scale > 0.0, scale, np.nan)
    return np.asarray(m * scale[:, None])
