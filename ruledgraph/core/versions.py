# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What results and timings depend on: versions, and the machine."""

import os
import platform
from importlib.metadata import version
from pathlib import Path


def version_text() -> str:
    """The versions in one line.

    Raises:
        FactorError: when the kernel that the environment asks for is not there.
    """
    from ruledgraph_factors import active_kernel

    return (
        f"ruledgraph {version('ruledgraph')} ({active_kernel()} kernel, gtsam {version('gtsam')}, "
        f"numpy {version('numpy')}, Python {platform.python_version()})"
    )


def machine_text() -> str:
    """The processor and how many of its cores there are."""
    name = platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                name = value.strip()
                break
    except (OSError, UnicodeDecodeError):  # not Linux
        pass
    return f"{name}, {os.cpu_count()} cores"
