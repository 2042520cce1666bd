# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import contextlib
import signal
import threading
import time
from collections.abc import Iterator

import pytest

import ruledgraph.recording.read_ahead as ahead_module
from ruledgraph.recording.read_ahead import read_ahead


def test_everything_comes_prepared_in_order_from_one_other_thread():
    threads, prepared = set(), []

    def items() -> Iterator[int]:
        for i in range(200):
            threads.add(threading.current_thread())
            yield i

    assert list(read_ahead(items(), prepared.append, 4)) == list(range(200))
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
        for i in read_ahead(items(), lambda _: None, 4):
            if i == stop:
                break
    assert len(set(closed)) == 2
    assert threading.current_thread() not in closed


@pytest.mark.parametrize("most", [5, 64])
def test_it_is_never_further_ahead_than_allowed(most):
    taken = []

    def items() -> Iterator[int]:
        for i in range(300):
            taken.append(i)
            yield i

    furthest = 0
    for used, _ in enumerate(read_ahead(items(), lambda _: None, most)):
        if used % 50 == 10:
            time.sleep(0.05)  # for the thread to go as far as it may
        furthest = max(furthest, len(taken) - (used + 1))
    assert most / 2 < furthest <= most


@pytest.mark.parametrize("count", [0, 7, 64, 1007])
def test_whole_batches_and_the_rest(count):
    assert list(read_ahead(range(count), lambda _: None, 64)) == list(range(count))


@pytest.mark.parametrize("most", [4, 64])
def test_an_error_comes_after_the_items_before_it(most):
    def items() -> Iterator[int]:
        yield from range(21)
        raise ValueError("broken")

    reading = read_ahead(items(), lambda _: None, most)
    assert [next(reading) for _ in range(21)] == list(range(21))
    with pytest.raises(ValueError, match="broken"):
        next(reading)
    with pytest.raises(ZeroDivisionError):
        list(read_ahead([0], lambda x: 1 // x, most))


def test_a_reader_that_is_stuck_is_not_waited_for_long(monkeypatch):
    monkeypatch.setattr(ahead_module, "_PATIENCE", 0.05)
    go_on = threading.Event()

    def items() -> Iterator[int]:
        yield 1
        go_on.wait(10.0)
        yield 2

    reading = read_ahead(items(), lambda _: None, 1)
    assert next(reading) == 1
    reading.close()
    (thread,) = [thread for thread in threading.enumerate() if thread.name == "ahead"]
    go_on.set()
    thread.join(10.0)
    assert not thread.is_alive()


def test_interrupts_leave_nothing_locked():
    before, interrupts = threading.active_count(), 0

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    was = signal.signal(signal.SIGALRM, interrupt)
    try:
        for i in range(60):
            reading = read_ahead(iter(range(10**6)), lambda _: None, 8)
            try:
                signal.setitimer(signal.ITIMER_REAL, 0.001 + 1e-4 * i)
                with contextlib.closing(reading):
                    for _ in reading:
                        pass
            except KeyboardInterrupt:
                interrupts += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, was)
    # One that comes where Python has to ignore it, in a callback of the collector, is lost.
    assert interrupts > 50
    # One that was interrupted while it began may end a little later.
    late = time.monotonic() + 10.0
    while threading.active_count() > before and time.monotonic() < late:
        time.sleep(0.01)
    assert threading.active_count() == before


def test_the_thread_ends_when_nobody_wants_more():
    before = threading.active_count()
    for most in (4, 64):
        for item in read_ahead(iter(range(10**9)), lambda _: None, most):
            if item == 10:
                break
        assert threading.active_count() == before
