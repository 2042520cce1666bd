# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Factors that run in C++ alone, for those who build GTSAM themselves; CPP.md has the recipe."""

import gtsam

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.spec import RuledSurfaceSpec


def native_factor(spec: RuledSurfaceSpec) -> gtsam.NoiseModelFactor:
    """The C++ factor that a spec describes, equal to that of `build_factor`.

    GTSAM evaluates it without Python and can clone it: `graph.clone()` works. `spec_of` finds its
    spec again, so that `check_lines` and all the rest see it.

    It needs the module `_gtsam`, built against the very GTSAM that runs. Only the self-test
    (`python -m ruledgraph_factors.gtsam_self_test`) tells whether it is: with another one this
    function may take down the process.

    Raises:
        FactorError: when that module was not built, or does not fit and says so.
    """
    try:
        from ruledgraph_factors import _gtsam
    except ImportError as error:
        raise FactorError(
            f"the C++ factors for Python need a GTSAM of your own, see CPP.md: {error}"
        ) from None
    return _gtsam.native_factor(spec, spec._arrays())
