# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude by gravity."""

import numpy as np
import pytest

from ruledgraph_factors import FactorError, level_attitude


@pytest.mark.parametrize("up", [[0.1, 0.2, 9.8], [-3.0, 9.0, 0.5], [9.81, 0.0, 0.0], [0, -1, 0]])
def test_up_turns_to_z_and_an_axis_is_level(up: list[float]) -> None:
    world_R_body = level_attitude(up).matrix()
    np.testing.assert_allclose(world_R_body @ up, [0.0, 0.0, np.linalg.norm(up)], atol=1e-12)
    level = 1 if abs(up[0]) > 0.9 * np.linalg.norm(up) else 0
    # The world's x axis is the body's, made level: it has no part across it.
    assert world_R_body[1, level] == pytest.approx(0.0, abs=1e-12)
    assert world_R_body[0, level] > 0.0


def test_nothing_shows_no_direction() -> None:
    with pytest.raises(FactorError, match="up is zero"):
        level_attitude([0.0, 0.0, 0.0])
