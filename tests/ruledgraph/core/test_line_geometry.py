# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in space and the rays of a camera."""

import numpy as np
from scipy.optimize import minimize

from ruledgraph.core.line_geometry import closest_to_rays


def unit_vectors(rng, *shape):
    vectors = rng.normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_it_minimizes_the_distance():
    rng = np.random.default_rng(0)
    foot, centre = rng.normal(size=(2, 5, 3))
    unit, rays = unit_vectors(rng, 5), rng.normal(size=(5, 2, 3))
    found = closest_to_rays(foot, unit, centre, rays)
    for i, m in np.ndindex(found.shape):

        def distance2(x, i=i, m=m):
            s, t = x
            return np.sum((foot[i] + s * unit[i] - centre[i] - t * rays[i, m]) ** 2)

        best = minimize(distance2, [0.0, 0.0], tol=1e-12)
        # The minimizer's own: it has numerical derivatives.
        np.testing.assert_allclose(found[i, m], best.x[0], atol=1e-5)


def test_one_line_against_many_cameras():
    rng = np.random.default_rng(1)
    foot, unit = rng.normal(size=3), unit_vectors(rng)
    centres, along = rng.normal(size=(7, 3)), rng.normal(size=(7, 2))
    rays = foot + along[..., None] * unit - centres[:, None]
    np.testing.assert_allclose(closest_to_rays(foot, unit, centres, rays), along, atol=1e-12)


def test_a_parallel_ray_meets_it_nowhere():
    unit = np.array([0.0, 0.0, 1.0])
    rays = np.array([[0.0, 0.0, 2.0], [0.0, 1.0, 1.0]])
    s = closest_to_rays(np.zeros(3), unit, np.array([0.0, -1.0, 0.0]), rays)
    np.testing.assert_array_equal(np.isnan(s), [True, False])
    np.testing.assert_allclose(s[1], 1.0, rtol=1e-12)
