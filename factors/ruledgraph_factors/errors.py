# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The package's exceptions; `FactorError` is the root of all of them."""


class FactorError(ValueError):
    """Input that no factor, line or motion can be built from; the message names the argument."""


class DegenerateWindowError(FactorError):
    """The first window does not determine velocity, gravity and lines; the message says why."""
