"""Intervals of a fit where the model is not linear over them: against quadrature on a grid.

A round opening by Kirsch's formula, with two readings for two parameters. The judge is the
posterior on a grid of both, flat within the bounds, with the formula of `SCRIPT` and numpy alone.
"""

import json

import numpy as np
import pytest
from support.commands import run_command
from support.external import OWN, PYTHON, SCRIPT, gauge_values, write_case

READ = {"V": 1.22e-3, "D": 1.31e-3}
LOG_E, K0 = np.meshgrid(
    np.linspace(np.log(1e9), np.log(50e9), 3000), np.linspace(0.3, 3.0, 600), indexing="ij"
)


def fitted(folder, accuracy, *changes):
    """What `fit --json` prints of two readings with an accuracy, mm."""
    rows = [f"{name}.a,open,{1e3 * value!r},mm" for name, value in READ.items()]
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows]) + "\n")
    text = OWN.replace("accuracy: 0.02 mm", f"accuracy: {accuracy} mm")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "case.yaml").write_text(text)
    return json.loads(run_command("fit", str(folder / "case.yaml"), "--json", "-q").stdout)


def shortest(values, weight):
    """Shortest 95 % interval of weighted values."""
    order = np.argsort(values, axis=None)
    values, weight = values.ravel()[order], weight.ravel()[order]
    below = np.cumsum(weight) / weight.sum()
    tails = np.linspace(0.0, 0.05, 201)
    low, high = (np.interp(tails + more, below, values) for more in (0.0, 0.95))
    k = np.argmin(high - low)
    return low[k], high[k]


def on_a_grid(accuracy):
    """Shortest intervals of ln E and K0."""
    formula = {}
    exec(SCRIPT, formula)
    computed = {
        name: formula["along"](np.exp(LOG_E), K0, *formula["GAUGES"][name]) for name in READ
    }
    phi = sum(((computed[name] - READ[name]) / (1e-3 * accuracy)) ** 2 for name in READ)
    weight = np.exp(-0.5 * (phi - phi.min()))
    return shortest(LOG_E, weight), shortest(K0, weight)


@pytest.mark.parametrize("accuracy", [0.05, 0.1, 0.2, 0.4])
def test_an_interval_is_that_of_the_posterior_however_little_is_known(tmp_path, accuracy):
    """Also where readings leave K0 nearly all of its range; ends are off by a seventh at most."""
    result = fitted(tmp_path, accuracy)
    of_E, of_K0 = on_a_grid(accuracy)
    E, K = (result["parameters"][name] for name in ("E", "K0"))
    found = np.log([E["lower95"], E["upper95"]])
    np.testing.assert_allclose(found, of_E, atol=0.15 * (of_E[1] - of_E[0]))
    if K["determined"]:
        found = [K["lower95"], K["upper95"]]
        np.testing.assert_allclose(found, of_K0, atol=0.15 * (of_K0[1] - of_K0[0]))
    else:
        assert of_K0[1] - of_K0[0] > 0.5 * (3.0 - 0.3)
    assert "nonlinear" not in [one["kind"] for one in result["findings"]]


def test_predict_has_the_bands_of_the_fit(tmp_path):
    """The stage that no reading was used of, by `fit` and by `predict` from its result."""
    fit = fitted(tmp_path, 0.2)
    again = run_command("predict", str(tmp_path / "case.fit.h5"), "--json", "-q")
    bands = [
        [(p["gauge"], p["stage"], p["lower95"], p["upper95"]) for p in made["predictions"]]
        for made in (fit, json.loads(again.stdout))
    ]
    assert len(bands[0]) == 4
    for (*name, low, high), (*other, low2, high2) in zip(*bands, strict=True):
        assert name == other
        assert [low2, high2] == pytest.approx([low, high], rel=1e-6)


def test_an_interval_that_reaches_where_the_model_has_no_solution_is_said_to(tmp_path):
    """The opening collapses where E is 3 % off, far within its interval; K0 goes with it."""
    script = SCRIPT.replace("if K > 2.9:", "if not 7.76e9 < E < 8.24e9:")
    path = write_case(tmp_path, PYTHON, script=script)
    rows = [f"{g},{s},{1e3 * v!r},mm" for (g, s), v in gauge_values(8e9, 0.9).items()]
    path.with_name("readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    text = path.read_text().replace("start: 6 GPa", "start: 8.1 GPa").replace("0.02 mm", "0.3 mm")
    path.write_text(text.replace("backtest: false", "backtest: false, model_error: none"))
    made = json.loads(run_command("fit", path, "--trust", "--json", "-q").stdout)
    (found,) = [one for one in made["findings"] if one["kind"] == "nonlinear"]
    assert found["sentence"].startswith("The model is not linear over the interval of K0: at both ")
    assert "ends the model has no solution" in found["sentence"]
    assert "`geoident sample` draws from the posterior itself" in found["sentence"]
