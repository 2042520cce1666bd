# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth` of several recordings: a batch without dask, one after the other."""

from collections.abc import Sequence
from pathlib import Path

import click

from ruledgraph.app.batch.cluster import run_in_turn
from ruledgraph.app.batch.jobs import plan
from ruledgraph.app.batch_command import smooth_jobs
from ruledgraph.app.results import default_folder
from ruledgraph.app.smooth_options import SmoothOptions


def smooth_several(recordings: Sequence[Path], options: SmoothOptions) -> None:
    """Smooth several recordings one after the other, as a batch does.

    Raises:
        click.UsageError: for options that go with one recording.
        RuledgraphError: as of `plan`.
    """
    of_one = {
        "--directrices": options.outputs.directrices,
        "--video": options.outputs.video,
        "--rerun": options.outputs.rerun,
        "--ros2-bag": options.outputs.ros2_bag,
        "--solver paper": options.solver == "paper",
        "--verbose": options.verbose,
    }
    if given := next((option for option, value in of_one.items() if value), None):
        raise click.UsageError(f"{given}: works with a single recording only")
    jobs = plan(
        [str(recording) for recording in recordings],
        options.inputs,
        config_file=options.config_file,
        choices=[(setting,) for setting in options.settings],
        formats=options.formats,
        plots=options.outputs.plots,
    )
    folder = options.output or default_folder(recordings[0])
    smooth_jobs(jobs, folder, run_in_turn, force=options.force)
