# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Stamp order out of messages in the order of their reception."""

import heapq
import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from ruledgraph.recording.container import RawMessage, Topic

REORDER_BOUND = 500_000_000
"""ns; a message that comes later than this after one with a later stamp is dropped."""

_AHEAD = "its stamp jumps ahead"
_BEHIND = f"its stamp is more than {REORDER_BOUND * 1e-9:g} s behind others"


class Stamped(NamedTuple):
    """A message with the stamp of its header, ns."""

    stamp: int
    camera: bool
    """Whether it holds an image, not IMU samples."""
    topic: Topic
    message: RawMessage


def in_stamp_order(
    messages: Iterable[Stamped],
    drop: Callable[[Stamped, str], None],
    reordered: Callable[[], None],
) -> Iterator[Stamped]:
    """Sort messages by stamp, in a buffer `REORDER_BOUND` long.

    A single stamp that jumps ahead, one flipped bit is enough, must not make everything after it
    late. So the newest message of each topic is held back until a later stamp confirms it. Of equal
    stamps the IMU's come before the camera's.

    Args:
        messages: in the order of reception.
        drop: told of every message left out, and why.
        reordered: told of every message that came after one of its topic with a later stamp.
    """
    held: dict[str, Stamped] = {}
    newest: dict[str, int] = {}  # the latest confirmed stamp of each topic
    heap: list[tuple[int, bool, int, Stamped]] = []
    order = itertools.count()
    released = 0

    def confirm(message: Stamped) -> None:
        name = message.topic.name
        if message.stamp < released:
            drop(message, _BEHIND)
            return
        if message.stamp < newest.get(name, 0):
            reordered()
        newest[name] = max(message.stamp, newest.get(name, 0))
        heapq.heappush(heap, (message.stamp, message.camera, next(order), message))

    for message in messages:
        name = message.topic.name
        previous = held.get(name)
        last = newest.get(name, message.stamp)
        jumped = previous is not None and previous.stamp > last + REORDER_BOUND
        if message.stamp < last - REORDER_BOUND or (
            previous is not None and not jumped and message.stamp < previous.stamp - REORDER_BOUND
        ):
            drop(message, _BEHIND)
            continue
        if previous is not None and message.stamp < previous.stamp - REORDER_BOUND:
            drop(previous, _AHEAD)
        elif previous is not None:
            confirm(previous)
        held[name] = message
        clock = max(newest.values(), default=0)
        for other in [m for m in held.values() if m.stamp <= clock]:
            confirm(held.pop(other.topic.name))
        while heap and heap[0][0] <= clock - REORDER_BOUND:
            released, _, _, ready = heapq.heappop(heap)
            yield ready
    for name, message in held.items():
        if message.stamp > newest.get(name, message.stamp) + REORDER_BOUND:
            drop(message, _AHEAD)
        else:
            confirm(message)
    while heap:
        yield heapq.heappop(heap)[3]
