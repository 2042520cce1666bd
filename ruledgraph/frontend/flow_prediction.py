# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How a new track will move, by those that are followed already.

Each followed track shows one component of the image's motion (the flow, rotation taken off) at both
of its ends: that across itself. The flow is taken for a Gaussian process in the image, its size by
the tracks themselves, so that what is not known yet has a deviation, too:

    E[u(p) u(q)^T] = s^2 exp(-|p - q|^2 / (2 r^2)) I,    rate_i = n_i . u(p_i) + noise.

Source: Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, eq. 2.25 and 2.26.
"""

from collections.abc import Sequence

import numpy as np

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import TracksConfig
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.track import Track


def expect_motion(
    started: Sequence[Track],
    tracks: Sequence[Track],
    elapsed: float,
    camera: CameraModel,
    config: TracksConfig,
) -> None:
    """Give new tracks the rates and deviations that those whose motion was seen suggest, if there
    are any; `elapsed` is the time between frames, s.
    """
    followed = [track for track in tracks if track.misses == 0 and any(track.rates)]
    if not started or not followed:
        return
    reach = config.flow_reach * camera.width / camera.focal_length
    rates, deviations = expected_rates(started, followed, reach, config)
    for track, (first, second), sigmas in zip(started, rates.tolist(), deviations, strict=True):
        track.rates = first, second
        sigma = float(np.hypot(config.min_sigma_px, elapsed * sigmas.max()))
        track.sigma = min(sigma, config.max_sigma_px)


def expected_rates(
    fresh: Sequence[Track], followed: Sequence[Track], reach: float, config: TracksConfig
) -> tuple[FloatArray, FloatArray]:
    """Rates of new tracks at both ends and their deviations, both (N, 2), px/s; r is `reach`,
    normalised.
    """
    own, own_normals = _ends(fresh)
    known, normals = _ends(followed)
    rates = np.array([track.rates for track in followed]).ravel()
    size = float(np.mean(rates**2))
    covariance = size * _correlation(known, normals, known, normals, reach)
    covariance.flat[:: len(rates) + 1] += size * config.flow_noise**2
    across = size * _correlation(own, own_normals, known, normals, reach)
    weights = np.linalg.solve(covariance, across.T).T
    variance = size - np.sum(weights * across, axis=1)
    deviation = np.sqrt(np.maximum(variance, 0.0) + size * config.flow_noise**2)
    return (weights @ rates).reshape(-1, 2), deviation.reshape(-1, 2)


def _ends(tracks: Sequence[Track]) -> tuple[FloatArray, FloatArray]:
    """Of tracks, (2 N, 2), and the normals there."""
    ends = np.array([track.ends for track in tracks]).reshape(-1, 2, 2)
    return ends.reshape(-1, 2), np.repeat(normal_of(ends), 2, axis=0)


def _correlation(
    p: FloatArray, p_normals: FloatArray, q: FloatArray, q_normals: FloatArray, reach: float
) -> FloatArray:
    squares = np.sum((p[:, None] - q) ** 2, axis=2)
    return np.asarray(np.exp(-0.5 * squares / reach**2) * (p_normals @ q_normals.T))
