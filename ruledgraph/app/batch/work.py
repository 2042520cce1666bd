# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One run of a batch, as a worker does it: a job comes in, its results go back."""

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
from scipy.spatial.transform import Rotation

from ruledgraph.app.batch.jobs import SIMULATED, Job, simulation_options, stem
from ruledgraph.app.outputs import OutputOptions, Outputs
from ruledgraph.app.run_input import RecordedInput, RunInput
from ruledgraph.app.runner import run
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.simulation.options import simulation_from_options


@dataclass(frozen=True)
class Outcome:
    """What came of a run."""

    error: str = ""
    """Why it failed, in a line; empty if it did not."""
    summary: dict[str, Any] = field(default_factory=dict)
    """What `summary.json` holds."""
    files: dict[str, bytes] = field(default_factory=dict)
    """The results' files, by name: no folder need be shared with the worker."""


def run_job(job: Job) -> Outcome:
    """Run it; whatever goes wrong is in the outcome."""
    cv2.setNumThreads(1)  # the workers share the cores
    with tempfile.TemporaryDirectory(prefix="ruledgraph-") as folder:
        output, error, summary = Path(folder, "results"), "", {}
        try:
            summary = _run(job, output, Path(folder))
            error = _failure(summary)
        except RuledgraphError as problem:
            error = str(problem)
        except Exception as problem:  # noqa: BLE001 - the other runs go on
            error = f"{type(problem).__name__}: {problem}".replace("\n", " ")
        files = {
            str(path.relative_to(output)): path.read_bytes()
            for path in output.rglob("*")
            if path.is_file()
        }
    return Outcome(error, summary, files)


def _failure(summary: dict[str, Any]) -> str:
    if summary["ended"] != "complete":
        return str(summary["ended"])
    if summary["frames_estimated"]:
        return ""
    causes = summary.get("likely_causes", [])[:1]
    return "; likely cause: ".join(["no frame could be estimated", *causes])


def _run(job: Job, output: Path, folder: Path) -> dict[str, Any]:
    given = _simulated(job) if job.recording.startswith(SIMULATED) else _recorded(job, folder)
    with Outputs(OutputOptions(plots=job.plots), given.calibration) as outputs:
        summary = run(given, job.config, output, formats=job.formats, observers=[outputs.observe])
    outputs.draw(output, given.ground_truth)
    return summary


def _simulated(job: Job) -> RunInput:
    scene, _, motion = stem(job.recording).partition(":")
    options = simulation_options(job.recording)
    simulation = simulation_from_options(scene, motion, seed=job.seed or 0, **options)
    true = simulation.ground_truth
    quaternions = Rotation.from_matrix(true.rotation).as_quat()
    return RunInput(
        simulation.stream(),
        job.inputs.corrected(simulation.calibration),
        GroundTruth(true.stamps, true.position, quaternions),
        {"recording": job.recording, **job.inputs.summary(), "seed": str(job.seed)},
    )


def _recorded(job: Job, folder: Path) -> RunInput:
    """Of files that are fetched into a folder where they are elsewhere."""
    files = tuple(str(_local(file, folder)) for file in job.inputs.calibration_files)
    known = job.inputs.ground_truth
    truth = known and str(_local(known, folder))
    fetched = replace(job.inputs, calibration_files=files, ground_truth=truth)
    given = RecordedInput.open(_local(job.recording, folder), fetched, job.config)
    return replace(given, names={"recording": job.recording, **job.inputs.summary()})


def _local(source: str, folder: Path) -> Path:
    """A path, of a URL after fetching the file."""
    if "://" not in source:
        return Path(source)
    import fsspec

    try:
        options = {"cache_storage": str(folder), "same_names": True}
        return Path(fsspec.open_local(f"simplecache::{source}", simplecache=options))
    except (OSError, ValueError, ImportError) as error:
        raise RuledgraphError(f"{source}: cannot be fetched: {error}") from None
