# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Reading ahead in a thread: a recording is decoded while the odometry works."""

import queue
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

# Items go from thread to thread in batches: whenever one wakes the other, both wait for the
# interpreter. So many hold all that may be ahead.
_BATCHES = 8


@dataclass(frozen=True)
class _End:
    """Of the items, or what went wrong with them."""

    error: BaseException | None


@dataclass(frozen=True)
class _Items(Generic[T]):
    values: list[T]


def ahead(items: Iterable[T], prepare: Callable[[T], object], most: int) -> Iterator[T]:
    """The same items in the same order, taken and prepared by a thread.

    Args:
        items: used by that thread alone.
        prepare: called with each item there.
        most: how many items the thread may be ahead. They come in batches of an eighth of that, so
            that the first one waits for some more.

    Raises:
        Exception: whatever `items` or `prepare` raises, after the items before it.
    """
    together = max(most // _BATCHES, 1)
    # One batch is in use, and one waits to be put.
    waiting: queue.Queue[_Items[T] | _End] = queue.Queue(max(most // together - 2, 1))
    stop = threading.Event()

    def put(entry: _Items[T] | _End) -> None:
        while not stop.is_set():
            try:
                waiting.put(entry, timeout=0.1)
            except queue.Full:
                continue
            return

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
                    put(_Items(batch))
                    batch = []
        except BaseException as trouble:  # noqa: BLE001 - raised where the items are used
            error = trouble
        finally:
            put(_Items(batch))
            put(_End(error))
            # Here: what it reads from may be bound to this thread.
            if isinstance(items, Generator):
                items.close()

    thread = threading.Thread(target=read, name="ahead", daemon=True)
    thread.start()
    try:
        while isinstance(entry := waiting.get(), _Items):
            yield from entry.values
        if entry.error is not None:
            raise entry.error
    finally:
        stop.set()
        thread.join()
