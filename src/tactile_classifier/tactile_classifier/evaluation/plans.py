# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run several analyses as one list of tasks, with one pool of workers and one progress bar."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
import threading
import time
from typing import Any, Protocol, TypeVar
import warnings

from joblib import delayed, Parallel
import sklearn

from tactile_classifier.errors import EvaluationError
from tactile_classifier.estimators.classifiers import on_one_thread

Result = TypeVar('Result', covariant=True)
Task = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""

INTERRUPTED_S = 10.0
"""After an interrupt, longest time to wait for running tasks [s]."""


class Plan(Protocol[Result]):
    """An analysis whose tasks are known before it starts."""

    def tasks(self) -> list[Task]:
        """Return the tasks, which are independent of each other."""

    def finish(self, answers: Sequence[Any]) -> Result:
        """Return the result; the answers are in the order of the tasks."""


class Attempt:
    """`Plan` of one call; its result is that of the function, or the EvaluationError it raised."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self._task: Task = (_attempt, (function, *arguments))

    def tasks(self) -> list[Task]:
        """Return the call as the only task."""
        return [self._task]

    def finish(self, answers: Sequence[Any]) -> Any:
        """Return the result of the function that this plan calls."""
        return answers[0]


def _attempt(function: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return function(*arguments)
    except EvaluationError as error:
        return error


@on_one_thread
def run_plans(
    plans: Sequence[Plan[Any]],
    jobs: int | None = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Any]:
    """Run the tasks of all plans; return the results of the plans in their order.

    joblib uses threads, unless `joblib.parallel_config` selects another backend. Most of the time
    is spent in compiled code, which threads can run in parallel; processes would need seconds to
    import it. Meanwhile, linear algebra uses one thread, because more threads would compete with
    the pool.

    ``jobs`` is the number of workers as in joblib; -1 uses all cores. ``progress(done, total)`` is
    called after each task.
    """
    parts = [plan.tasks() for plan in plans]
    total = sum(map(len, parts))
    work = (delayed(_run)(*task) for tasks in parts for task in tasks)
    answers = []
    before = set(threading.enumerate())
    coming = Parallel(n_jobs=jobs, prefer='threads', return_as='generator')(work)
    try:
        for answer in coming:
            answers.append(answer)
            progress(len(answers), total)
    except BaseException:
        _end_pool(coming, before)
        raise
    results, first = [], 0
    for plan, tasks in zip(plans, parts, strict=True):
        results.append(plan.finish(answers[first : first + len(tasks)]))
        first += len(tasks)
    return results


def _run(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Run a task without parameter checks of scikit-learn, which can take longer than a fit."""
    with sklearn.config_context(skip_parameter_validation=True):
        return function(*arguments)


def _end_pool(coming: Generator[Any, None, None], before: set[threading.Thread]) -> None:
    """End joblib's generator, and wait for its threads.

    When Python exits, it kills daemon threads. If a thread is in C++ code at that time, the
    process aborts.
    """
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # joblib warns of cancelled tasks
        coming.close()
    until_s = time.monotonic() + INTERRUPTED_S
    for thread in set(threading.enumerate()) - before:
        thread.join(max(0.0, until_s - time.monotonic()))
