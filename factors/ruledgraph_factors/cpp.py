# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Where the C++ headers are; `CPP.md` is their guide."""

from pathlib import Path


def get_include() -> str:
    """Folder of the C++ headers, for a compiler's -I: `#include "ruledgraph/…"`."""
    return str(_folder("include"))


def get_cmake_dir() -> str:
    """Folder of `ruledgraphConfig.cmake`, for CMake's -Druledgraph_DIR."""
    return str(_folder("cmake"))


def _folder(name: str) -> Path:
    here = Path(__file__).parent
    # An editable installation runs in the clone, where they lie beside the package.
    return here / name if (here / name).is_dir() else here.parent / name
