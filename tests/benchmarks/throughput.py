"""What many runs cost beside their models, and how much two processes give.

    python tests/benchmarks/throughput.py [--runs 10000] [--points 24] [--tasks 10000]

prints
- tasks that do nothing through the executor, and runs of a closed form through a campaign
  (``--runs``), by the clock and in processor seconds; what a run costs beside its model, whose
  processor seconds are measured by itself; the size of the folder, and how long it takes to know
  that all runs are up to date;
- a scan of cases/cavern without its reduced model on a grid of ``--points`` by ``--points``, and a
  campaign of eight scans with a third of the points an axis and other ground, with one process and
  with two: the ratio of their throughputs. 1.7 is asked for; it needs a machine on which nothing
  else runs, so processor seconds are printed beside it: where they stay the same, the work is
  shared out and not repeated. A process takes more than a second to begin, so the scan by one
  should take half a minute or more.

One thread in each process, so that both do the same sums; results are compared bit for bit.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

import geoident
from geoident.io.result.file import read_result
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.workflow.campaign.campaign import compute, local_executor
from geoident.workflow.campaign.plan import plan_campaign
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import (
    NO_READINGS,
    Request,
    build_model,
    load_inputs,
    plan_scan,
    start_values,
)
from geoident.workflow.scan import scan
from tests.support.tasks import nothing

ROOT = Path(__file__).resolve().parents[2]
OPENING = Path(geoident.__file__).parent / "templates" / "opening"


@dataclass
class Spent:
    """Seconds by the clock, and of processors in all processes that have ended."""

    wall: float = 0.0
    processor: float = 0.0


@contextmanager
def spent() -> Iterator[Spent]:
    """What happens meanwhile."""
    found, began, before = Spent(), time.perf_counter(), _processor()
    yield found
    found.wall, found.processor = time.perf_counter() - began, _processor() - before


def _processor() -> float:
    both = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    usages = [resource.getrusage(who) for who in both]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def tasks(count: int, jobs: int) -> Spent:
    """Tasks that do nothing, without the start of the processes."""
    with LocalProcesses[int, int](jobs, nothing) as processes:
        list(processes.run(range(10 * jobs)))
        with spent() as found:
            assert sum(1 for _ in processes.run(range(count))) == count
    return found


def campaign(folder: Path, text: str, jobs: int) -> Spent:
    """A campaign, with the start of its processes."""
    file = folder / "campaign.yaml"
    file.write_text(f"format: geoident-campaign/1\n{text}")
    with spent() as found:
        plan = plan_campaign(str(file), output=str(folder / f"out-{jobs}"), fresh=True)
        with local_executor(plan, jobs) as executor:
            table = compute(plan, executor, lambda record: None, runs_csv, fresh=True)
    assert table.exit_code in (0, 4), [run.reason for run in table.failed][:1]
    return found


def model_alone(case: Path, times: int = 100) -> float:
    """Processor seconds of the model of a run by itself: built, and asked for all readings."""
    inputs = load_inputs(str(case), overrides=[NO_READINGS])
    began = time.process_time()
    for number in range(times + 1):
        model = build_model(inputs)
        model.survey(start_values(model.case, model), fields=False)
        if not number:  # what is imported and found once
            began = time.process_time()
    return (time.process_time() - began) / times


def known_again(folder: Path, jobs: int) -> Spent:
    """The same campaign again, when all its runs are up to date."""
    with spent() as found:
        plan = plan_campaign(str(folder / "campaign.yaml"), output=str(folder / f"out-{jobs}"))
        with local_executor(plan, jobs) as executor:
            compute(plan, executor, lambda record: None, runs_csv)
    assert not plan.remaining
    return found


def scanned(folder: Path, points: int, jobs: int) -> tuple[Spent, np.ndarray]:
    """A scan of cases/cavern, and its grid."""
    place = folder / f"scan-{jobs}"
    place.mkdir()
    said = (f"fit.scan.points={points}", "fit.reduced=false")
    job = plan_scan(Request(str(folder / "case.yaml"), said, str(place), fresh=True))
    with spent() as found:
        finished = scan(job, Control(jobs=jobs))
    grid = read_result(finished.paths[0]).grid
    assert grid is not None
    return found, grid.objective


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--points", type=int, default=24)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for jobs in (1, 2):
            found = tasks(given.tasks, jobs)
            _say(f"{given.tasks} tasks that do nothing, -j {jobs}", found, given.tasks)
        shutil.copytree(OPENING, folder / "opening")
        sampled = (
            "command: simulate\ncase: case.yaml\nvariations:\n  sample: {count: COUNT, seed: 1, "
            "values: {parameters.E_rock.start: {from: 1 GPa, to: 9 GPa, scale: log}}}\n"
        ).replace("COUNT", str(given.runs))
        for jobs in (1, 2) if given.runs else ():
            place = folder / "opening"
            found = campaign(place, sampled, jobs)
            _say(f"{given.runs} runs of a closed form, -j {jobs}", found, given.runs)
            model = model_alone(place / "case.yaml")
            each = found.wall * jobs / given.runs - model, found.processor / given.runs - model
            print(
                f"  beside the model ({1e3 * model:.1f} ms): {1e3 * each[0]:.1f} ms of a process, "
                f"{1e3 * each[1]:.1f} ms of processors"
            )
            size = sum(path.stat().st_size for path in (place / f"out-{jobs}").iterdir())
            again = known_again(place, jobs)
            print(f"  folder: {1e-6 * size:.0f} MB; known to be up to date in {again.wall:.1f} s")
        shutil.copytree(ROOT / "cases" / "cavern", folder / "cavern")
        if given.points:
            cavern(folder / "cavern", given.points)


def cavern(folder: Path, points: int) -> None:
    """Scans of cases/cavern by one process and by two."""
    one, grid = scanned(folder, points, 1)
    two, other = scanned(folder, points, 2)
    _say(f"scan of cases/cavern, {points} x {points} points, -j 1", one, points**2)
    _say(f"scan of cases/cavern, {points} x {points} points, -j 2", two, points**2)
    _ratio(one, two)
    print(f"  the same to the last bit: {np.array_equal(grid, other)}")
    nu = ", ".join(f"{0.2 + 0.01 * k:.2f}" for k in range(8))
    text = (
        f"command: scan\ncase: case.yaml\nset: {{fit.scan.points: {max(points // 3, 2)}, "
        f"fit.reduced: false}}\nvariations: {{product: {{materials.rock.nu: [{nu}]}}}}\n"
    )
    alone, both = campaign(folder, text, 1), campaign(folder, text, 2)
    _say("campaign of 8 scans of cases/cavern, -j 1", alone, 8)
    _say("campaign of 8 scans of cases/cavern, -j 2", both, 8)
    _ratio(alone, both)


def _say(what: str, found: Spent, count: int) -> None:
    each = 1e3 * found.wall / count
    print(f"{what}: {found.wall:.1f} s, {found.processor:.1f} s of processors, {each:.2f} ms each")


def _ratio(one: Spent, two: Spent) -> None:
    work = two.processor / one.processor
    print(f"  throughput of two by one: {one.wall / two.wall:.2f}; work of two by one: {work:.2f}")


if __name__ == "__main__":
    main()
