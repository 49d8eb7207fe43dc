"""What processes would answer, and a cluster, without waiting for any to begin."""

import pickle
from contextlib import chdir

from geoident.workflow.executing.executor import Answered
from geoident.workflow.executing.parcel import packed

LOCAL = (
    "geoident.workflow.executing.processes",
    "geoident.workflow.campaign.campaign",
    "geoident.workflow.project.models",
    "geoident.workflow.running.workers",
)
"""Modules that have `LocalProcesses`."""


def sent(thing):
    """As it comes out on the other side."""
    return pickle.loads(pickle.dumps(thing))


class InThisProcess:
    """An executor in place of `LocalProcesses` that answers in this process."""

    @classmethod
    def __class_getitem__(cls, kinds):
        return cls

    def __init__(self, jobs, set_up, **given):
        self.answer = sent(set_up)()

    def __enter__(self):
        return self

    def __exit__(self, *told):
        pass

    def ask_to_stop(self):
        self.stopped = True

    kill = ask_to_stop

    def run(self, tasks):
        for number, task in enumerate(tasks):
            yield Answered(number, sent(self.answer(sent(task))), seconds=0.1)


class ClusterHere(InThisProcess):
    """A cluster whose tasks are answered in this process, in a folder of their own.

    Args:
        folder: which is made, for the files that travel there.
    """

    used, workers = False, 2

    def __init__(self, folder):
        self.folder, self.answered = folder, 0

    def require(self):
        pass

    def begin(self, set_up, parcel=None, *, check=None):
        self.used, parcel = True, parcel or packed()
        self.place = parcel.unpack(self.folder)
        with chdir(self.place):
            self.inside = sent(set_up)()
        return self

    def answer(self, task):
        self.answered += 1
        with chdir(self.place):
            return self.inside(task)
