"""A campaign on a cluster: the same results, written as they come, whatever happens there."""

import errno
import shutil
from contextlib import chdir, contextmanager
from pathlib import Path

import h5py
import pytest

import geoident
from geoident.errors import ExitCode, InputError, LostCluster, OutputError
from geoident.model.cluster import Cluster
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.workflow.campaign import away
from geoident.workflow.campaign.away import AwayRuns, cluster_executor, compute_away
from geoident.workflow.campaign.campaign import compute
from geoident.workflow.campaign.one_run import RunTask
from geoident.workflow.campaign.one_run import compute as compute_run
from geoident.workflow.campaign.plan import plan_campaign
from geoident.workflow.campaign.runs import read_runs
from geoident.workflow.executing.executor import Answered

OPENING = Path(geoident.__file__).parent / "templates" / "opening"
VARY = "variations: {product: {parameters.E_rock.start: [1 GPa, 2 GPa, 3 GPa]}}"
PLAIN = "fit.backtest: false, fit.model_error: none, fit.mesh_error: false"
PLAIN += ", fit.closed-form.starts: 1"
"""A fit and nothing more: what is computed there is not what is asked here."""
OF_EACH_RUN = {"created", "seconds"}


@pytest.fixture
def here(tmp_path, monkeypatch):
    for path in OPENING.iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    write(f"set: {{{PLAIN}}}\n{VARY}")
    return tmp_path


def write(text):
    Path("campaign.yaml").write_text(f"format: geoident-campaign/1\ncase: case.yaml\n{text}\n")


def content(path):
    """All that a result holds, but for when and how long."""
    found = {}

    def take(name, item):
        found.update({f"{name}@{key}": repr(value) for key, value in item.attrs.items()
                      if key not in ("DIMENSION_LIST", "REFERENCE_LIST")})  # fmt: skip
        if isinstance(item, h5py.Dataset):
            value = item[()]
            found[name] = repr(value.tolist() if hasattr(value, "tolist") else value)

    with h5py.File(path) as file:
        file.visititems(take)
        found.update({key: repr(value) for key, value in file.attrs.items()})
    return {key: value for key, value in found.items() if key not in OF_EACH_RUN}


def serial(plan):
    """The same runs, one after the other in this process."""
    plan.folder.mkdir()
    return [compute_run(RunTask(plan.campaign, plan.folder, run)) for run in plan.runs]


class There:
    """A cluster in this process, in a folder of its own; it may be lost after some tasks."""

    def __init__(self, place, parcel_of, lose_after=None):
        self.place, self.parcel_of, self.lose_after = place, parcel_of, lose_after

    def run(self, tasks):
        for number, task in enumerate(tasks):
            if number == self.lose_after:
                raise LostCluster("tcp://node1:8786", 1.0)
            with chdir(self.place):
                end = compute_away(task)
            yield Answered(number, end, seconds=0.1)


@pytest.fixture
def there(here, tmp_path_factory):
    place = tmp_path_factory.mktemp("there")
    for path in OPENING.iterdir():
        shutil.copy(path, place)
    return place


def computed(executor, **given):
    plan = plan_campaign("campaign.yaml", **given)
    return compute(plan, AwayRuns(executor, plan), lambda record: None, runs_csv), plan


@pytest.mark.slow  # those on this machine are quick
def test_results_of_a_cluster_are_those_of_the_serial_run_bit_for_bit(here, cluster):
    write(f"command: simulate\n{VARY}")
    plan = plan_campaign("campaign.yaml", output=str(here / "away"))
    where = Cluster(address=cluster.address)
    with cluster_executor(plan, where, 1, lambda message: None) as executor:
        table = compute(plan, AwayRuns(executor, plan), lambda record: None, runs_csv)
    assert table.exit_code == 0
    expected = serial(plan_campaign("campaign.yaml", output="here"))
    for run, one in zip(table.runs, expected, strict=True):
        assert repr(run.readings) == repr(one.readings)
        assert content(f"away/{run.file}") == content(f"here/{one.file}")
    assert not plan_campaign("campaign.yaml", output=str(here / "away")).remaining


def test_a_cluster_that_is_lost_leaves_what_had_ended(there):
    write(f"command: simulate\n{VARY}")
    with pytest.raises(LostCluster) as caught:
        computed(There(there, None, lose_after=1))
    assert caught.value.exit_code == ExitCode.SOME_FAILED
    assert [run.name for run in read_runs("campaign.batch").runs] == ["0001"]
    assert Path("campaign.batch/runs.csv").is_file()
    table, plan = computed(There(there, None))
    assert len(plan.remaining) == 2
    assert table.exit_code == 0


def test_a_disk_that_is_full_here_ends_the_campaign_and_costs_nothing_that_is_there(
    there, monkeypatch
):
    write(f"command: simulate\n{VARY}")
    whole, written = away.atomic_output, []

    @contextmanager
    def full(path, **given):
        with whole(path, **given) as temporary:
            yield temporary
            written.append(path)
            if len(written) == 2:
                raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(away, "atomic_output", full)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        computed(There(there, None))
    assert caught.value.exit_code == ExitCode.OUTPUT
    assert sorted(path.name for path in Path("campaign.batch").glob("*.h5")) == ["0001.simulate.h5"]
    _, plan = computed(There(there, None))
    assert [run.name for run in plan.remaining] == ["0002", "0003"]


def test_a_result_of_other_input_is_kept_beside(there):
    one = VARY.replace(", 2 GPa, 3 GPa", "")
    write(f"set: {{{PLAIN}}}\n{one}")
    computed(There(there, None))
    write(f"set: {{{PLAIN}, materials.rock.nu: 0.3}}\n{one}")
    computed(There(there, None))
    names = sorted(path.name for path in Path("campaign.batch").glob("0001*"))
    assert names == ["0001.fit.1.h5", "0001.fit.h5"]


def test_a_file_that_is_named_by_its_place_here_is_refused(here):
    readings = str(here / "readings.csv")
    case = Path("case.yaml")
    case.write_text(case.read_text().replace("readings: readings.csv", f"readings: {readings}"))
    with pytest.raises(InputError, match="is not in this place on a cluster") as caught:
        cluster_executor(plan_campaign("campaign.yaml"), Cluster(), 1, lambda message: None)
    assert readings in str(caught.value)
