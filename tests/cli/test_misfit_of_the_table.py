"""What stands as computed in the table is what the misfit was made of, for every kind of model.

From measured, computed, and standard deviations as they are printed, and the errors that the case
or the result says readings share, the misfit is computed anew.
"""

import numpy as np
import pytest
from support.convergence import CASE as LAW
from support.convergence import READ, write_law
from support.external import (
    EXTERNAL,
    OWN,
    PYTHON,
    READINGS,
    SCRIPT,
    TABLE,
    write_case,
    write_table_case,
)
from support.trench import CASE as TRENCH
from support.trench import write_case as write_trench

from geoident.io.result.file import read_result


def table(folder, more=""):
    """A few runs, so that the response surfaces have an error of their own."""
    path = write_table_case(folder, 12, model=TABLE.replace("runs.csv", f"runs.csv{more}"))
    path.write_text(path.read_text().replace("backtest: false", "backtest: false, stages: [open]"))
    return path


def table_with_zeros(folder):
    path = write_table_case(folder, 40)
    text = path.read_text().replace("accuracy: 0.02 mm}", "accuracy: 0.02 mm, zero: half}")
    path.write_text(text)
    changes = ("H,open,0.51,mm", "V,open,0.62,mm", "D,open,0.66,mm")
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *changes, ""]))
    return path


def table_read_twice(folder):
    path = write_table_case(folder, 40)
    (folder / "readings.csv").write_text(READINGS + "V,open,1.26,mm\nD,open,1.24,mm\n")
    path.write_text(
        path.read_text().replace(
            "readings: readings.csv", "readings: {file: readings.csv, repeated_readings: all}"
        )
    )
    return path


def closed_form(folder):
    text = READINGS
    for name in "HVD":
        text = text.replace(f"\n{name},", f"\n{name}.a,")
    (folder / "readings.csv").write_text(text)
    (folder / "case.yaml").write_text(OWN)
    return folder / "case.yaml"


def staged(folder):
    path = write_trench(folder)
    path.write_text(TRENCH.replace("stages: [first], ", "model_error: none, "))
    return path


def staged_with_a_prior(folder):
    path = staged(folder)
    path.write_text(path.read_text().replace(
        "[0.2, 4]}", "[0.2, 4], prior: {mean: 1.2, sd: 0.1}}"))  # fmt: skip
    return path


def law(folder):
    read = {("H", stage): -0.004 * k for k, stage in enumerate(READ, 1)}
    read |= {("V", stage): -0.0021 * k for k, stage in enumerate(READ, 1)}
    return write_law(folder, LAW + "fit: {model_error: none}\n", read)


CASES = {
    "staged": staged,
    "staged-prior": staged_with_a_prior,
    "closed-form": closed_form,
    "law": law,
    "program": lambda folder: write_case(folder, EXTERNAL),
    "function": lambda folder: write_case(folder, PYTHON, script=SCRIPT),
    "table": table,
    "table-polynomial": lambda folder: table(folder, ", surface: polynomial"),
    "table-zeros": table_with_zeros,
    "table-twice": table_read_twice,
}


@pytest.mark.parametrize("name", CASES)
def test_the_misfit_is_that_of_the_readings_as_they_are_shown(tmp_path, run, name, monkeypatch):
    case = CASES[name](tmp_path)
    monkeypatch.chdir(tmp_path)
    done = run("fit", str(case), "-q", "--trust")
    assert done.exit_code in (0, 4), done.output
    result = read_result(str(tmp_path / "case.fit.h5"))
    gauges, readings = result.gauges, result.gauges.readings
    used = np.flatnonzero(readings.used)
    places = [gauges.place(k) for k in used]
    assert len(used) >= 3
    residual = np.array([
        readings.value[k] - gauges.computed[place] for k, place in zip(used, places, strict=True)
    ])  # fmt: skip
    covariance = np.diag(readings.sd[used] ** 2)
    if gauges.surface_errors is not None:
        shared = np.array([gauges.surface_errors[place] for place in places])
        assert np.abs(shared).max() > 0.0
        covariance += shared @ shared.T
    phi = float(residual @ np.linalg.solve(covariance, residual))
    for value, prior in zip(result.parameters.values, result.parameters.priors, strict=True):
        phi += 0.0 if prior is None else prior.score(float(value)) ** 2
    assert phi > 1e-3
    assert result.objective == pytest.approx(phi, rel=1e-6)
