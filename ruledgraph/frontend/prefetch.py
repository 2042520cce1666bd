# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What one thread computes of frames before another one comes to them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.measurements import Frame

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class _Entry(Generic[T]):
    image: NDArray[np.uint8]
    value: T


class PrefetchCache(Generic[T]):
    """Values for frames to come, by their stamps.

    One thread puts them in, the other takes them out. What it passes over is thrown away.

    Args:
        capacity: in frames.
        discard: called with each value that is not used.
    """

    def __init__(self, capacity: int, discard: Callable[[T], object] = lambda _: None) -> None:
        self._capacity = capacity
        self._discard = discard
        self._entries: dict[int, _Entry[T]] = {}

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def full(self) -> bool:
        """Whether there are as many as there may be."""
        return len(self) >= self._capacity

    def put(self, frame: Frame, value: T) -> None:
        """Keep a value of a frame."""
        self._entries[frame.stamp] = _Entry(frame.image, value)

    def take(self, frame: Frame) -> T | None:
        """The value of a frame, if it is of this very image; those of earlier ones are gone."""
        entry = self._entries.pop(frame.stamp, None)
        # `list` in one go: meanwhile the other thread puts in.
        for stamp in [stamp for stamp in list(self._entries) if stamp < frame.stamp]:
            self._discard(self._entries.pop(stamp).value)
        if entry is None:
            return None
        # A frame of a frozen camera is replaced by a black one of its stamp.
        if entry.image is not frame.image:
            self._discard(entry.value)
            return None
        return entry.value
