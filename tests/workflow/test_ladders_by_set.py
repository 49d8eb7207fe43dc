"""Ladders whose models differ by keys of the case: yielding, a field, a second stress ratio.

For each: readings of the simpler model, then of the richer one, and the ladder says which it was.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.deck import write_deck
from support.meshes import box, regroup

from geoident.io.result.file import read_result

MODULUS = "{start: 5 GPa, bounds: [0.5 GPa, 50 GPa], scale: log}"
PLANE = f"""\
format: geoident-case/1
title: Trench
analysis: plane-strain
mesh: {{file: mesh.inp}}
parameters: {{E: {MODULUS}}}
materials: {{rock: {{E: $E, nu: 0.25}}}}
groups: {{rock: rock, upper: rock, lower: rock}}
supports: {{x0: x, x1: x, y0: [x, y]}}
in_situ: {{model: heim, vertical: 1 MPa, K0: 1.5}}
stages:
  - {{name: first, excavate: [upper]}}
  - {{name: second, excavate: [lower]}}
gauges:
  X: {{kind: convergence, between: [[2 m, 3 m], [4 m, 3 m]], accuracy: 0.01 mm, zero: first}}
""" + "".join(
    f"  s{k}: {{kind: displacement, point: [{x} m, {y} m], direction: [1, 0], accuracy: 0.01 mm}}\n"
    f"  t{k}: {{kind: displacement, point: [{x} m, {y} m], direction: [0, 1], accuracy: 0.01 mm}}\n"
    for k, (x, y) in enumerate([(1, 3), (1, 4), (5, 3), (5, 4), (3, 2), (2, 2), (0.5, 3), (5.5, 4)])
)
PIT = """\
format: geoident-case/1
title: Pit
analysis: solid
mesh: {file: mesh.inp}
parameters: {K0: {start: 1.2, bounds: [0.2, 4]}}
materials: {rock: {E: 5 GPa, nu: 0.25}}
groups: {rock: rock, pit: rock}
supports: {x0: x, x1: x, y0: y, y1: y, z0: z}
in_situ: {model: heim, vertical: 2 MPa, K0: $K0, K0_across: $K0}
stages:
  - {name: dig, excavate: [pit]}
gauges:
  X: {kind: convergence, between: [[1 m, 2 m, 3 m], [3 m, 2 m, 3 m]], accuracy: 0.02 mm}
  Y: {kind: convergence, between: [[2 m, 1 m, 3 m], [2 m, 3 m, 3 m]], accuracy: 0.02 mm}
  S: {kind: settlement, point: [1 m, 1 m, 4 m], accuracy: 0.02 mm}
  T: {kind: settlement, point: [3 m, 3 m, 4 m], accuracy: 0.02 mm}
"""


@dataclass(frozen=True)
class Choice:
    """Two models of one case.

    Args:
        text: of the case of the simpler one.
        changes: path of a key to its value, of the richer one.
        truth: changes that make the readings of the richer one.
        flags: of `simulate` for these.
    """

    text: str
    changes: dict[str, object]
    truth: dict[str, object]
    flags: tuple[object, ...] = ()


def strength(start):
    surface = {"type": "tresca", "planes": 8, "cohesion": "$c"}
    bounded = {"start": start, "bounds": ["0.3 MPa", "20 MPa"], "scale": "log"}
    return {"materials.rock.yield": surface, "parameters.c": bounded}


FIELD = {"field": {"mean": "$E", "sd": "40 %", "length": "2 m", "modes": 8}}
ACROSS = {"in_situ.K0_across": "$K0_across"}
RATIO = {"bounds": ["0.2", "4"]}
CHOICES = {
    "elastic or yielding": Choice(PLANE, strength("1 MPa"), strength("0.5 MPa")),
    "homogeneous or a field": Choice(
        PLANE, {"materials.rock.E": FIELD}, {"materials.rock.E": FIELD}, ("--draw", "--seed", 2)
    ),
    "one K0 or two": Choice(
        PIT,
        {**ACROSS, "parameters.K0_across": {"start": "1.2", **RATIO}},
        {**ACROSS, "parameters.K0_across": {"start": "0.8", **RATIO}},
    ),
}


def write_mesh(path: Path, text: str) -> None:
    if text is PIT:
        inside = box("hex8", (4, 4, 4), size=(4.0, 4.0, 4.0))
        pit = regroup(
            inside, pit=lambda c: (np.abs(c[:, :2] - 2.0).max(axis=1) < 1.0) & (c[:, 2] > 2.0)
        )
        write_deck(pit, path)
        return
    trench = regroup(
        box("quad4", (12, 8), size=(6.0, 4.0)),
        upper=lambda c: (np.abs(c[:, 0] - 3.0) < 1.0) & (c[:, 1] > 3.0),
        lower=lambda c: (np.abs(c[:, 0] - 3.0) < 1.0) & (np.abs(c[:, 1] - 2.5) < 0.5),
    )
    write_deck(trench, path)


def chosen(folder, what, *, rich):
    """What the ladder says on readings of its simpler or its richer model."""
    choice = CHOICES[what]
    write_mesh(folder / "mesh.inp", choice.text)
    (folder / "truth.yaml").write_text(choice.text)
    changes = choice.truth if rich else {}
    given = [
        part for key, value in changes.items() for part in ("--set", f"{key}={json.dumps(value)}")
    ]
    flags = choice.flags if rich else ("--seed", 1)
    drawn = run_command("simulate", folder / "truth.yaml", *given, "--noise", *flags)
    assert drawn.exit_code == 0, drawn.output
    (folder / "readings.csv").write_text(drawn.stdout)
    ladder = [{"name": "simple"}, {"name": "rich", "set": choice.changes}]
    fit = json.dumps(
        {"ladder": ladder, "model_error": "none", "mesh_error": False, "backtest": False}
    )
    (folder / "case.yaml").write_text(f"{choice.text}readings: readings.csv\nfit: {fit}\n")
    ended = run_command("fit", folder / "case.yaml", "--json")
    assert ended.exit_code == 0, ended.output
    return json.loads(ended.stdout)["comparison"]


@pytest.mark.parametrize(
    "what",
    [pytest.param(what, marks=pytest.mark.slow) for what in tuple(CHOICES)[:1]] + list(CHOICES)[1:],
)
def test_the_richer_model_is_chosen_where_it_made_the_readings(tmp_path, what):
    comparison = chosen(tmp_path, what, rich=True)
    assert comparison["chosen"] == "rich"
    assert comparison["decided"]
    assert "The readings support rich" in comparison["sentences"][0]
    assert read_result(tmp_path / "case.fit.h5").comparison.chosen == 1


@pytest.mark.parametrize(
    "what",
    [pytest.param(what, marks=pytest.mark.slow) for what in tuple(CHOICES)[:2]] + ["one K0 or two"],
)
def test_the_richer_model_is_not_chosen_without_need(tmp_path, what):
    comparison = chosen(tmp_path, what, rich=False)
    assert comparison["chosen"] == "simple"


@pytest.mark.slow  # of a field: test_fields.py
def test_the_ensemble_smoother_finds_a_strength_and_agrees_with_gauss_newton(tmp_path):
    """Of ground that yields, without derivatives; the prior is 180 times as wide as the answer."""
    write_mesh(tmp_path / "mesh.inp", PLANE)
    surface = {"type": "tresca", "planes": 8, "cohesion": "$c"}
    changes = {"materials.rock.yield": surface, "materials.rock.E": "5 GPa"}
    prior = {"mean": "0.6 MPa", "sd": "0.1 MPa", "kind": "lognormal"}
    strength = {"start": "0.5 MPa", "bounds": ["0.3 MPa", "2 MPa"], "scale": "log"}
    changes["parameters"] = {"c": strength}
    flags = [f"--set={key}={json.dumps(value)}" for key, value in changes.items()]
    (tmp_path / "case.yaml").write_text(PLANE)
    drawn = run_command("simulate", tmp_path / "case.yaml", *flags, "--noise", "--seed", 1)
    assert drawn.exit_code == 0, drawn.output
    (tmp_path / "readings.csv").write_text(drawn.stdout)
    changes["parameters"] = {"c": {**strength, "start": "0.7 MPa", "prior": prior}}
    flags = [f"--set={key}={json.dumps(value)}" for key, value in changes.items()]
    found = {}
    for method in ("ensemble-smoother", "gauss-newton"):
        options = {"ensemble": 30, "assimilations": 3} if method == "ensemble-smoother" else {}
        fit = {
            "method": method,
            method: options,
            "model_error": "none",
            "mesh_error": False,
            "backtest": False,
        }
        last = (f"--set=fit={json.dumps(fit)}", "--set=readings=readings.csv")
        output = tmp_path / f"{method}.fit.h5"
        ended = run_command("fit", tmp_path / "case.yaml", *flags, *last, "-o", output)
        assert ended.exit_code == 0, ended.output
        found[method] = read_result(output)
    smoothed, descended = found.values()
    assert smoothed.method == "ensemble-smoother"
    assert smoothed.fields.yielded.any()
    (sd,) = descended.parameters.sd
    assert sd < 0.1 * descended.parameters.values[0]  # the readings determine it
    assert smoothed.parameters.values == pytest.approx(descended.parameters.values, abs=2.0 * sd)
    assert descended.parameters.values == pytest.approx([0.5e6], abs=3.0 * sd)
