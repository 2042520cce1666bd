# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Where `ruledgraph` gets `ruledgraph-factors` from; the build backend asks when it builds.

In a clone both are one state of the code: the requirement is the folder beside this one, so that
`pip install .` needs no index for it and cannot meet another version. A source distribution has no
such folder and names the same version on the index; so does a wheel that is built from it. An index
refuses a wheel that was built in a clone, because the requirement is a path.

pip refuses to link the factors (`-e ./factors`) beside a requirement of them by path. Where
RULEDGRAPH_FACTORS is "linked" the requirement is by version in a clone, too; `_venv.sh` sets it.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_FACTORS = Path(__file__).resolve().parents[1] / "factors"


class Provider:
    """A provider of dynamic metadata as scikit-build-core defines it."""

    def __init__(self) -> None:
        self._for_sdist = False

    def build_state(self, build_state: str) -> None:
        """Take what is being built: "sdist", "wheel", "editable", …."""
        self._for_sdist = build_state == "sdist"

    def dynamic_metadata(
        self, settings: Mapping[str, Any], project: Mapping[str, Any]
    ) -> dict[str, list[str]]:
        """The requirement, to be added to the static ones."""
        del settings
        linked = os.environ.get("RULEDGRAPH_FACTORS") == "linked"
        if self._for_sdist or linked or not (_FACTORS / "pyproject.toml").is_file():
            return {"dependencies": [f"ruledgraph-factors=={project['version']}"]}
        return {"dependencies": [f"ruledgraph-factors @ {_FACTORS.as_uri()}"]}
