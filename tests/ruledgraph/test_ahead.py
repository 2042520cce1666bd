# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import threading
from collections.abc import Iterator

import pytest

from ruledgraph.ahead import ahead


def test_everything_comes_prepared_in_order_from_one_other_thread():
    threads, prepared = set(), []

    def items() -> Iterator[int]:
        for i in range(200):
            threads.add(threading.current_thread())
            yield i

    assert list(ahead(items(), prepared.append, 4)) == list(range(200))
    assert prepared == list(range(200))
    assert len(threads) == 1
    assert threading.current_thread() not in threads


def test_what_it_reads_from_is_closed_where_it_was_read():
    closed = []

    def items() -> Iterator[int]:
        try:
            yield from range(100)
        finally:
            closed.append(threading.current_thread())

    for stop in (3, 200):
        for i in ahead(items(), lambda _: None, 4):
            if i == stop:
                break
    assert len(set(closed)) == 2
    assert threading.current_thread() not in closed


def test_it_is_never_further_ahead_than_allowed():
    taken = []

    def items() -> Iterator[int]:
        for i in range(50):
            taken.append(i)
            yield i

    for used, _ in enumerate(ahead(items(), lambda _: None, 5)):
        # The one in hand, five waiting, one that waits to be put.
        assert len(taken) <= used + 7


def test_an_error_comes_after_the_items_before_it():
    def items() -> Iterator[int]:
        yield 1
        raise ValueError("broken")

    reading = ahead(items(), lambda _: None, 4)
    assert next(reading) == 1
    with pytest.raises(ValueError, match="broken"):
        next(reading)
    with pytest.raises(ZeroDivisionError):
        list(ahead([0], lambda x: 1 // x, 4))


def test_the_thread_ends_when_nobody_wants_more():
    before = threading.active_count()
    for item in ahead(iter(range(10**9)), lambda _: None, 4):
        if item == 10:
            break
    assert threading.active_count() == before
