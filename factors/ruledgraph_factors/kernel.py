# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Which kernel does the arithmetic: the native one if it was built, else numpy, its reference.

Both compute the same to rounding. The environment variable RULEDGRAPH_KERNEL ("native" or "numpy")
chooses one by force; it is looked at at every use.
"""

import os
from typing import Literal, TypeAlias

from ruledgraph_factors.errors import FactorError

__all__ = ["Kernel", "active_kernel", "native"]

try:
    import ruledgraph_factors._native as native
except ModuleNotFoundError:  # installed where there was no C++ compiler
    native = None  # type: ignore[assignment]

Kernel: TypeAlias = Literal["native", "numpy"]

_VARIABLE = "RULEDGRAPH_KERNEL"


def active_kernel() -> Kernel:
    """The kernel that runs now.

    Raises:
        FactorError: when RULEDGRAPH_KERNEL asks for one that does not exist or was not built.
    """
    wanted = os.environ.get(_VARIABLE, "")
    if wanted not in ("", "native", "numpy"):
        raise FactorError(f"{_VARIABLE} must be native or numpy, not {wanted!r}")
    if wanted == "native" and native is None:
        raise FactorError(
            f"{_VARIABLE} is native, but that kernel was not built: install a C++ compiler, "
            "then ruledgraph again"
        )
    return "numpy" if wanted == "numpy" or native is None else "native"
