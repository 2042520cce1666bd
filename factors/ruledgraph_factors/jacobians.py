# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How the callback of a `gtsam.CustomFactor` hands over its Jacobians."""

from collections.abc import MutableSequence, Sequence
from functools import lru_cache

import gtsam
import numpy as np

from ruledgraph_factors.validation import FloatArray


def hand_over(
    H: "MutableSequence[FloatArray] | gtsam.JacobianVector", blocks: Sequence[FloatArray]
) -> None:
    """Set the Jacobians that GTSAM asks for, `H[i] = blocks[i]` for every key.

    `H[i] = ...` converts a numpy matrix, which takes longer than all the arithmetic of a factor.
    Matrices of GTSAM's own are copied at once, and those in `H` can be written to in place.
    """
    if not isinstance(H, gtsam.JacobianVector):
        H[:] = blocks
        return
    H[:] = _zeros(*(block.shape for block in blocks))
    for i, block in enumerate(blocks):
        H[i][...] = block


@lru_cache(maxsize=256)
def _zeros(*shapes: tuple[int, ...]) -> gtsam.JacobianVector:
    return gtsam.JacobianVector([np.zeros(shape) for shape in shapes])
