# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The package's root exception, and what a machine runs out of."""

import errno


class RuledgraphError(Exception):
    """Bad input or a run that cannot go on: one line that says what, where, and what to do."""


class MeasurementError(RuledgraphError):
    """A sample or an image that cannot be used and is left out; those after it may be good."""


class MachineError(RuledgraphError):
    """The machine ran out of disk space, memory or threads. What was written can be read."""


# What says that there is nothing left, or nothing to write to any more.
_EXHAUSTED = frozenset(
    getattr(errno, name)
    for name in ("ENOSPC", "EFBIG", "EDQUOT", "ENOMEM", "EMFILE", "ENFILE", "EIO", "EROFS")
)
# OpenCV's code for a lack of memory.
_CV_NO_MEMORY = -4


def machine_error(error: BaseException, where: object = None) -> MachineError | None:
    """An error of the machine in one line; None for any other one.

    Args:
        error: whatever was raised.
        where: the file, if the error does not name it.
    """
    if isinstance(error, MachineError):
        return error
    in_cpp = getattr(error, "code", 0) == _CV_NO_MEMORY or "std::bad_alloc" in str(error)
    if isinstance(error, MemoryError) or in_cpp:
        text = f" ({error})".replace("\n", " ") if str(error) else ""
        return MachineError(f"out of memory{text}: free some, or take a part by --duration")
    if isinstance(error, OSError) and error.errno in _EXHAUSTED:
        where = where or error.filename
        subject = f"{where}: " if where else "output "
        return MachineError(f"{subject}cannot be written: {error.strerror}")
    if isinstance(error, RuntimeError) and "can't start new thread" in str(error):
        return MachineError(
            "no thread could be started: the limit of processes (ulimit -u) or of memory is reached"
        )
    return None
