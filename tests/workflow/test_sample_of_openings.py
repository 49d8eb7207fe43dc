"""Posteriors of whole cases, drawn by the command, against quadrature on a grid.

Truth independent of samplers and approximations: exp(-phi/2) summed over a grid, with phi from the
model of the case and the formulas of theory 3, written out here.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.commands import run_command

from geoident.io.result.file import read_result
from geoident.workflow.running.jobs import build_model, load_inputs

RIDGE = """\
format: geoident-case/1
title: Elastic opening; stress and modulus scale together
analysis: plane-strain
parameters:
  E: {start: 10 GPa, bounds: [1 GPa, 80 GPa], scale: log}
  sigma_v: {start: 8 MPa, bounds: [2 MPa, 20 MPa]PRIOR}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: $sigma_v, K0: 1.0}
stages:
  - {name: all, excavate: [tunnel]}
gauges:
  CV: {kind: convergence, between: [[-2.5 m, 0 m], [2.5 m, 0 m]], accuracy: 0.2 mm}
  EX: {kind: extensometer, head: [0 m, 2.5 m], anchors: {a1: [0 m, 3.2 m], a6: [0 m, 8.5 m]}, \
accuracy: 0.1 mm}
readings: READINGS
fit:
  method: closed-form
  closed-form: {centre: [0 m, 0 m], radius: 2.5 m, starts: 2}
"""
STRENGTH = """\
format: geoident-case/1
title: Opening in rock that yields; one strength makes up for the other
analysis: plane-strain
parameters:
  c: {start: 2 MPa, bounds: [0.3 MPa, 6 MPa], scale: log}
  phi: {start: 30 deg, bounds: [10 deg, 45 deg]}
materials:
  rock:
    elastic: isotropic
    E: 8 GPa
    nu: 0.25
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: 5 deg}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 20 MPa, K0: 1.0}
stages:
  - {name: near, excavate: [tunnel], release: {tunnel: 0.8}}
  - {name: far, release: {tunnel: 1.0}}
gauges:
  CV: {kind: convergence, between: [[-2.5 m, 0 m], [2.5 m, 0 m]], accuracy: 2 mm}
  EX: {kind: extensometer, head: [0 m, 2.5 m], anchors: {a6: [0 m, 8.5 m]}, accuracy: 1 mm}
readings: READINGS
fit:
  method: closed-form
  closed-form: {centre: [0 m, 0 m], radius: 2.5 m, starts: 2}
"""
LEVELS = (0.025, 0.25, 0.5, 0.75, 0.975)


def sampled(tmp_path, monkeypatch, text, truth, accuracies):
    """The sample of a case whose readings are those of a truth, each off by its accuracy."""
    monkeypatch.chdir(tmp_path)
    case = tmp_path / "case.yaml"
    case.write_text(text.replace("READINGS", "[]"))
    inputs = load_inputs("case.yaml")
    model = build_model(inputs)
    channels, stages = inputs.case.channels, inputs.case.stages
    pairs = [(c.name, s.name) for c in channels for s in stages]
    v = model.response(pairs).readings(np.asarray(truth))
    sd = np.array([accuracies[c] for c, _ in pairs])
    signs = np.where(np.arange(len(v)) % 2, -1.0, 1.0)
    rows = zip(pairs, (v + signs * sd).tolist(), strict=True)
    entries = ", ".join(
        f"{{gauge: {c}, stage: {s}, value: {1e3 * value!r} mm}}" for (c, s), value in rows
    )
    case.write_text(text.replace("READINGS", f"[{entries}]"))
    fitted = run_command("fit", "case.yaml")
    assert fitted.exit_code in (0, 4), fitted.stderr
    found = run_command("sample", "case.fit.h5")
    assert found.exit_code == 0, found.stderr
    response = model.response(pairs)

    def phi(p):
        return float(np.sum(((response.readings(p) - v) / sd - signs) ** 2))

    return read_result("case.sample.h5").posterior, phi


def phi_by_ratio(phi, axes):
    """Phi on a grid of modulus and stress: a parabola of their ratio, as readings go with it."""
    ratios = np.array([4e-4, 8e-4, 1.6e-3])
    parabola = np.polyfit(ratios, [phi(np.array([10e9, 10e9 * r])) for r in ratios], 2)
    other = np.array([20e9, 24e6])
    assert np.polyval(parabola, 1.2e-3) == pytest.approx(phi(other), rel=1e-6)
    return np.polyval(parabola, axes[1] / axes[0][:, None])


def probabilities(found, of, squares, axes, measure):
    """Probabilities below the quantiles of the draws, by phi on a grid with cells even in ln p."""
    density = np.exp(0.5 * (squares.min() - squares)) * measure
    alone = density.sum(axis=1 - of)
    below = (np.cumsum(alone) - 0.5 * alone) / alone.sum()
    return np.interp(np.quantile(found.flat[:, of], LEVELS), axes[of], below)


def even_in_log(low, high, n):
    return np.exp(np.linspace(np.log(low), np.log(high), 2 * n + 1)[1::2])


@pytest.mark.parametrize(
    "prior", [pytest.param("", marks=pytest.mark.slow), ", prior: {mean: 8 MPa, sd: 2 MPa}"]
)
def test_modulus_and_stress(tmp_path, monkeypatch, prior):
    accuracies = {"CV": 2e-4, "EX.a1": 1e-4, "EX.a6": 1e-4}
    text = RIDGE.replace("PRIOR", prior)
    found, phi = sampled(tmp_path, monkeypatch, text, [10e9, 8e6], accuracies)
    axes = even_in_log(1e9, 80e9, 300), even_in_log(2e6, 20e6, 150)
    squares = phi_by_ratio(phi, axes)
    measure = np.broadcast_to(axes[1], (300, 150))  # flat, or normal, in sigma_v
    if prior:
        measure = measure * np.exp(-0.5 * ((axes[1] - 8e6) / 2e6) ** 2)
    for of in (0, 1):
        below = probabilities(found, of, squares, axes, measure)
        assert np.all(np.abs(below - LEVELS) < (0.015, 0.04, 0.05, 0.04, 0.015))


@pytest.mark.slow
def test_cohesion_and_friction(tmp_path, monkeypatch):
    accuracies = {"CV": 2e-3, "EX.a6": 1e-3}
    found, phi = sampled(tmp_path, monkeypatch, STRENGTH, [3e6, np.deg2rad(25)], accuracies)
    axes = even_in_log(0.3e6, 6e6, 40), even_in_log(np.deg2rad(10), np.deg2rad(45), 36)
    squares = np.array([[phi(np.array([a, b])) for b in axes[1]] for a in axes[0]])
    measure = np.broadcast_to(axes[1], (40, 36))  # c flat in its logarithm, phi in its value
    for of in (0, 1):
        below = probabilities(found, of, squares, axes, measure)
        assert np.all(np.abs(below - LEVELS) < (0.02, 0.05, 0.06, 0.05, 0.02))
    assert np.corrcoef(np.log(found.flat.T))[0, 1] < -0.8
