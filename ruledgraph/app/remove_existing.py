# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What `--force` removes: what an earlier command wrote, and nothing else."""

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from ruledgraph.core.errors import RuledgraphError

# What tells a folder that a command wrote: results, a ROS 2 bag, an ASL folder.
_OF_RESULTS = "trajectory_live.tum"
_MARKS = (_OF_RESULTS, "*.db3", "mav0")


def remove_existing(*paths: Path, inputs: Iterable[Path] = ()) -> None:
    """Remove files, and folders that hold a recording or a run's results, for new ones.

    Raises:
        RuledgraphError: for a folder of anything else, what holds one of the `inputs` or is one,
            and what cannot be removed.
    """
    _spare(inputs, paths)
    for path in paths:
        _remove(path)


def remove_existing_results(folder: Path, inputs: Iterable[Path]) -> None:
    """Remove a folder of earlier results.

    Raises:
        RuledgraphError: for anything else, what holds one of the `inputs`, and what cannot be
            removed.
    """
    _spare(inputs, [folder])
    is_free = not folder.exists() or (folder.is_dir() and not any(folder.iterdir()))
    if not (is_free or (folder / _OF_RESULTS).exists()):
        raise RuledgraphError(f"{folder}: is no folder of results; --force leaves it alone")
    _remove(folder)


def _spare(inputs: Iterable[Path], paths: Sequence[Path]) -> None:
    for given in inputs:
        for path in paths:
            removed = path.resolve()
            if removed == given.resolve() or removed in given.resolve().parents:
                raise RuledgraphError(
                    f"{path}: {given} is read from there; name another place for what is written"
                )


def _remove(path: Path) -> None:
    try:
        if path.is_file() or path.is_symlink() or not path.exists():
            path.unlink(missing_ok=True)
            return
        if not path.is_dir():
            raise RuledgraphError(f"{path}: is no file; --force leaves it alone")
        if any(path.iterdir()) and not any(any(path.glob(mark)) for mark in _MARKS):
            raise RuledgraphError(
                f"{path}: holds neither a recording nor results; --force leaves it alone"
            )
        shutil.rmtree(path)
    except OSError as error:
        raise RuledgraphError(f"{path}: cannot be removed: {error.strerror}") from None
