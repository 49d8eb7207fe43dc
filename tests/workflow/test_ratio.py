"""A bias of gauges: what they read by what the model says, of one case and of all sections."""

import numpy as np
import pytest
from support.commands import run_command
from support.convergence import FIXED, READ, TRUTH
from support.derivatives import assert_exact
from support.external import trusted, write_table_case
from support.trench import CASE, READINGS, write_mesh

from geoident.api import fit, load_case
from geoident.errors import InputError
from geoident.workflow.project.plan import ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import build_model, load_inputs

BIAS = "  bias: {start: 1, bounds: [0.5, 2], prior: {mean: 1, sd: 0.2}}\n"


@pytest.fixture
def trench(tmp_path):
    """A trench whose convergence gauge has a bias and an offset, the others one of 1.1."""
    write_mesh(tmp_path / "trench.inp")
    (tmp_path / "readings.csv").write_text(READINGS)
    text = CASE.replace("  K0: {", BIAS + "  off: {start: 0.1 mm, bounds: [-1, 1 mm]}\n  K0: {")
    text = text.replace("accuracy: 0.01 mm}", "accuracy: 0.01 mm, ratio: 1.1}")
    text = text.replace("ratio: 1.1}", "ratio: $bias, offset: $off}", 1)
    path = tmp_path / "case.yaml"
    path.write_text(text)
    return path


def test_readings_are_the_ratio_times_the_motion_and_derivatives_are_exact(trench):
    model = build_model(load_inputs(str(trench)))
    pairs = [(gauge, stage) for gauge in ("CV", "S", "X.a") for stage in ("first", "second")]
    p = np.array([{"E": 3e9, "bias": 1.3, "off": 2e-4, "K0": 1.4}[name] for name in model.names])
    plain = trench.with_name("plain.yaml")
    text = trench.read_text().replace("ratio: $bias, offset: $off", "offset: $off")
    plain.write_text(text.replace(", ratio: 1.1", "").replace(BIAS, ""))
    bare = build_model(load_inputs(str(plain)))
    q = np.array([dict(zip(model.names, p, strict=True))[name] for name in bare.names])
    v = bare.response(pairs).readings(q)
    expected = np.where(np.arange(6) < 2, 1.3 * (v - 2e-4) + 2e-4, 1.1 * v)
    response = model.response(pairs)
    np.testing.assert_allclose(response.readings(p), expected, rtol=1e-12)
    assert_exact(response, p, model.names)
    np.testing.assert_allclose(
        model.survey(p, fields=False).computed[[0, 0, 1, 1, 2, 2], [0, 1] * 3], expected, rtol=1e-12
    )


def test_methods_that_need_readings_linear_in_displacements_say_why_not(trench):
    text = trench.read_text().replace("gauss-newton", "condensation")
    trench.write_text(text)
    with pytest.raises(InputError) as refused:
        fit(load_case(str(trench)))
    assert "gauge 'CV' has a ratio" in str(refused.value)


def test_a_table_of_runs_has_a_bias_too(tmp_path):
    """Readings all 10 % too large leave the moduli where they were."""
    path = write_table_case(tmp_path, 60)
    plain = fit(load_case(str(path))).data
    text = path.read_text().replace("accuracy: 0.02 mm}", "accuracy: 0.02 mm, ratio: 1.1}")
    path.write_text(text)
    lines = (tmp_path / "readings.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    larger = [f"{a},{b},{1.1 * float(c)!r},{d}" for a, b, c, d in rows]
    (tmp_path / "readings.csv").write_text("\n".join([lines[0], *larger, ""]))
    with trusted():
        found = fit(load_case(str(path)), force=True).data
    np.testing.assert_allclose(found.parameters.values, plain.parameters.values, rtol=0.01)


def test_sections_of_a_project_share_a_bias(tmp_path):
    """Three sections, all read 15 % too large by one instrument; their limits are known."""
    for k, name in enumerate("abc"):
        folder = tmp_path / name
        folder.mkdir()
        limit = (30.0, 55.0, 42.0)[k]
        text = FIXED.replace("{H: $C, V: 0.5 $C}", f"{{H: {limit} mm, V: {limit / 2} mm}}")
        text = text.replace("  C: {start: 30 mm, bounds: [1 mm, 500 mm], scale: log}\n", BIAS)
        biased = text.replace("accuracy: 0.1 mm,", "accuracy: 0.1 mm, ratio: $bias,")
        path = folder / "case.yaml"
        path.write_text(text.replace(BIAS, ""))
        model = build_model(load_inputs(str(path)))
        truth = {"X": 9.0, "m": 1.6, "T": TRUTH[3]}
        pairs = [(gauge, stage) for gauge in "HV" for stage in READ]
        v = model.response(pairs).readings(np.array([truth[n] for n in model.names]))
        v = 1.15 * v + 1e-4 * np.random.default_rng(k).standard_normal(len(v))
        rows = [f"{g},{s},{1e3 * x!r},mm" for (g, s), x in zip(pairs, v.tolist(), strict=True)]
        (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
        path.write_text(biased + "readings: readings.csv\nfit: {backtest: false}\n")
    project = tmp_path / "project.yaml"
    sections = "".join(f"  - {{name: {n}, case: {n}/case.yaml}}\n" for n in "abc")
    project.write_text(
        f"format: geoident-project/1\ntitle: Three\nsections:\n{sections}shared: [bias, T, X]\n"
    )
    result = fit_project(plan_project(ProjectRequest(str(project))), Control()).result
    common = {one.name: one for one in result.common}
    bias = common["bias"]
    assert bias.lower95 <= 1.15 <= bias.upper95
    # a prior of sd 0.2 has 0.78; an error of the course that all sections share is much like a bias
    assert bias.upper95 - bias.lower95 < 0.6
    for name, value in (("X", 9.0), ("T", TRUTH[3])):
        assert common[name].lower95 <= value <= common[name].upper95


def test_a_ratio_must_be_above_zero(trench):
    trench.write_text(trench.read_text().replace("ratio: 1.1", "ratio: -1"))
    ended = run_command("check", str(trench))
    assert ended.exit_code == 3
    assert "ratio" in ended.stderr
