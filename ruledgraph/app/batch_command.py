# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph batch`: plans the runs, has them run, keeps what comes of them."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ruledgraph.app import exit_codes
from ruledgraph.app.batch.cluster import run_all
from ruledgraph.app.batch.jobs import Job, plan, values_of
from ruledgraph.app.batch.store import Store
from ruledgraph.app.batch.work import Outcome
from ruledgraph.app.input_options import InputOptions
from ruledgraph.app.summary_text import short_text


def batch_command(
    recordings: Sequence[str],
    *,
    config_file: Path | None,
    settings: Sequence[str],
    seeds: int,
    workers: int,
    scheduler: str | None,
    output: Path,
    force: bool,
    **inputs: Any,
) -> None:
    """See `ruledgraph batch --help`."""
    options = InputOptions.taken_from(inputs)
    choices = [values_of(setting) for setting in settings]
    jobs = plan(recordings, options, config_file=config_file, choices=choices, seeds=seeds)
    smooth_jobs(jobs, output, partial(run_all, workers=workers, scheduler=scheduler), force=force)


def smooth_jobs(
    jobs: Sequence[Job],
    output: Path,
    run: Callable[[Sequence[Job], Callable[[Job, Outcome], object]], None],
    *,
    force: bool,
) -> None:
    """Run those jobs that are not complete, keep what comes of them, and say so.

    Args:
        jobs: of a batch.
        output: folder of the results; what is complete there is not run again, but for `force`.
        run: runs jobs and calls a function with each as it ends.
        force: run all.
    """
    store = Store(output)
    wanted = [job for job in jobs if force or store.error(job) != ""]
    if kept := len(jobs) - len(wanted):
        click.echo(f"{kept} of {len(jobs)} runs are there already; --force runs them again")
    interrupted = False
    try:
        if wanted:
            with _progress(len(wanted)) as show:

                def done(job: Job, outcome: Outcome) -> None:
                    store.put(job, outcome)
                    show(job, outcome)

                run(wanted, done)
    except KeyboardInterrupt:
        interrupted = True
        click.echo("interrupted: the same command goes on where it was", err=True)
    finally:
        tables = store.write_tables(jobs)
    failed = [job for job in jobs if store.error(job)]
    for job in failed:
        click.echo(f"failed: {job.name}: {store.error(job)}", err=True)
    there = sum(store.error(job) == "" for job in jobs)
    click.echo(f"{there} of {len(jobs)} runs are complete, {len(failed)} failed")
    for path in tables:
        click.echo(str(path))
    if there < len(jobs):
        sys.exit(exit_codes.INTERRUPTED if interrupted else exit_codes.SOME_FAILED)


@contextmanager
def _progress(total: int) -> Iterator[Callable[[Job, Outcome], None]]:
    """One bar on a terminal, elsewhere a line for each run."""
    if not sys.stderr.isatty():
        count = 0

        def tell(job: Job, outcome: Outcome) -> None:
            nonlocal count
            count += 1
            result = "failed" if outcome.error else short_text(outcome.summary)
            click.echo(f"{count}/{total} {job.name}: {result}", err=True)

        yield tell
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failed]} failed"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("batch", total=total, failed=0)
        failed = 0

        def show(job: Job, outcome: Outcome) -> None:
            nonlocal failed
            failed += bool(outcome.error)
            bar.update(task, advance=1, failed=failed, description=job.name[:40])

        yield show
