# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Mutated files for everything that reads files: each is read, or refused in one line.

    python tools/fuzz.py --examples 2000
    python tools/fuzz.py --only kitti --seed 7

Hypothesis draws the mutations and cuts a failure down to its smallest; the file that fails is left
in --keep. What was read must make sense: finite numbers, stamps in order. Same seed, same files.
"""

import struct
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import click
import hypothesis
import numpy as np
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st

import fuzz_seeds
from ruledgraph.calibration import read_calibration
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, Gap, ImuSample
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import read_tum
from ruledgraph.diagnostics.info import inspect_recording
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.evaluation.markers import read_markers
from ruledgraph.recording import open_recording

_LONGEST = timedelta(seconds=20)

# What takes the place of words and numbers in texts.
_WORDS = st.sampled_from(
    [
        *("0", "-1", "1e308", "1e-308", "-1e400", "nan", "inf", ".nan", ".inf", "1_0", "0x1F"),
        *("9223372036854775808", "18446744073709551616", "1700000000.123456789012"),
        *("1.7e9", "1700000000000000000", "\u0663", "\u00b2", "~", "null", "true", "yes"),
        *("[]", "{}", "[[]]", "{a: b}", "&a", "*a", "!!python/object:os.system", "!", "|", ">"),
        *("-", "--", "?", ":", "#", '"', "'", "%s", "\a", "\0", "\ufeff", "", " ", "\n", "\t"),
        *("\r", "\x1b[31m", "a b", "/etc/passwd", "../../x", "x" * 5000, "[" * 300, "9" * 400),
    ]
)
_PLACE = st.floats(0.0, 1.0, exclude_max=True)
_BIG = st.sampled_from([0, 1, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63, 2**64 - 1])
_OPERATION = st.one_of(
    st.tuples(st.just("flip"), _PLACE, st.integers(1, 255)),
    st.tuples(st.just("cut"), _PLACE, st.none()),
    st.tuples(st.just("drop"), _PLACE, st.integers(1, 400)),
    st.tuples(st.just("double"), _PLACE, st.integers(1, 400)),
    st.tuples(st.just("bytes"), _PLACE, st.binary(max_size=12)),
    st.tuples(st.just("number"), _PLACE, _BIG),
    st.tuples(st.just("word"), _PLACE, _WORDS),
    st.tuples(st.just("line"), _PLACE, _PLACE),
)
MUTATIONS = st.lists(_OPERATION, min_size=1, max_size=4)
_SEPARATORS = b" ,:[]\n\t{}#"


def mutated(data: bytes, operations: Sequence[tuple[str, float, object]]) -> bytes:
    """The data after the operations, which say where as a share of the length."""
    for name, place, value in operations:
        at = int(place * len(data))
        if name == "flip" and isinstance(value, int) and data:
            data = data[:at] + bytes([data[at] ^ value]) + data[at + 1 :]
        elif name == "cut":
            data = data[:at]
        elif name == "drop" and isinstance(value, int):
            data = data[:at] + data[at + value :]
        elif name == "double" and isinstance(value, int):
            data = data[: at + value] + data[at:]
        elif name == "bytes" and isinstance(value, bytes):
            data = data[:at] + value + data[at + len(value) :]
        elif name == "number" and isinstance(value, int):
            wide = struct.pack("<Q", value) if value >= 2**32 else struct.pack("<I", value)
            data = data[:at] + wide + data[at + len(wide) :]
        elif name == "word" and isinstance(value, str):
            data = _with_word(data, at, value.encode())
        elif name == "line" and isinstance(value, float):
            lines = data.split(b"\n")
            line = lines.pop(int(place * len(lines)))
            lines.insert(int(value * (len(lines) + 1)), line)
            data = b"\n".join(lines)
    return data


def _with_word(data: bytes, at: int, word: bytes) -> bytes:
    """The word or number at a place replaced."""
    first = last = at
    while first > 0 and data[first - 1] not in _SEPARATORS:
        first -= 1
    while last < len(data) and data[last] not in _SEPARATORS:
        last += 1
    return data[:first] + word + data[last:]


# -- what is read ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Target:
    """Files of one kind, and what reads them."""

    name: str
    make: Callable[[Path], Path]
    """Write a good one into an empty folder; the file to mutate."""
    read: Callable[[Path], None]
    """Read the file; raises an AssertionError when what was read makes no sense."""


def _require(condition: bool | np.bool_) -> None:
    if not condition:
        raise AssertionError("what was read makes no sense")


def _calibration(path: Path) -> None:
    others = [p for p in path.parent.iterdir() if p != path]
    calibration = read_calibration(path, *others)
    _require(np.isfinite(calibration.body_T_cam.matrix()).all())
    _require(np.isfinite(calibration.time_offset))
    rotation = calibration.body_T_cam.rotation().matrix()
    _require(np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9))


def _config(path: Path) -> None:
    _require(load_config(path) is not None)


def _tum(path: Path) -> None:
    trajectory = read_tum(path)
    _require(np.isfinite(trajectory.positions).all())
    _require(np.isfinite(trajectory.quaternions).all())
    _require((np.diff(trajectory.stamps) > 0).all())


def _ground_truth(path: Path) -> None:
    truth = read_ground_truth(path)
    _require(np.isfinite(truth.positions).all())
    _require((np.diff(truth.stamps) > 0).all())
    _require(truth.quaternions is None or np.isfinite(truth.quaternions).all())


def _kitti(path: Path) -> None:
    (times,) = path.parent.glob("times.txt")
    _ground_truth(Path(f"{path},{times}") if path.name != "times.txt" else path)


def _markers(path: Path) -> None:
    for point in read_markers(path).values():
        _require(point.shape == (3,))
        _require(np.isfinite(point).all())


def _recording(path: Path) -> None:
    """Through `info`, then through the stream; the recording may be a folder around the file."""
    root = path
    while not (root.parent.parent / "good").exists():
        root = root.parent
    inspect_recording(root).as_dict()
    last = {Frame: -1, ImuSample: -1}
    for measurement in open_recording(root).stream():
        if isinstance(measurement, Gap):
            continue
        kind = type(measurement)
        _require(measurement.stamp > last[kind])
        last[kind] = measurement.stamp
        if isinstance(measurement, ImuSample):
            _require(np.isfinite(measurement.gyroscope).all())
            _require(np.isfinite(measurement.accelerometer).all())


TARGETS = [
    *(Target(name, make, _calibration) for name, make in fuzz_seeds.CALIBRATIONS.items()),
    Target("config", fuzz_seeds.config, _config),
    Target("tum", fuzz_seeds.tum, _tum),
    Target("tum as ground truth", fuzz_seeds.tum, _ground_truth),
    Target("euroc", fuzz_seeds.euroc, _ground_truth),
    Target("kitti", fuzz_seeds.kitti, _kitti),
    Target("markers, csv", fuzz_seeds.markers_csv, _markers),
    Target("markers, yaml", fuzz_seeds.markers_yaml, _markers),
    *(Target(name, make, _recording) for name, make in fuzz_seeds.RECORDINGS.items()),
]


# -- the run ---------------------------------------------------------------------------------------


def fuzz(
    target: Target, examples: int, seed: int, deadline: timedelta | None = None
) -> Counter[str]:
    """Mutate and read; how many were `read` and how many `refused`.

    Raises:
        Exception: what the reader raised that it must not, with the operations that did it.
    """
    outcomes: Counter[str] = Counter()
    with (
        tempfile.TemporaryDirectory(prefix="ruledgraph-fuzz-") as folder,
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("error")
        (Path(folder) / "good").touch()
        inner = Path(folder) / "files"
        inner.mkdir()
        path = target.make(inner)
        good = path.read_bytes()
        target.read(path)

        @hypothesis.seed(seed)
        @hypothesis.settings(
            max_examples=examples,
            deadline=deadline,
            database=None,
            derandomize=False,
            suppress_health_check=list(HealthCheck),
            phases=(Phase.generate, Phase.shrink),
        )
        @hypothesis.given(MUTATIONS)
        def attempt(operations: list[tuple[str, float, object]]) -> None:
            path.write_bytes(mutated(good, operations))
            try:
                target.read(path)
            except RuledgraphError as error:
                outcomes["refused"] += 1
                if not str(error) or "\n" in str(error):
                    raise AssertionError(f"not one line: {error!r}") from error
            else:
                outcomes["read"] += 1

        try:
            attempt()
        except BaseException as error:
            error.failing_file = path.read_bytes()  # type: ignore[attr-defined]
            raise
    return outcomes


@click.command(help=__doc__)
@click.option("--examples", default=500, show_default=True, help="Of each kind of file.")
@click.option("--seed", default=0, show_default=True)
@click.option("--only", default="", help="Kinds whose name contains this.")
@click.option("--keep", type=click.Path(path_type=Path), help="Folder for files that fail.")
def main(examples: int, seed: int, only: str, keep: Path | None) -> None:
    """Command line."""
    failures = 0
    for target in TARGETS:
        if only not in target.name:
            continue
        started = time.monotonic()
        try:
            outcomes = fuzz(target, examples, seed, _LONGEST)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is the finding
            failures += 1
            click.echo(f"{target.name}: FAILED with {type(error).__name__}: {error}")
            for note in getattr(error, "__notes__", ()):
                click.echo(f"  {note}")
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                name = target.name.replace(" ", "_").replace(",", "")
                (keep / name).write_bytes(getattr(error, "failing_file", b""))
            continue
        counts = ", ".join(f"{n} {name}" for name, n in sorted(outcomes.items()))
        click.echo(f"{target.name}: {counts}; {time.monotonic() - started:.1f} s")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
