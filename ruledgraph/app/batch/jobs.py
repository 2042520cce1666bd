# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a batch consists of: every recording with every choice of settings."""

import glob
import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from ruledgraph.app.input_options import InputOptions
from ruledgraph.app.trajectory_files import TrajectoryFormat
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.settings import config_text, load_config
from ruledgraph.recording import recordings_in

SIMULATED = "sim:"
"""Begins a source SCENE:MOTION that is simulated, with options as in a URL's query."""
_SIMULATION_OPTIONS: dict[str, Callable[[str], Any]] = {
    "rate": float,
    "duration": float,
    "start": float,
    "resolution": str,
    "imu": str,
    "imu_rate": float,
    "readout": float,
    "moving_start": {"true": True, "false": False}.__getitem__,
}


@dataclass(frozen=True)
class Job:
    """One run, by plain values: it is sent to other processes and machines."""

    recording: str
    """Path or URL as the workers see it, or `sim:SCENE:MOTION?rate=30&duration=6`."""
    settings: tuple[str, ...]
    """What `--set` chose for this run among several values, `section.key=value`."""
    seed: int | None
    """Of a simulation."""
    config: Config
    inputs: InputOptions
    formats: tuple[TrajectoryFormat, ...] = ()
    """Of the trajectories, beside TUM's."""
    plots: bool = False

    @property
    def digest(self) -> str:
        """The same for the same run, in other sessions, too."""
        return hashlib.sha256(repr(self.as_dict()).encode()).hexdigest()[:8]

    @property
    def name(self) -> str:
        """Of its folder: readable, and of its own."""
        seed = [] if self.seed is None else [f"seed{self.seed}"]
        words = "_".join([stem(self.recording), *self.settings, *seed])
        return re.sub(r"[^\w.=-]+", "-", words)[:100] + f"-{self.digest}"

    def as_dict(self) -> dict[str, Any]:
        """All that decides on its outcome, as JSON holds it."""
        return {
            **asdict(self),
            "settings": list(self.settings),
            "config": config_text(self.config),
        }


def stem(recording: str) -> str:
    """Name of a recording without its folder and suffix."""
    if recording.startswith(SIMULATED):
        return recording.removeprefix(SIMULATED).partition("?")[0]
    return Path(recording).stem


def plan(
    patterns: Sequence[str],
    inputs: InputOptions,
    *,
    config_file: Path | None = None,
    choices: Sequence[Sequence[str]] = (),
    seeds: int = 1,
    formats: Sequence[TrajectoryFormat] = (),
    plots: bool = False,
) -> list[Job]:
    """All jobs of a batch.

    Args:
        patterns: paths, glob patterns, URLs, and simulations as `sim:SCENE:MOTION`; folders stand
            for all recordings in them.
        inputs: of all runs.
        config_file: settings of all runs.
        choices: `section.key=value`, for each setting those that are tried, with each of the
            others.
        seeds: simulations are run with so many, from 0 on.
        formats: of the trajectories, beside TUM's.
        plots: whether to draw pictures.

    Raises:
        RuledgraphError: for a pattern nothing matches and settings that do not exist.
    """
    varied = {values[0].partition("=")[0] for values in choices if len(values) > 1}
    jobs: list[Job] = []
    for recording in _recordings(patterns):
        simulated = recording.startswith(SIMULATED)
        if simulated:
            simulation_options(recording)
        for chosen in product(*choices):
            config = load_config(config_file, chosen)
            jobs += [
                Job(
                    recording=recording,
                    settings=tuple(s for s in chosen if s.partition("=")[0] in varied),
                    seed=seed,
                    config=config,
                    inputs=inputs.of_recording(_folder(recording), stem(recording)),
                    formats=tuple(formats),
                    plots=plots,
                )
                for seed in (range(seeds) if simulated else (None,))
            ]
    if seeds > 1 and all(job.seed is None for job in jobs):
        raise RuledgraphError(
            "--seeds: a recording has no randomness; name simulations, such as sim:room:free"
        )
    return jobs


def simulation_options(recording: str) -> dict[str, Any]:
    """The options in a `sim:` source.

    Raises:
        RuledgraphError: for one there is not, or without scene and motion.
    """
    name, _, query = recording.removeprefix(SIMULATED).partition("?")
    if not all(name.partition(":")):
        raise RuledgraphError(
            f"{recording}: write sim:SCENE:MOTION, see ruledgraph simulate --list"
        )
    try:
        pairs = parse_qsl(query, keep_blank_values=True)
        return {key: _SIMULATION_OPTIONS[key](value) for key, value in pairs}
    except (KeyError, ValueError):
        raise RuledgraphError(
            f"{recording}: options are {', '.join(_SIMULATION_OPTIONS)}, as of ruledgraph "
            "simulate, with their values"
        ) from None


def _recordings(patterns: Sequence[str]) -> list[str]:
    found: list[str] = []
    for pattern in patterns:
        if pattern.startswith(SIMULATED) or "://" in pattern:
            matches = [pattern]
        else:
            there = Path(pattern).exists()
            # `Path.glob` takes no absolute patterns.
            paths = [pattern] if there else sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207
            matches = [match for path in paths for match in _of_folder(path)]
            if not matches:
                raise RuledgraphError(f"{pattern}: no recording is there")
        found += [match for match in matches if match not in found]
    return found


def _of_folder(path: str) -> list[str]:
    """The recordings in a folder; anything else as it is."""
    return [str(found) for found in recordings_in(Path(path))] if Path(path).is_dir() else [path]


def _folder(recording: str) -> str:
    """Of a path or a URL."""
    return recording.rpartition("/")[0] if "://" in recording else str(Path(recording).parent)


def values_of(setting: str) -> list[str]:
    """`key=1` and `key=2` of `key=1,2`."""
    name, equals, values = setting.partition("=")
    return [f"{name.strip()}{equals}{value.strip()}" for value in values.split(",")]
