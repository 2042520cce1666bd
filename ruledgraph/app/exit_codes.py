# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Exit codes of the `ruledgraph` command, as GUIDE.md lists them."""

SOME_FAILED = 1
"""Of several runs."""
BAD_INPUT = 2
"""A recording, calibration, setting or option; of `info` also what is missing for `smooth`; click's
own code for wrong usage."""
NOTHING_ESTIMATED = 3
NO_RESOURCES = 4
"""Without disk space, memory or threads."""
INTERRUPTED = 130
"""By Ctrl-C, as shells say it."""


def of_signal(number: int) -> int:
    """Of a run that a signal ended, as shells say it: 130 for SIGINT, 143 for SIGTERM."""
    return 128 + number
