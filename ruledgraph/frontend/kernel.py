# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The native kernel of what is done in every frame, if there is one."""

from ruledgraph_factors import active_kernel

try:
    import ruledgraph.frontend._native_frame as native
except ModuleNotFoundError:  # installed where there was no C++ compiler
    native = None  # type: ignore[assignment]

__all__ = ["is_native", "native"]


def is_native() -> bool:
    """Whether to use it.

    Raises:
        FactorError: when the environment asks for a kernel that there is not.
    """
    return active_kernel() == "native" and native is not None
