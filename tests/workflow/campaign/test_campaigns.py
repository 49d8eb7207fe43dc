"""Campaigns of a closed-form case: what is computed, known, failed and written."""

import csv
import errno
import io
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import geoident
from geoident.errors import ExitCode, InputError, ModelError, OutputError
from geoident.io.result.campaign import RunJournal
from geoident.io.result.file import read_result, write_result
from geoident.io.text.atomic import output_error
from geoident.model.results.many.campaign import CampaignTable, RunRecord
from geoident.report.drawing.campaign import campaign_pictures
from geoident.report.page.many import page_of_many
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.report.text.campaign.tables import campaign_text, outcome_sentences
from geoident.workflow.campaign.campaign import compute
from geoident.workflow.campaign.one_run import compute as compute_run
from geoident.workflow.campaign.plan import plan_campaign
from geoident.workflow.campaign.runs import read_runs
from geoident.workflow.executing.executor import Answered
from geoident.workflow.simulate import simulate
from tests.support.commands import run_command

OPENING = Path(geoident.__file__).parent / "templates" / "opening"
QUICK = "set: {fit.backtest: false, fit.closed-form.starts: 1}"


class Here:
    """An executor in this process, which can lose a task or stop before it."""

    def __init__(self, *, lose=(), stop_at=None):
        self.lose, self.stop_at, self.begun = lose, stop_at, []

    def run(self, tasks):
        for number, task in enumerate(tasks):
            name = task.run.name
            if name == self.stop_at:
                return
            self.begun.append(name)
            if name in self.lose:
                yield Answered(number, None, ("was killed (SIGKILL; out of memory?)",) * 3)
            else:
                yield Answered(number, compute_run(task), seconds=0.1)


@pytest.fixture
def here(tmp_path, monkeypatch):
    for path in OPENING.iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(text, name="campaign.yaml"):
    Path(name).write_text(f"format: geoident-campaign/1\ncase: case.yaml\n{text}\n")
    return name


SIMULATED = """command: simulate
variations:
  product:
    parameters.E_rock.start: [1 GPa, 2 GPa]
    parameters.c.start: [0.8 MPa, 1.5 MPa]"""


TWO = SIMULATED[: SIMULATED.index("\n    parameters.c")]


def computed(name="campaign.yaml", executor=None, **given):
    plan = plan_campaign(name, **given)
    executor = executor or Here()
    seen = []
    table = compute(plan, executor, seen.append, runs_csv, fresh=given.get("fresh", False))
    return table, executor, seen


def rows(folder="campaign.batch"):
    return list(csv.DictReader(io.StringIO(Path(folder, "runs.csv").read_text())))


def test_runs_of_a_product_are_those_of_single_commands_bit_for_bit(here):
    table, executor, seen = computed(write(SIMULATED))
    assert executor.begun == ["0001", "0002", "0003", "0004"]
    assert seen == list(table.runs)
    assert table.exit_code == 0
    single = run_command(
        "simulate", "case.yaml", "--json",
        "--set", "parameters.E_rock.start=2 GPa", "--set", "parameters.c.start=0.8 MPa",
    )  # fmt: skip
    expected = [reading["value"] for reading in json.loads(single.stdout)["readings"]]
    assert [reading.value for reading in table.runs[2].readings] == expected
    with h5py.File("campaign.batch/campaign.h5") as file:
        assert file["readings/value"][2].tolist() == expected
        assert file["settings/value"][2].tolist() == [b"2 GPa", b"0.8 MPa"]
        assert file.attrs["total"] == 4
    result = read_result("campaign.batch/0003.simulate.h5")
    assert result.kind == "simulate"
    assert result.gauges.readings.value.tolist() == expected
    assert rows()[2]["parameters.E_rock.start"] == "2 GPa"


def test_fits_have_the_numbers_of_single_fits(here):
    table, _, _ = computed(
        write(f"{QUICK}\nvariations: {{rows: [{{run: soft, parameters.E_rock.start: 1 GPa}}]}}")
    )
    run_command(
        "fit", "case.yaml", "--set", "fit.backtest=false", "--set", "fit.closed-form.starts=1",
        "--set", "parameters.E_rock.start=1 GPa",
    )  # fmt: skip
    single, (run,) = read_result("case.fit.h5"), table.runs
    assert [p.value for p in run.parameters] == single.parameters.values.tolist()
    assert [p.lower95 for p in run.parameters] == single.parameters.lower95.tolist()
    assert (run.objective, run.counts) == (single.objective, single.counts)
    (row,) = rows()
    assert float(row["E_rock [GPa]"]) == pytest.approx(1e-9 * single.parameters.values[0])
    assert row["file"] == "soft.fit.h5"


def test_what_is_up_to_date_is_not_computed_again(here):
    computed(write(TWO))
    _, again, _ = computed()
    assert again.begun == []
    more = TWO.replace("2 GPa]", "2 GPa, 3 GPa]")
    table, added, _ = computed(write(more))
    assert added.begun == ["0003"]
    assert len(table.runs) == 3
    Path("campaign.batch/0002.simulate.h5").unlink()
    _, lost, _ = computed()
    assert lost.begun == ["0002"]
    case = Path("case.yaml")
    case.write_text(case.read_text().replace("nu: 0.25", "nu: 0.3"))
    _, changed, _ = computed()
    assert len(changed.begun) == 3
    _, fresh, _ = computed(fresh=True)
    assert len(fresh.begun) == 3


def test_readings_of_the_case_are_no_part_of_a_simulation(here):
    write("command: simulate\nvariations: {product: {materials.rock.nu: [0.2, 0.3]}}")
    computed()
    readings, case = Path("readings.csv"), Path("case.yaml")
    lines = readings.read_text().splitlines(keepends=True)
    readings.write_text("".join(lines[:-1]))
    assert not plan_campaign("campaign.yaml").remaining
    text = case.read_text()
    case.write_text(text.replace("readings: readings.csv", "readings: []"))
    assert not plan_campaign("campaign.yaml").remaining
    assert str(readings) in {Path(name).name for name in _read("campaign.yaml", text)}
    write("command: scan\nset: {fit.scan.points: 3}\nvariations: {rows: [{run: one}]}", "s.yaml")
    before = plan_campaign("s.yaml").runs
    readings.write_text("".join(lines))
    assert plan_campaign("s.yaml").runs != before  # which a misfit depends on


def _read(name, text):
    """What no output of a campaign may replace, with another text of its case."""
    Path("case.yaml").write_text(text)
    return plan_campaign(name).inputs


def test_tables_are_written_again_only_where_they_are_not_those_of_the_runs(here):
    first, _, _ = computed(write(SIMULATED))
    csv, journal = Path("campaign.batch/runs.csv"), Path("campaign.batch/runs.jsonl")

    def stamps():
        return csv.stat().st_mtime_ns, journal.stat().st_mtime_ns

    before, text = stamps(), csv.read_text()
    again, _, seen = computed()
    assert (repr(again.runs), seen) == (repr(first.runs), [])
    assert stamps() == before
    csv.unlink()
    computed()
    assert csv.read_text() == text
    csv.write_text("cut short")
    os.utime(csv, ns=(before[0], before[1] - 10**9))  # the command ended between both
    computed()
    assert csv.read_text() == text
    computed(write(SIMULATED.replace("1 GPa, 2 GPa", "1 GPa")))
    assert len(rows()) == 2


def test_a_campaign_that_was_cut_short_goes_on(here):
    cut, first, _ = computed(write(SIMULATED), Here(stop_at="0003"))
    assert first.begun == ["0001", "0002"]
    assert len(cut.runs) == 2
    assert "2 runs have not ended" in campaign_text(read_runs("campaign.batch"), title="")
    journal = Path("campaign.batch/runs.jsonl")
    journal.write_text(journal.read_text() + '{"name": "0003", "key":')  # power failed here
    table, second, _ = computed()
    assert second.begun == ["0003", "0004"]
    assert [run.name for run in table.runs] == ["0001", "0002", "0003", "0004"]


def test_failed_runs_are_named_and_only_those_that_may_end_otherwise_are_repeated(
    here, monkeypatch
):
    def no_solution(*arguments, overrides, **given):
        if "parameters.c.start=1 MPa" in overrides:
            raise ModelError("the ground collapses")
        return simulate(*arguments, overrides=overrides, **given)

    monkeypatch.setattr("geoident.workflow.campaign.one_run.simulate", no_solution)
    names = "{run: good}, {run: lost}, {run: never, parameters.c.start: 1 MPa}"
    write(f"command: simulate\nvariations: {{rows: [{names}]}}")
    table, _, _ = computed(executor=Here(lose=["lost"]))
    ended = {run.name: run for run in table.runs}
    assert ended["good"].exit_code == 0
    assert (ended["never"].exit_code, ended["never"].reason) == (5, "the ground collapses")
    assert ended["lost"].status == "set-aside"
    assert "it has cost 3 processes" in ended["lost"].reason
    assert table.exit_code == 7
    assert rows()[1]["processes_lost"] == "3"
    again, executor, _ = computed()
    assert executor.begun == ["lost"]
    assert again.exit_code == 7
    page = page_of_many(again, draw=lambda pictures: [])
    assert "never" in page


def test_a_run_with_a_bug_leaves_its_log(here, monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError("nobody thought of it")

    monkeypatch.setattr("geoident.workflow.campaign.one_run.simulate", fail)
    table, _, _ = computed(write("command: simulate\nvariations: {rows: [{run: a}]}"))
    assert table.runs[0].exit_code == 1
    assert "nobody thought of it" in table.runs[0].reason
    assert "ZeroDivisionError" in Path("campaign.batch/a.log").read_text()


def test_runs_without_memory_or_disk_are_named_and_begun_again_by_the_same_command(
    here, monkeypatch
):
    runs = "{run: large, parameters.c.start: 1 MPa}, {run: last, parameters.c.start: 2 MPa}"
    write(f"command: simulate\nvariations: {{rows: [{runs}, {{run: fine}}]}}")

    def fails(*arguments, overrides, **given):
        if "parameters.c.start=1 MPa" in overrides:
            raise MemoryError
        if "parameters.c.start=2 MPa" in overrides:
            raise output_error("last.h5", OSError(errno.ENOSPC, "No space left on device"))
        return simulate(*arguments, overrides=overrides, **given)

    with monkeypatch.context() as patch:
        patch.setattr("geoident.workflow.campaign.one_run.simulate", fails)
        table, _, _ = computed()
    assert table.exit_code == ExitCode.SOME_FAILED
    reasons = {run.name: run.reason for run in table.failed}
    assert set(reasons) == {"large", "last"}
    assert reasons["large"] == "out of memory"
    assert "No space left on device" in reasons["last"]
    assert "free some space" in reasons["last"]
    table, again, _ = computed()
    assert again.begun == ["large", "last"]
    assert table.exit_code == ExitCode.DONE


def test_a_journal_on_a_full_disk_ends_the_campaign_and_what_it_has_is_not_lost(here, monkeypatch):
    once = RunJournal.__enter__

    class FullAfterOne:
        def __init__(self, file):
            self.file, self.lines = file, 0

        def write(self, text):
            self.lines += 1
            if self.lines > 1:
                raise OSError(errno.ENOSPC, "No space left on device")
            self.file.write(text)

        def __getattr__(self, name):
            return getattr(self.file, name)

    def enter(journal):
        once(journal)
        journal._file = FullAfterOne(journal._file)
        return journal

    with monkeypatch.context() as patch:
        patch.setattr(RunJournal, "__enter__", enter)
        with pytest.raises(OutputError, match="No space left on device") as caught:
            computed(write(SIMULATED))
    assert caught.value.exit_code == ExitCode.OUTPUT
    assert [run.name for run in read_runs("campaign.batch").runs] == ["0001"]
    table, again, _ = computed()
    assert again.begun == ["0002", "0003", "0004"]
    assert table.exit_code == ExitCode.DONE


def test_seeds_of_runs_give_other_noise(here):
    write("command: simulate\nnoise: true\nvariations: {product: {seed: [1, 2, 1]}}")
    one, two, same = computed()[0].runs
    assert one.readings == same.readings
    assert one.readings != two.readings
    with pytest.raises(InputError, match="is not a seed"):
        plan_campaign(write("command: simulate\nvariations: {product: {seed: [1.5]}}"))
    with pytest.raises(InputError, match="they cannot be sampled"):
        plan_campaign(
            write(
                "command: simulate\n"
                "variations: {sample: {count: 2, values: {seed: {from: 1, to: 5}}}}"
            )
        )


def test_predictions_and_scans(here):
    alone = ("backtest=false", "closed-form.starts=1", "model_error=none", "mesh_error=false")
    run_command("fit", "case.yaml", *(word for one in alone for word in ("--set", f"fit.{one}")))
    vary = "variations: {product: {materials.rock.nu: [0.2, 0.3]}}"
    table, _, _ = computed(write(f"command: predict\nresult: case.fit.h5\n{vary}", "p.yaml"))
    assert table.exit_code in (0, 4)
    reading = table.runs[0].readings[0]
    assert reading.lower95 < reading.value < reading.upper95
    with h5py.File("p.batch/campaign.h5") as file:
        assert np.isfinite(file["readings/lower95"][...]).all()
    assert not plan_campaign("p.yaml").remaining
    assert "Outdated" not in run_command("show", "p.batch").stdout
    fit = read_result("case.fit.h5")
    later = replace(fit, provenance=replace(fit.provenance, created="2030-01-01T12:00:00+00:00"))
    write_result(later, "case.fit.h5", overwrite=True, inputs=())  # the same fit, on another day
    assert not plan_campaign("p.yaml").remaining
    other = replace(fit, objective=1.01 * fit.objective)
    write_result(other, "case.fit.h5", overwrite=True, inputs=())
    said = " ".join(run_command("show", "p.batch").stdout.split())
    assert "Outdated: made from an earlier fit than case.fit.h5 holds now." in said
    assert "`geoident batch p.yaml` makes it again." in said
    first = json.loads(run_command("show", "p.batch", "--json").stdout.splitlines()[0])
    assert first["outdated"] in said
    assert said.count("Outdated") == 1
    assert [run.name for run in plan_campaign("p.yaml").remaining] == ["0001", "0002"]
    computed("p.yaml")
    assert "Outdated" not in run_command("show", "p.batch").stdout
    scans, _, _ = computed(write(f"command: scan\nset: {{fit.scan.points: 3}}\n{vary}", "s.yaml"))
    assert [run.file for run in scans.runs] == ["0001.scan.h5", "0002.scan.h5"]
    assert all(np.isfinite(run.objective) for run in scans.runs)
    assert {p.name.rpartition("-")[0] for p in campaign_pictures(scans)} == {
        "campaign-varied", "campaign-parameters",
    }  # fmt: skip


def test_the_folder_of_something_else_is_not_used(here):
    write(SIMULATED)
    Path("campaign.batch").mkdir()
    Path("campaign.batch/precious.txt").write_text("mine")
    with pytest.raises(OutputError, match="is not a folder of a campaign"):
        plan_campaign("campaign.yaml")
    plan_campaign("campaign.yaml", force=True)
    computed(output="mine")
    with pytest.raises(OutputError, match="another campaign"):
        plan_campaign(write(SIMULATED, "other.yaml"), output="mine")


def test_faults_of_runs_are_said_where_they_are_written(here):
    Path("runs.csv").write_text(
        "run,parameters.E_rock.start,materials.rock.nu\na,1 GPa,0.2\nb,2 GPa,0.7\nc,3 GPa,x\n"
    )
    with pytest.raises(InputError) as caught:
        plan_campaign(write("variations: {table: runs.csv}"))
    places = {(f.location.file, f.location.line, f.location.column) for f in caught.value.faults}
    assert places == {("runs.csv", 3, 9), ("runs.csv", 4, 9)}
    with pytest.raises(InputError) as caught:
        plan_campaign(write("set: {parameters.E_rok.start: 1 GPa}\nvariations: {rows: [{run: a}]}"))
    (fault,) = caught.value.faults
    assert (fault.location.file, fault.location.line) == ("campaign.yaml", 3)
    assert "E_rock" in fault.hint


WRONG = """tytle: what if
set: {parameters.E_rok.start: 1 GPa}
variations:
  product:
    parameters.E_rock.strt: [1 GPa, 2 GPa]
    materials.rock.nu: [0.2, 0.7]
    in_situ.sigma: [1 MPa]
    gauges[0: [1]"""


def places_of(text):
    with pytest.raises(InputError) as caught:
        plan_campaign(write(text))
    return [(f.location.line, f.location.column, f.code) for f in caught.value.faults]


def test_all_that_is_wrong_in_a_campaign_is_said_at_once_and_then_all_of_its_runs(here):
    assert places_of(WRONG) == [(3, 1, "unknown-key"), (10, 5, "bad-override")]
    text = WRONG.replace("tytle", "title").replace("\n    gauges[0: [1]", "")
    assert places_of(text) == [(4, 31, "bad-override")]
    assert places_of(text.replace("E_rok", "E_rock")) == [
        (7, 30, "unknown-key"),
        (8, 30, "out-of-range"),
        (9, 21, "unknown-key"),
    ]


def test_names_of_runs_are_judged_before_their_cases(here):
    runs = "variations: {rows: [{run: a/b, materials.rock.nu: 0.7}, {run: a}, {run: A}]}"
    assert places_of(f"command: simulat\nnoise: true\n{runs}") == [(3, 10, "not-listed")]
    assert places_of(f"command: simulate\nnoise: true\n{runs}") == [
        (5, 21, "bad-name"),
        (5, 67, "same-run"),
    ]
    named = runs.replace("a/b", "b").replace("run: A", "run: c")
    assert places_of(f"command: simulate\nnoise: true\n{named}") == [(5, 49, "out-of-range")]


def test_a_seed_is_of_the_runs_and_not_of_the_case(here):
    """It varies from run to run; for all runs the campaign has a key of its own."""
    assert places_of("set: {seed: 3}\nvariations: {rows: [{run: a}]}") == [(3, 13, "unknown-key")]


def test_faults_of_the_base_case_are_said_once_beside_those_of_runs(here):
    Path("case.yaml").write_text(Path("case.yaml").read_text().replace("K0: 1.0", "K1: 1.0"))
    with pytest.raises(InputError) as caught:
        plan_campaign(write("variations: {product: {materials.rock.nu: [0.2, 0.7]}}"))
    found = [(f.location.file, f.code) for f in caught.value.faults]
    own = [("case.yaml", "missing-key"), ("case.yaml", "unknown-key")]
    assert found == [("campaign.yaml", "out-of-range"), *own]


def test_of_a_campaign_without_a_case_its_own_faults_are_said(here):
    Path("none.yaml").write_text(
        "format: geoident-campaign/1\nvariations: {product: {a: [1]}, b: 2}"
    )
    with pytest.raises(InputError) as caught:
        plan_campaign("none.yaml")
    assert [fault.code for fault in caught.value.faults] == ["missing-key", "unknown-key"]


def test_all_runs_of_the_least_misfit_are_named_and_a_page_without_title_names_its_file():
    runs = tuple(
        RunRecord(name, "", (), "done", 0, file="x.h5", objective=misfit)
        for name, misfit in (("a", 2.0), ("b", 1.0), ("c", 1.0 + 1e-9), ("d", 1.1))
    )
    table = CampaignTable("", "fit", "../site/many.yaml", "c.yaml", (), runs, 4, {}, "2024-01-01")
    assert "The runs b and c have the least misfit, 1." in " ".join(outcome_sentences(table))
    alone = replace(table, runs=runs[:2], total=2)
    assert "The run b has the least misfit, 1." in " ".join(outcome_sentences(alone))
    page = page_of_many(table, draw=lambda pictures: [])
    assert "<h1>Campaign many.yaml</h1>" in page
