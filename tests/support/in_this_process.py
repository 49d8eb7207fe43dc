"""What stands in for processes of this machine where only what is made of their answers counts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Generic, Self, TypeVar

import pytest

from geoident.workflow.executing.executor import Answered, SetUp

T = TypeVar("T")
R = TypeVar("R")


class InThisProcess(Generic[T, R]):
    """Takes the arguments of `LocalProcesses`, and answers tasks by itself, one after the other."""

    def __init__(self, jobs: int, set_up: SetUp[T, R], **_limits: Any) -> None:
        self._answer = set_up()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *told: object) -> None:
        pass

    def run(self, tasks: Iterable[T]) -> Iterator[Answered[R]]:
        for number, task in enumerate(tasks):
            yield Answered(number, self._answer(task), seconds=0.1)


def stay_in_this_process(patch: pytest.MonkeyPatch) -> None:
    """Meanwhile several cases and the runs of campaigns start no process: each takes seconds.

    That they work in processes is asked in `tests/workflow/executing`, and of one command each.
    """
    for module in ("workflow.executing.processes", "workflow.campaign.campaign"):
        patch.setattr(f"geoident.{module}.LocalProcesses", InThisProcess)
