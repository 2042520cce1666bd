# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One run of a batch, as a worker does it: a job comes in, its results go back."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
from scipy.spatial.transform import Rotation

from ruledgraph.app.batch.jobs import SIMULATED, Job, simulation_options, stem
from ruledgraph.app.outputs import OutputOptions, Outputs
from ruledgraph.app.runner import Source, run
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Measurement
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.recording import Recording, open_recording
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
    return "" if summary["frames_estimated"] else "no frame could be estimated"


@dataclass(frozen=True)
class _Reader(Source):
    recording: Recording

    def warnings(self) -> list[str]:
        return self.recording.report.warnings


def _run(job: Job, output: Path, folder: Path) -> dict[str, Any]:
    about = {"recording": job.recording, **job.inputs.summary()}
    source = Source()
    truth: GroundTruth | None
    measurements: Iterator[Measurement]
    if job.recording.startswith(SIMULATED):
        scene, _, motion = stem(job.recording).partition(":")
        options = simulation_options(job.recording)
        simulation = simulation_from_options(scene, motion, seed=job.seed or 0, **options)
        true = simulation.ground_truth
        quaternions = Rotation.from_matrix(true.rotation).as_quat()
        truth = GroundTruth(true.stamps, true.position, quaternions)
        measurements = simulation.stream()
        calibration = job.inputs.corrected(simulation.calibration)
        about["seed"] = str(job.seed)
    else:
        path = _local(job.recording, folder)
        recording = open_recording(path, **job.inputs.choice)
        source = _Reader(recording)
        files = tuple(str(_local(file, folder)) for file in job.inputs.calibration_files)
        calibration = replace(job.inputs, calibration_files=files).calibration(path, recording)
        known = job.inputs.ground_truth
        truth = read_ground_truth(str(_local(known, folder)), recording) if known else None
        measurements = recording.stream()
    with Outputs(OutputOptions(plots=job.plots), calibration) as outputs:
        summary = run(
            measurements,
            calibration,
            job.config,
            output,
            ground_truth=truth,
            inputs=about,
            source=source,
            formats=job.formats,
            observers=[outputs.observe],
        )
    outputs.draw(output, truth)
    return summary


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
