"""A gauge that nobody has read at a fitted stage is predicted there, with its band."""

import json

import pytest
from support.commands import run_command
from support.trench import CASE, READINGS, write_case


def predictions(folder, case, readings):
    """What `fit`, then `predict` say of each gauge and stage."""
    folder.mkdir()
    path = write_case(folder)
    path.write_text(case)
    (folder / "readings.csv").write_text(readings)
    made = [json.loads(run_command("fit", path, "--json", "-q").stdout)]
    made.append(json.loads(run_command("predict", folder / "case.fit.h5", "--json", "-q").stdout))
    return [
        {
            (p["gauge"], p["stage"]): [p["mean"], p["lower95"], p["upper95"]]
            for p in each["predictions"]
        }
        for each in made
    ]


def test_as_if_its_readings_were_left_out(tmp_path):
    """The same three readings are fitted, with S unread or told to be left out."""
    case = CASE.replace("stages: [first]", "stages: [first, second]")
    left_out = case.replace("mesh_error: false", "mesh_error: false, predict_gauges: [S]")
    without = "".join(r for r in READINGS.splitlines(keepends=True) if not r.startswith("S,first"))
    unread, again = predictions(tmp_path / "a", case, without)
    assert list(unread) == [("S", "first")]
    assert again == {place: pytest.approx(row, rel=1e-9) for place, row in unread.items()}
    told, _ = predictions(tmp_path / "b", left_out, READINGS)
    one, _ = predictions(tmp_path / "c", left_out, without)
    assert one["S", "first"] == pytest.approx(told["S", "first"], rel=1e-6)
    low, high = unread["S", "first"][1:]
    assert 0.0 < high - low < told["S", "first"][2] - told["S", "first"][1]
