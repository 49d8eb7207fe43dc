"""Campaigns from Python: a table, results by name, what has failed."""

from pathlib import Path

import pytest

import geoident
from geoident import batch
from geoident.errors import InputError
from tests.support.external import PYTHON, SCRIPT
from tests.support.external import write_case as write_elsewhere
from tests.support.trench import write_case

CAMPAIGN = """\
format: geoident-campaign/1
case: case.yaml
command: simulate
"""
VARIED = "variations: {product: {parameters.E.start: [2 GPa, 5 GPa, 8 GPa]}}\n"


def write(folder, text=VARIED):
    path = folder / "campaign.yaml"
    path.write_text(CAMPAIGN + text)
    return path


def test_runs_are_a_table_and_results_by_name(tmp_path, here):
    write_case(tmp_path)
    text = VARIED.replace(", 8 GPa", "")
    seen = []
    found = batch(write(tmp_path, text), jobs=3, progress=seen.append)
    assert here == [3]
    assert found.complete
    assert list(found) == [run.name for run in seen] == ["0001", "0002"]
    soft, stiff = found.values()
    assert soft.gauges["CV"].measured == pytest.approx(2.5 * stiff.gauges["CV"].measured)
    frame = found.runs.to_frame()
    assert list(frame["parameters.E.start"]) == ["2 GPa", "5 GPa"]
    assert frame["CV at first [mm]"][0] == pytest.approx(1e3 * soft.gauges["CV"].measured[0])
    again = batch(write(tmp_path, text))
    assert again.up_to_date == 2
    assert repr(again.runs.rows) == repr(found.runs.rows)
    assert "2 of 2 runs done" in str(again)
    assert "<table" in again._repr_html_()


def test_a_failed_run_ends_nothing_and_says_why(tmp_path, here):
    write_case(tmp_path)
    (tmp_path / "campaign.batch" / "0003.simulate.h5").mkdir(parents=True)
    found = batch(write(tmp_path), force=True)
    assert not found.complete
    assert list(found) == ["0001", "0002"]
    assert "0003.simulate.h5" in found.failed["0003"]
    with pytest.raises(KeyError, match="no run '0003' has a result"):
        found["0003"]


def test_what_is_wrong_is_said_in_words_of_python(tmp_path, here):
    write_case(tmp_path)
    batch(write(tmp_path, "variations: {rows: [{run: one}]}\n"))
    (tmp_path / "other.yaml").write_text((tmp_path / "campaign.yaml").read_text())
    with pytest.raises(geoident.errors.OutputError, match="force=True"):
        batch(tmp_path / "other.yaml", output=tmp_path / "campaign.batch")


@pytest.fixture
def stranger(tmp_path, monkeypatch):
    """A campaign of a case whose readings a function gives that nobody has said may run."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_elsewhere(tmp_path, PYTHON, script=SCRIPT)
    return write(tmp_path, VARIED.replace(", 8 GPa", ""))


def test_a_campaign_runs_no_program_unasked(stranger, here):
    with pytest.raises(InputError, match="it is not trusted yet") as error:
        batch(stranger)
    assert "geoident.trust(case)" in str(error.value)
    assert not Path(stranger).with_suffix(".batch").exists()
    assert batch(stranger, trust=True).complete
    assert batch(stranger, fresh=True).complete  # remembered
