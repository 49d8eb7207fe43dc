"""A result of the format before (made by version 0.1.0 of a trench) is still of use."""

import shutil
from pathlib import Path

import h5py
import pytest

from geoident.io.result.file import read_result
from geoident.model.parameter import Prior

OLD = Path(__file__).parent.parent / "io" / "result" / "format-1" / "trench.fit.h5"
SHOWN = """\
CV     second     -1.079  -1.120  -1.038    -1.077  inside
S      second      0.041   0.019   0.063     0.038  inside
X.a    second      0.279   0.257   0.301     0.282  inside
"""


@pytest.fixture
def old(trench):
    shutil.copy(OLD, trench / "case.fit.h5")
    with h5py.File(trench / "case.fit.h5") as file:
        assert file.attrs["format"] == "geoident-result/1"
        assert "readings" not in file
    return trench


@pytest.mark.usefixtures("plain_pictures")
def test_it_is_shown_reported_and_exported(old, run, run_json):
    shown = run("show", "case.fit.h5")
    assert shown.exit_code == 0
    assert SHOWN in shown.stdout
    assert "prior 1.2 +- 0.5" in shown.stdout
    assert "prism hit" in shown.stdout
    (found,) = run_json("show", "case.fit.h5")
    assert found["parameters"]["E"]["value"] == 4871730333.097008
    assert [g["bad"] for g in found["gauges"]] == [False] * 4 + [True, False]
    assert len(found["diagnostics"]["readings"]) == 3
    assert run("report", "case.fit.h5").exit_code == 0
    assert run("export", "case.fit.h5", "--format", "csv", "--format", "vtu").exit_code == 0
    assert "CV,first,-0.598" in Path("case.fit.export/case.fit.gauges.csv").read_text()


def test_it_is_predicted_from_and_compared(old, run, run_json):
    (again,) = run_json("predict", "case.fit.h5")
    (shown,) = run_json("show", "case.fit.h5")
    for one, other in zip(again["predictions"], shown["predictions"], strict=True):
        assert one["mean"] == pytest.approx(other["mean"], rel=1e-9)
        assert one["sd"] == pytest.approx(other["sd"], rel=1e-9)
        assert one["measured"] == other["measured"]
    assert run("diff", "case.fit.h5", "case.fit.h5").exit_code == 0


def test_its_readings_and_priors_are_those_that_it_holds():
    result = read_result(OLD)
    table = result.gauges.readings
    assert table.pairs[:2] == (("CV", "first"), ("S", "first"))
    assert table.gauge[2] == "X"
    assert table.used.tolist() == [True] * 3 + [False] * 3
    assert table.bad.tolist() == [False] * 4 + [True, False]
    assert result.parameters.priors == (None, Prior(1.2, 0.5))
    assert result.provenance.format == "geoident-result/1"


def test_it_is_not_up_to_date_and_kept_beside(old, run):
    before = Path("case.fit.h5").read_bytes()
    assert run("fit", "case.yaml").exit_code == 0
    assert Path("case.fit.1.h5").read_bytes() == before


def test_drift_in_time_cannot_be_predicted_from_it(old, run):
    """The times of the readings are lost there, so the computed readings would be wrong."""
    with h5py.File("case.fit.h5", "r+") as file:
        text = file["case/resolved"].asstr()[()]
        del file["case/resolved"]
        text = text.replace("  S:\n", "  S:\n    drift: 2 mm/month\n")
        dates = "dates: {virgin: 2024-03-01, first: 2024-04-01, second: 2024-05-01}\n"
        file["case/resolved"] = text + dates
    done = run("predict", "case.fit.h5")
    assert done.exit_code == 3
    assert "Run the fit again" in done.stderr
