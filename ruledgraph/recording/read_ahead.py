# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Reading ahead in a thread: a recording is decoded while the odometry works."""

import queue
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")

# Items go from thread to thread in batches: whenever one wakes the other, both wait for the
# interpreter. So many hold all that may be ahead.
_BATCHES = 8
# How long its end is waited for, s; it may be stuck in what it reads from.
_PATIENCE = 2.0


@dataclass(frozen=True)
class _End:
    """Of the items, or what went wrong with them."""

    error: BaseException | None


def read_ahead(
    items: Iterable[T], prepare: Callable[[T], object], most: int
) -> Generator[T, None, None]:
    """The same items in the same order, taken and prepared by a thread.

    The thread ends with the generator: close it (`contextlib.closing`) unless you take all.

    Args:
        items: used by that thread alone.
        prepare: called with each item there.
        most: how many items the thread may be ahead. They come in batches of an eighth of that, so
            that the first one waits for some more.

    Raises:
        Exception: whatever `items` or `prepare` raises, after the items before it.
    """
    together = max(most // _BATCHES, 1)
    # Both are C code: an interrupt (Ctrl-C) does not leave them locked.
    waiting: queue.SimpleQueue[list[T] | _End] = queue.SimpleQueue()
    places: queue.SimpleQueue[None] = queue.SimpleQueue()
    # One batch is in use, and one is being filled.
    for _ in range(max(most // together - 2, 1)):
        places.put(None)
    stop = threading.Event()

    def read() -> None:
        batch: list[T] = []
        error: BaseException | None = None
        try:
            for item in items:
                if stop.is_set():
                    return
                prepare(item)
                batch.append(item)
                if len(batch) == together:
                    places.get()
                    waiting.put(batch)
                    batch = []
        except BaseException as trouble:  # noqa: BLE001 - raised where the items are used
            error = trouble
        finally:
            waiting.put(batch)
            waiting.put(_End(error))
            # Here: what it reads from may be bound to this thread.
            if isinstance(items, Generator):
                items.close()

    thread = threading.Thread(target=read, name="ahead", daemon=True)
    try:
        thread.start()
        while True:
            # Not a condition of the loop: an interrupt there skips `finally` in CPython 3.13.0.
            entry = waiting.get()
            if isinstance(entry, _End):
                break
            places.put(None)
            yield from entry
        if entry.error is not None:
            raise entry.error
    finally:
        stop.set()
        places.put(None)
        # It may not have begun; and the collector of garbage may close this in the thread itself.
        if thread.ident is not None and thread is not threading.current_thread():
            thread.join(_PATIENCE)
