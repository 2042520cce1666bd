# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ factors for a GTSAM of the user's own, `factors/src/gtsam_module.cpp`: internal.

Not a part of any wheel; `native_factor` imports it, CPP.md says how to build it.
"""

from collections.abc import Mapping

import gtsam

from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray, IntArray

class RuledSurfaceFactor(gtsam.NoiseModelFactor):
    """`ruledgraph::RuledSurfaceFactor` or, of the forms "pose…", `RuledSurfacePoseFactor`."""

    @property
    def spec(self) -> RuledSurfaceSpec:
        """What it was built from; copies with other keys or noise have that of the original."""

def native_factor(
    spec: RuledSurfaceSpec, arrays: Mapping[str, FloatArray | IntArray]
) -> RuledSurfaceFactor:
    """The factor of a spec and its `_arrays()`."""
