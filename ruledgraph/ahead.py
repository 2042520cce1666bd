# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Reading ahead in a thread: a recording is decoded while the odometry works."""

import queue
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class _End:
    """Of the items, or what went wrong with them."""

    error: BaseException | None


@dataclass(frozen=True)
class _Item(Generic[T]):
    value: T


def ahead(items: Iterable[T], prepare: Callable[[T], object], most: int) -> Iterator[T]:
    """The same items in the same order, taken and prepared by a thread.

    Args:
        items: used by that thread alone.
        prepare: called with each item there.
        most: how many items the thread may be ahead.

    Raises:
        Exception: whatever `items` or `prepare` raises, after the items before it.
    """
    waiting: queue.Queue[_Item[T] | _End] = queue.Queue(most)
    stop = threading.Event()

    def put(entry: _Item[T] | _End) -> None:
        while not stop.is_set():
            try:
                waiting.put(entry, timeout=0.1)
            except queue.Full:
                continue
            return

    def read() -> None:
        try:
            for item in items:
                if stop.is_set():
                    return
                prepare(item)
                put(_Item(item))
        except BaseException as error:  # noqa: BLE001 - raised where the items are used
            put(_End(error))
        else:
            put(_End(None))
        finally:
            # Here: what it reads from may be bound to this thread.
            if isinstance(items, Generator):
                items.close()

    thread = threading.Thread(target=read, name="ahead", daemon=True)
    thread.start()
    try:
        while isinstance(entry := waiting.get(), _Item):
            yield entry.value
        if entry.error is not None:
            raise entry.error
    finally:
        stop.set()
        thread.join()
