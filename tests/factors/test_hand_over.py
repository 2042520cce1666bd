# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest

from ruledgraph_factors.jacobians import hand_over


@pytest.mark.parametrize("order", ["C", "F"])
def test_every_key_gets_its_own_block(order):
    """As GTSAM calls: with as many empty matrices as there are keys, anew each time."""
    rng = np.random.default_rng(0)
    called = []
    for _ in range(3):
        whole = np.array(rng.normal(size=(12, 22)), order=order)
        blocks = [whole[:, :6], whole[:, 6:9], whole[:, 18:22]]
        H = gtsam.JacobianVector([np.zeros((0, 0))] * 3)
        hand_over(H, blocks)
        called.append((H, blocks))
    # Also those of earlier calls: they share no memory.
    for H, blocks in called:
        assert len(H) == 3
        for mine, block in zip(H, blocks, strict=True):
            np.testing.assert_array_equal(mine, block)


def test_a_list_of_jacobians_works_as_well():
    blocks = [np.ones((3, 6)), np.full((3, 4), 2.0)]
    H = [np.zeros((0, 0))] * 2
    hand_over(H, blocks)
    for mine, block in zip(H, blocks, strict=True):
        np.testing.assert_array_equal(mine, block)
