# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.core.config import TracksConfig
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.flow_prediction import expected_rates
from ruledgraph.frontend.track import Track

REACH = 0.3
CONFIG = TracksConfig()


def track(ends, flow=(0.0, 0.0)) -> Track:
    """Moving with a flow, px/s, the same at both ends."""
    ends = np.asarray(ends, dtype=float)
    rate = float(normal_of(ends) @ np.asarray(flow))
    return Track(id=0, first_time=0.0, ends=ends, slope=5.0, rates=(rate, rate))


def upright(x: float) -> np.ndarray:
    return np.array([[x, -0.1], [x, 0.1]])


def test_a_track_beside_others_moves_as_they_do():
    flow = 40.0, -30.0
    level = [[-0.1, 0.02], [0.1, 0.02]]
    followed = [track(upright(-0.02), flow), track(upright(0.02), flow), track(level, flow)]
    new = track(upright(0.0))
    rates, deviations = expected_rates([new], followed, REACH, CONFIG)
    wanted = normal_of(new.ends) @ flow
    # Drawn towards none by the noise of neighbours, and no less certain than one of them.
    np.testing.assert_allclose(rates, wanted, rtol=0.1)
    assert np.all(deviations < 2.0 * CONFIG.flow_noise * np.abs(wanted))


def test_far_from_all_others_nothing_is_known_but_the_size():
    followed = [track(upright(-0.9), (50.0, 0.0)), track(upright(-1.0), (50.0, 0.0))]
    rates, deviations = expected_rates([track(upright(1.0))], followed, REACH, CONFIG)
    np.testing.assert_allclose(rates, 0.0, atol=1e-3)
    np.testing.assert_allclose(deviations, 50.0 * np.hypot(1.0, CONFIG.flow_noise), rtol=1e-3)


def test_a_track_says_nothing_of_the_motion_along_itself():
    level = [[-0.1, 0.0], [0.1, 0.0]]
    rates, deviations = expected_rates(
        [track(upright(0.0))], [track(level, (50.0, 20.0))], REACH, CONFIG
    )
    np.testing.assert_allclose(rates, 0.0, atol=1e-9)
    np.testing.assert_allclose(deviations, 20.0 * np.hypot(1.0, CONFIG.flow_noise), rtol=1e-9)


@pytest.mark.parametrize("reach", [0.1, 0.5])
def test_flows_of_that_kind_are_within_their_deviations(reach):
    """Drawn from the process, by its definition, at the ends of twelve followed and a new track."""
    rng = np.random.default_rng(0)
    normalised = []
    for _ in range(200):
        middles = rng.uniform(-0.5, 0.5, size=(13, 1, 2))
        angles = rng.uniform(0.0, np.pi, size=13)
        half = 0.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
        tracks = [track(ends) for ends in np.concatenate([middles - half, middles + half], axis=1)]
        at = np.concatenate([one.ends for one in tracks])
        squares = np.sum((at[:, None] - at) ** 2, axis=2)
        root = np.linalg.cholesky(np.exp(-0.5 * squares / reach**2) + 1e-9 * np.eye(len(at)))
        flows = 60.0 * root @ rng.normal(size=(len(at), 2))
        noise = rng.normal(scale=60.0 * CONFIG.flow_noise, size=len(at))
        normals = np.repeat([normal_of(one.ends) for one in tracks], 2, axis=0)
        rates = (np.sum(flows * normals, axis=1) + noise).reshape(-1, 2)
        for one, own in zip(tracks, rates.tolist(), strict=True):
            one.rates = own[0], own[1]
        found, deviations = expected_rates(tracks[:1], tracks[1:], reach, CONFIG)
        normalised.append(((rates[0] - found) / deviations).ravel())
    # The size is estimated from 24 rates that depend on each other: some tens of percent.
    assert 0.7 < np.mean(np.square(normalised)) < 1.4
