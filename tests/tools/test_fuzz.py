# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Mutated files of every kind are read or refused in one line."""

import dataclasses

import pytest

import fuzz
from ruledgraph.core.errors import RuledgraphError

EXAMPLES = 30


@pytest.mark.parametrize("target", fuzz.TARGETS, ids=lambda target: target.name)
def test_mutated_files_are_read_or_refused(target):
    outcomes = fuzz.fuzz(target, EXAMPLES, seed=1)
    assert sum(outcomes.values()) >= EXAMPLES
    assert set(outcomes) <= {"read", "refused"}
    assert outcomes == fuzz.fuzz(target, EXAMPLES, seed=1)


def test_another_exception_is_a_failure(tmp_path):
    def fragile(path):
        if b"7" in path.read_bytes():
            raise KeyError("a seven")

    def two_lines(path):
        if b"7" in path.read_bytes():
            raise RuledgraphError("a\nseven")

    tum = next(target for target in fuzz.TARGETS if target.name == "tum")

    def without_seven(folder):
        path = tum.make(folder)
        path.write_bytes(path.read_bytes().replace(b"7", b"1"))
        return path

    for read, expected in ((fragile, KeyError), (two_lines, AssertionError)):
        with pytest.raises(expected) as caught:
            fuzz.fuzz(dataclasses.replace(tum, make=without_seven, read=read), 300, seed=0)
        assert b"7" in caught.value.failing_file
    assert list(tmp_path.iterdir()) == []


def test_operations():
    data = b"a: [1.5, 22]\nb: 3\nc: 4\n"
    assert fuzz.mutated(data, [("word", 0.4, "nan")]) == b"a: [1.5, nan]\nb: 3\nc: 4\n"
    assert fuzz.mutated(data, [("cut", 0.5, None)]) == data[:11]
    assert fuzz.mutated(data, [("drop", 0.0, 3)]) == data[3:]
    assert fuzz.mutated(data, [("flip", 0.0, 1)]) == b"`" + data[1:]
    assert fuzz.mutated(data, [("line", 0.0, 0.99)]) == b"b: 3\nc: 4\n\na: [1.5, 22]"
    assert fuzz.mutated(data, [("number", 0.0, 1)])[:4] == b"\1\0\0\0"
    assert fuzz.mutated(b"", [("flip", 0.5, 1), ("word", 0.5, "x"), ("line", 0.5, 0.5)]) == b"x"
