"""Tasks in threads that wait for programs: several at a time, ended together."""

import threading
import time

import pytest

from geoident.errors import Interrupted
from geoident.workflow.executing.executor import in_order
from geoident.workflow.executing.threads import WaitingThreads


def never():
    """Nobody wishes a stop."""


def test_as_many_run_at_a_time_as_there_are_threads():
    both = threading.Barrier(2, timeout=60)

    def work(task):
        both.wait()  # no task ends alone
        return task * task

    threads = WaitingThreads(2, work, check=never, end=never)
    assert [answer.value for answer in in_order(threads.run(range(6)))] == [0, 1, 4, 9, 16, 25]


def test_what_is_not_wanted_any_more_is_ended():
    ended, begun = threading.Event(), []

    def work(task):
        begun.append(task)
        if task:
            assert ended.wait(20)
        return task

    answers = WaitingThreads(2, work, check=never, end=ended.set).run(range(100))
    assert next(answers).value == 0
    answers.close()
    assert ended.is_set()
    assert len(begun) < 10


def test_tasks_go_on_while_nobody_asks_for_an_answer():
    begun = []
    answers = WaitingThreads(1, begun.append, check=never, end=never).run(range(5))
    next(answers)
    over = time.monotonic() + 60
    while len(begun) < 5 and time.monotonic() < over:
        time.sleep(0.01)
    assert begun == [0, 1, 2, 3, 4]
    assert len(list(answers)) == 4


def test_a_wish_to_stop_and_an_error_end_all():
    ended = threading.Event()

    def check():
        raise Interrupted("enough")

    with pytest.raises(Interrupted):
        next(WaitingThreads(1, never, check=check, end=ended.set).run([1]))

    def broken(task):
        raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        list(WaitingThreads(1, broken, check=never, end=ended.set).run(range(3)))
