# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The Python on the documentation pages runs, block after block, as a reader would paste it."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def python_blocks(page: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def run(blocks: list[str], page: str) -> dict[str, object]:
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, page, "exec"), namespace)
    return namespace


def test_embedding_page_runs() -> None:
    run(python_blocks("factors/EMBEDDING.md"), "factors/EMBEDDING.md")


def test_readme_runs_on_the_measurements_of_the_embedding_page() -> None:
    measurements = python_blocks("factors/EMBEDDING.md")[0]
    blocks = [block for block in python_blocks("README.md") if "rf." in block]
    assert blocks
    graph = run([measurements, *blocks], "README.md")["graph"]
    assert graph.size() == 5  # three priors on the state, the line's factor and its prior
