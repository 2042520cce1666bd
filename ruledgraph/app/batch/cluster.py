# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Has jobs run, by dask's workers or one by one, and takes what comes of them."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from ruledgraph.app.batch.jobs import Job
from ruledgraph.app.batch.work import Outcome, run_job
from ruledgraph.core.errors import RuledgraphError

# How long a scheduler is waited for.
_PATIENCE = "20s"

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkError(RuledgraphError):
    """A piece of work has failed, or its process has ended."""


def run_in_turn(jobs: Sequence[Job], done: Callable[[Job, Outcome], object]) -> None:
    """Run jobs one after the other, each in a process of its own; dask is not needed.

    Args:
        jobs: to be run.
        done: called with each as it ends.
    """
    # A fresh interpreter: what this one has loaded, and its threads, stay out of it.
    context = multiprocessing.get_context("spawn")
    for job in jobs:
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_send, args=(job, theirs), daemon=True)
        process.start()
        theirs.close()
        try:
            outcome = ours.recv()
        except EOFError:
            process.join()
            outcome = Outcome(f"its process ended with exit code {process.exitcode}")
        process.join()
        if outcome.summary.get("ended") == "interrupted":
            raise KeyboardInterrupt
        done(job, outcome)


def _send(job: Job, to: Connection) -> None:
    to.send(run_job(job))


def run_all(
    jobs: Sequence[Job],
    done: Callable[[Job, Outcome], object],
    *,
    workers: int,
    scheduler: str | None = None,
) -> None:
    """Run jobs, each in one of several processes; see `completed`.

    Args:
        jobs: to be run.
        done: called with each as it ends.
        workers: see `completed`.
        scheduler: see `completed`.
    """
    for job, outcome in completed(run_job, jobs, workers=workers, scheduler=scheduler):
        done(job, Outcome(str(outcome)) if isinstance(outcome, WorkError) else outcome)


def completed(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int,
    scheduler: str | None = None,
) -> Iterator[tuple[Item, Result | WorkError]]:
    """Do the work of each item in one of several processes; each with its result, as they end. What
    a worker that dies was at is done by another, unless it was the end of several.

    Args:
        work: a function that can be pickled.
        items: to be worked on; they can be pickled, too.
        workers: processes of this machine, when there is no scheduler.
        scheduler: address of a dask scheduler, such as tcp://host:8786; its workers need
            ruledgraph, and see the recordings under the names that the jobs give.

    Raises:
        RuledgraphError: without dask.distributed, or when the scheduler does not answer.
    """
    if not items:
        return
    try:
        distributed: Any = import_module("distributed")  # it has no types
    except ImportError:
        raise RuledgraphError("batch needs dask.distributed: pip install distributed") from None
    with ExitStack() as stack:
        if scheduler is None:
            cluster = distributed.LocalCluster(
                n_workers=min(workers, len(items)),
                threads_per_worker=1,
                processes=True,
                # None would take a fixed port, and warn when another batch has it.
                dashboard_address="127.0.0.1:0",
                # A worker whose last heartbeat meets the scheduler's end logs an error; what goes
                # wrong with an item comes by its future.
                silence_logs="CRITICAL",
            )
            scheduler_or_cluster = stack.enter_context(cluster)
        else:
            scheduler_or_cluster = scheduler
        try:
            client = stack.enter_context(
                distributed.Client(scheduler_or_cluster, timeout=_PATIENCE)
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise RuledgraphError(f"--scheduler {scheduler}: does not answer: {error}") from None
        futures = {client.submit(work, item, pure=False): item for item in items}
        # A failed one is handed out like the others.
        for future in distributed.as_completed(futures, raise_errors=False):
            item = futures.pop(future)
            if future.status == "finished":
                yield item, future.result()
            else:
                yield item, WorkError(f"{future.status}: {future.exception()}".replace("\n", " "))
            future.release()


def in_parallel(
    work: Callable[[Item], Result], items: Sequence[Item], *, workers: int
) -> Iterator[tuple[Item, Result]]:
    """As `completed`, on this machine.

    Raises:
        WorkError: when the work on an item fails.
    """
    for item, result in completed(work, items, workers=workers):
        if isinstance(result, WorkError):
            raise result
        yield item, result
