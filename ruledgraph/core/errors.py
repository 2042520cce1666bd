# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The package's root exception."""


class RuledgraphError(Exception):
    """Bad input or a run that cannot go on: one line that says what, where, and what to do."""
