# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""NPZ files of a header, which is JSON, and arrays: how specs and graphs are stored."""

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ruledgraph_factors.errors import FactorError

# What numpy, zipfile and json make of a file of another kind: a text, a NPY file, an empty or a
# damaged one. That a file does not exist, or cannot be opened, is an OSError and stays one.
_FOREIGN = (ValueError, TypeError, AttributeError, KeyError, EOFError, BadZipFile, zlib.error)


def write_parts(
    path: str | os.PathLike[str], header: Mapping[str, Any], arrays: Mapping[str, Any]
) -> None:
    """Write both; no array may be called "header"."""
    with Path(path).open("wb") as file:
        np.savez_compressed(file, header=np.array(json.dumps(header)), **arrays)


def read_parts(path: str | os.PathLike[str], content: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The inverse of `write_parts`; `content` says in an error what was looked for.

    Raises:
        FactorError: for a file of another kind, naming it.
    """
    try:
        # Opened here: numpy leaves a damaged file open.
        with Path(path).open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = dict(json.loads(str(arrays.pop("header"))))
    except _FOREIGN:
        raise FactorError(f"{os.fspath(path)} holds no {content}, or is damaged") from None
    return header, arrays
