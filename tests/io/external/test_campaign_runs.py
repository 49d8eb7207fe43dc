"""The runs of a campaign as a table: what is taken, left out and named, refused."""

import csv
import io
from dataclasses import replace

import h5py
import numpy as np
import pytest
from support.external import HEAD, READINGS, gauge_values, spread_values

from geoident.errors import ExitCode, InputError
from geoident.io.case.file import parse_case, read_case
from geoident.io.result.campaign import write_over_all
from geoident.io.text.named_files import named_files
from geoident.model.results.many.campaign import (
    FAILED,
    CampaignTable,
    RunParameter,
    RunReading,
    RunRecord,
)
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.workflow.running.jobs import load_inputs

PATHS = ("parameters.E.start", "in_situ.K0")
CASE = f"format: geoident-case/1\nmodel: {{kind: table, file: many.batch}}\n{HEAD}".replace(
    "3.0]", "2.85]"
)


def run_of(number, E, K0):
    """The record of a simulation at a modulus, Pa, and K0."""
    readings = tuple(
        RunReading(gauge, stage, value, np.nan, np.nan, "mm", "length")
        for (gauge, stage), value in gauge_values(E, K0).items()
    )
    own = RunParameter("E", E, np.nan, np.nan, np.nan, "GPa", "pressure")
    settings = tuple(zip(PATHS, (f"{E / 1e9!r} GPa", repr(K0)), strict=True))
    return RunRecord(f"{number:04d}", "", settings, "done", ExitCode.DONE, file="x.h5",
                     parameters=(own,), readings=readings)  # fmt: skip


def campaign(runs, **changes):
    """A campaign of simulations of these runs."""
    table = CampaignTable("", "simulate", "../many.yaml", "../own.yaml", PATHS, tuple(runs),
                          len(runs), {}, "2024-03-01")  # fmt: skip
    return replace(table, **changes)


def write(folder, table):
    """Its folder and a case that names it; the path of the case."""
    (folder / "many.batch").mkdir(parents=True, exist_ok=True)
    write_over_all(table, folder / "many.batch" / "campaign.h5", inputs=())
    (folder / "many.batch" / "runs.csv").write_text(runs_csv(table))
    (folder / "readings.csv").write_text(READINGS)
    (folder / "case.yaml").write_text(CASE)
    return folder / "case.yaml"


def runs_at(values):
    return [run_of(n, E, K0) for n, (E, K0) in enumerate(values, 1)]


RUNS = runs_at(spread_values(24))


def faults_of(case):
    with pytest.raises(InputError) as caught:
        read_case(str(case))
    return {fault.code: fault for fault in caught.value.faults}


def test_parameters_and_readings_of_a_campaign_are_taken_with_all_digits(tmp_path):
    case = write(tmp_path, campaign(RUNS))
    loaded = read_case(str(case))
    table = loaded.case.elsewhere
    values = spread_values(24)
    assert table.names == ("E", "K0")
    np.testing.assert_array_equal(table.values, values)
    found = gauge_values(*values[3])
    assert table.readings[3, 1, 2] == found["D", "open"]
    assert table.called == "many.batch"
    assert parse_case(loaded.resolved, str(case)).case.elsewhere == table


@pytest.mark.parametrize("file", ["many.batch/campaign.h5", "many.batch/runs.csv"])
def test_a_file_in_its_folder_means_the_campaign(tmp_path, file):
    case = write(tmp_path, campaign(RUNS))
    before = read_case(str(case)).case.elsewhere
    case.write_text(CASE.replace("many.batch", file))
    assert read_case(str(case)).case.elsewhere == before


def test_a_copy_of_its_table_is_read_like_any_other(tmp_path):
    case = write(tmp_path, campaign(RUNS))
    table = list(csv.reader(io.StringIO((tmp_path / "many.batch" / "runs.csv").read_text())))
    wanted = [k for k, name in enumerate(table[0])
              if name in ("in_situ.K0", "E [GPa]") or name.endswith("[mm]")]  # fmt: skip
    rows = [",".join(row[k] for k in wanted) for row in table]
    rows[0] = rows[0].replace("in_situ.K0", "K0")
    (tmp_path / "copy.csv").write_text("\n".join(rows))
    before = read_case(str(case)).case.elsewhere
    case.write_text(CASE.replace("many.batch", "copy.csv"))
    found = read_case(str(case)).case.elsewhere
    np.testing.assert_allclose(found.readings, before.readings, rtol=1e-9)
    order = [found.names.index(name) for name in before.names]
    np.testing.assert_allclose(found.values[:, order], before.values, rtol=1e-9)


def test_the_files_of_a_case_are_those_of_its_campaign(tmp_path):
    case = write(tmp_path, campaign(RUNS))
    assert str(tmp_path / "many.batch" / "campaign.h5") in load_inputs(str(case)).files
    assert list(named_files({"a": "many.batch"}, tmp_path)) == [
        str(tmp_path / "many.batch" / "campaign.h5")
    ]


def test_a_campaign_that_was_written_again_is_the_same_and_other_runs_are_not(tmp_path):
    def identity():
        return load_inputs(str(case)).identity("fit", (), seed=0)

    case = write(tmp_path, campaign(RUNS))
    before = identity()
    write(tmp_path, campaign(RUNS, created="2024-04-01"))
    assert identity() == before
    write(tmp_path, campaign(RUNS[:-1]))
    assert identity() != before


def test_runs_that_failed_or_have_not_ended_are_left_out_and_named(tmp_path):
    lost = replace(RUNS[3], status=FAILED, exit_code=5, reason="no equilibrium\nmore", readings=())
    short = replace(RUNS[5], readings=RUNS[5].readings[:-1])
    runs = [*RUNS[:3], lost, RUNS[4], short, *RUNS[6:]]
    table = read_case(str(write(tmp_path, campaign(runs, total=30)))).case.elsewhere
    assert len(table) == 22
    said = " ".join(table.notes)
    assert "2 of 24 runs in many.batch have failed and are left out: " in said
    assert "0004 (failed: no equilibrium), 0006 (D at open is missing)" in said
    assert "24 of 30 runs of many.batch have ended" in said


def test_gauges_that_the_case_does_not_have_are_named(tmp_path):
    case = write(tmp_path, campaign(RUNS))
    case.write_text(CASE.replace("  H: {kind: reading, accuracy: 0.02 mm}\n", ""))
    (tmp_path / "readings.csv").write_text(READINGS.replace("H,half,0.53,mm\nH,open,1.03,mm\n", ""))
    table = read_case(str(case)).case.elsewhere
    assert "H of many.batch is not in the case" in table.notes
    assert table.readings.shape[2] == 2


def test_what_varies_besides_is_refused_unless_it_is_ignored(tmp_path):
    case = write(tmp_path, campaign(RUNS))
    less = CASE.replace("  K0: {start: 1.0, bounds: [0.3, 2.85]}\n", "")
    case.write_text(less)
    fault = faults_of(case)["hidden-parameter"]
    assert fault.message == (
        "'in_situ.K0' varies in the campaign, and no parameter of the case is called 'K0'"
    )
    case.write_text(less.replace("many.batch", "many.batch, ignore: [in_situ.K0]"))
    assert read_case(str(case)).case.elsewhere.names == ("E",)


def test_bounds_and_settings_of_fits_that_vary_hide_nothing(tmp_path):
    also = ("parameters.E.bounds", "fit.backtest", "seed")
    runs = [replace(run, settings=(*run.settings, *((path, run.name) for path in also)))
            for run in RUNS]  # fmt: skip
    case = write(tmp_path, campaign(runs, paths=(*PATHS, *also)))
    assert read_case(str(case)).case.elsewhere.names == ("E", "K0")


def changed(settings):
    """The runs with other texts of K0."""
    return [
        replace(run, settings=(run.settings[0], ("in_situ.K0", settings(n, run.settings[1][1]))))
        for n, run in enumerate(RUNS)
    ]


@pytest.mark.parametrize(
    ("table", "code", "said"),
    [
        (campaign(RUNS, command="fit"), "wrong-command", "of fit, which gives no readings"),
        (campaign(RUNS[:6]), "too-few", "found 6 runs; 2 parameters need 9 at least"),
        (campaign([*RUNS, replace(RUNS[4], name="again")]), "duplicate-run",
         "the run again: the parameters are those of the run 0005"),
        (campaign(changed(lambda n, text: "0.8")), "constant-column",
         "the parameter 'K0' is the same in all runs"),
        (campaign(changed(lambda n, text: text if n else "")), "bad-number",
         "'in_situ.K0' of the run 0001: it is left as in the base case"),
        (campaign(changed(lambda n, text: f"{text} MPa")), "bad-number",
         "is a pressure; expected a number without unit"),
        (campaign([replace(run, parameters=(replace(run.parameters[0], dimension="length"),))
                   for run in RUNS]), "unit", "'E' is a length in the campaign, and a pressure"),
        (campaign([replace(run, parameters=()) for run in RUNS]), "no-column",
         "the parameter 'E' is not in many.batch"),
        (campaign([replace(run, readings=run.readings[:4]) for run in RUNS]), "no-column",
         "'D' is not in many.batch"),
    ],
)  # fmt: skip
def test_what_no_surface_can_be_laid_through_is_refused(tmp_path, table, code, said):
    found = faults_of(write(tmp_path, table))
    assert said in found[code].message, found


def test_a_campaign_that_has_not_ended_or_is_damaged_is_said_to_be_so(tmp_path):
    case = write(tmp_path, campaign(RUNS))
    over_all = tmp_path / "many.batch" / "campaign.h5"
    with h5py.File(over_all, "r+") as file:
        del file["readings/value"]
    assert "value is missing" in faults_of(case)["damaged-result"].message
    over_all.unlink()
    (tmp_path / "many.batch" / "runs.jsonl").write_text("{}\n")
    assert "has not ended" in faults_of(case)["no-campaign"].message
    case.write_text(CASE.replace("many.batch", "few.batch"))
    assert "there is no file" in faults_of(case)["missing-file"].message
    (tmp_path / "few.batch").mkdir()
    assert "is a folder; expected a file" in faults_of(case)["missing-file"].message
