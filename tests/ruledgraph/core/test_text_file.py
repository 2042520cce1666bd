# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Files that end with a whole line, however little space there is."""

import resource
import signal

import pytest

from ruledgraph.core.errors import MachineError
from ruledgraph.core.text_file import AppendOnlyFile, write_whole


@pytest.fixture
def few_bytes():
    """This process may write files of 100 bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.usefixtures("few_bytes")
def test_a_line_that_does_not_fit_leaves_the_others(tmp_path):
    path = tmp_path / "lines.txt"
    with AppendOnlyFile(path) as file:
        for _ in range(9):
            file.write("0123456789\n")
        with pytest.raises(MachineError, match=r"lines\.txt: cannot be written: File too large"):
            file.write("0123456789\n")
        assert path.read_text() == 9 * "0123456789\n"
        file.write("\n")  # a shorter one still fits
    assert path.read_text() == 9 * "0123456789\n" + "\n"


def test_what_is_written_is_there_at_once(tmp_path):
    path = tmp_path / "lines.txt"
    file = AppendOnlyFile(path)
    file.write("one\n")
    assert path.read_text() == "one\n"
    file.close()
    file.close()


def test_an_existing_file_is_not_touched(tmp_path):
    path = tmp_path / "lines.txt"
    path.write_text("mine")
    with pytest.raises(FileExistsError):
        AppendOnlyFile(path)
    assert path.read_text() == "mine"


@pytest.mark.usefixtures("few_bytes")
def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "summary.json"
    with pytest.raises(MachineError, match=r"summary\.json: cannot be written: File too large"):
        write_whole(path, "x" * 200)
    assert list(tmp_path.iterdir()) == []
    write_whole(path, "x" * 50)
    # One that was there stays when the next one does not fit.
    with pytest.raises(MachineError):
        write_whole(path, "y" * 200)
    assert path.read_text() == "x" * 50
    assert list(tmp_path.iterdir()) == [path]
