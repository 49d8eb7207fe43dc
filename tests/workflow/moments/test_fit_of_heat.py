"""Conductivity, expansion and adiabatic rise of a lift from thermometers and strain.

The readings are those of another mesh, finer and in triangles, with noise.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.commands import run_command
from support.heated import DAY, LIFTS, PARAMETERS, parameters_of, write_lifts
from support.in_stages import model_at

TRUE = {"k": 1.95, "alpha": 0.94e-5, "rise": 41.0}
GAUGES = """\
gauges:
  T1: {kind: thermometer, point: [1 m, 2.8 m], accuracy: 0.3 degC}
  T2: {kind: thermometer, point: [0.4 m, 2.5 m], accuracy: 0.3 degC}
  T3: {kind: thermometer, point: [1 m, 1.7 m], accuracy: 0.3 degC}
  EX: {kind: extensometer, head: [0.4 m, 3 m], anchors: {a: [0.4 m, 2.1 m]}, accuracy: 0.01 mm,
    zero: lift 1 + 0 d}
"""
AT = [0.25, 0.5, 1.0, 2.0, 3.0]
FIT = """\
readings: read.csv
fit: {backtest: false, mesh_error: false, model_error: none}
"""


def lift(folder, values, more="", **options):
    """The case of the first lift, with numbers for what is not sought, and starts for what is."""
    text = LIFTS[: LIFTS.index("  - {name: lift 2")].replace("MORE", ", ageing: {code: eurocode-2}")
    sought = {name: values[name] for name in TRUE}
    text = text.replace("PARAMETERS", parameters_of(sought))
    for name, value in PARAMETERS.items():
        if name not in TRUE:
            for end in ",}\n":
                text = text.replace(f"${name}{end}", f"{value}{end}")
    return write_lifts(folder, text + GAUGES + more, **options)


@pytest.mark.slow
def test_a_fit_on_another_mesh_finds_the_heat_of_a_lift(tmp_path):
    units = {"k": "W/mK", "alpha": "1/K", "rise": "K"}
    true = {name: f"{value!r} {units[name]}" for name, value in TRUE.items()}
    (tmp_path / "true").mkdir()
    path = lift(tmp_path / "true", true, cells=3, kind="tri6")
    model = model_at(path, {"lift 1": [0.0, *(day * DAY for day in AT)]})
    start = np.array([parameter.start for parameter in model.case.parameters])
    read = model.computed(start)
    random, rows = np.random.default_rng(4), ["gauge,stage,value,unit"]
    for row, channel in enumerate(model.case.channels):
        size, unit = (1e3, "mm") if channel.dimension == "length" else (1.0, "degC")
        for state in range(1, 1 + len(AT)):
            value = size * (read[row, state] + random.normal(0.0, channel.accuracy))
            rows.append(f"{channel.name},{model.case.stages[state].name},{value:.5f},{unit}")
    (tmp_path / "read.csv").write_text("\n".join([*rows, ""]))
    path = lift(tmp_path, PARAMETERS, more=FIT, cells=2)
    done = run_command("fit", path)
    assert done.exit_code == 0, done.output
    told = json.loads(run_command("show", tmp_path / "case.fit.h5", "--json").stdout)
    found = told["parameters"]
    for name, truth in TRUE.items():
        assert found[name]["value"] == pytest.approx(truth, rel=0.06)
        assert found[name]["lower95"] < truth < found[name]["upper95"], name
    assert found["rise"]["value"] == pytest.approx(TRUE["rise"], rel=0.03)
