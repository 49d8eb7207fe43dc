"""What a run on a cluster costs beyond the run itself: for each task, and for each MB of files.

    PYTHONPATH=. python tests/benchmarks/cluster_overhead.py [RUNS]

Workers of dask on this machine, one scheduler, against processes of this command. All figures are
of a busy machine; their ratios are what counts.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from geoident.model.cluster import Cluster
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.parcel import packed
from geoident.workflow.executing.processes import LocalProcesses

WORKERS = 2
MEGABYTE = 1_000_000


def trivial(executor, runs):
    """Seconds of tasks that do nothing, and those of this process among them."""
    list(executor.run([(0, 0)] * 2 * WORKERS))
    began, own = time.monotonic(), time.process_time()
    count = sum(1 for _ in executor.run((n, 0) for n in range(runs)))
    assert count == runs
    return time.monotonic() - began, time.process_time() - own


def bytes_of():
    """A task is any thing and a number: so many bytes come back."""
    return _bytes


def _bytes(task):
    return bytes(task[1])


def files(megabytes):
    """Seconds until workers have a parcel and its files lie there, beyond those of an empty one."""

    def seconds(parcel):
        began = time.monotonic()
        with DaskCluster(Cluster(), bytes_of, parcel, jobs=WORKERS) as executor:
            list(executor.run([(0, 0)] * WORKERS))
            return time.monotonic() - began

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh"
        path.write_bytes(np.random.default_rng(0).bytes(megabytes * MEGABYTE))
        return seconds(packed([path])) - seconds(packed())


def main():
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    with LocalProcesses(WORKERS, bytes_of) as processes:
        local, _ = trivial(processes, runs)
    each = 1e3 / runs
    print(f"{runs} trivial runs in {WORKERS} processes: {local:.1f} s, {local * each:.2f} ms each")
    with DaskCluster(Cluster(), bytes_of, packed(), jobs=WORKERS) as executor:
        dask, own = trivial(executor, runs)
        began = time.monotonic()
        used = time.process_time()
        large = sum(len(a.value) for a in executor.run([(0, 10 * MEGABYTE)] * 20)) / MEGABYTE
        back, here = (time.monotonic() - began) / large, (time.process_time() - used) / large
    print(f"{runs} trivial runs on a cluster: {dask:.1f} s, {dask * each:.2f} ms each")
    print(f"    of it in this command and the scheduler: {own * each:.2f} ms each")
    print(f"answers: {1e3 * back:.1f} ms for each MB, of it here {1e3 * here:.1f}")
    print(f"files: {1e3 * files(50) / 50 / WORKERS:.1f} ms for each MB and worker")


if __name__ == "__main__":  # other processes find functions by the name of their module
    from tests.benchmarks import cluster_overhead

    cluster_overhead.main()
