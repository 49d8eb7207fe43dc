"""The calls: typed, lazy, and the same numbers and files as the commands."""

import inspect
import json
import re
import subprocess
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import geoident
from geoident import (
    BacktestResult,
    CaseFile,
    FitResult,
    PredictionResult,
    SampleResult,
    ScanResult,
    backtest,
    batch,
    check,
    compare,
    export,
    fit,
    init,
    predict,
    read_result,
    report,
    sample,
    scan,
    simulate,
)
from geoident.api.calling import control
from geoident.cli.app import geoident as program
from geoident.cli.options import Options
from geoident.errors import InputError, OutputError, UsageError
from geoident.workflow.running.jobs import Request
from geoident.workflow.sample import SampleRequest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def run_cli():
    return lambda *words: json.loads(CliRunner().invoke(program, list(words)).stdout)


def test_a_fit_has_the_numbers_of_the_command(fitted, run_cli):
    assert isinstance(fitted, FitResult)
    assert fitted.converged
    assert not fitted.up_to_date
    assert Path(fitted.path).name == "case.fit.h5"
    told = run_cli("show", fitted.path, "--json")["parameters"]
    assert set(fitted.parameters) == set(told)
    for name, parameter in fitted.parameters.items():
        for key in ("value", "sd", "lower95", "upper95", "unit", "at_bound", "determined"):
            assert getattr(parameter, key) == told[name][key]


def test_the_same_input_is_up_to_date_and_other_input_takes_its_place_when_asked(case):
    fit(case)
    assert fit(case).up_to_date
    other = case.with_values({"parameters.E.start": "9 GPa"})
    assert other.case.parameters[0].start == 9e9
    again = fit(other, force=True)
    assert not again.up_to_date
    assert again.parameters["E"].value == pytest.approx(5e9, rel=0.05)


def test_progress_is_told(case):
    steps = []
    fit(case, progress=steps.append)
    assert [step.number for step in steps] == list(range(len(steps)))
    assert steps[-1].objective < steps[0].objective


def test_warnings_are_those_of_python():
    with pytest.warns(UserWarning, match="the log was cut"):
        control().monitor.warn("the log was cut")


def test_predictions_come_from_a_fit_or_its_file(fitted, case, tmp_path):
    one = predict(fitted, stages="second")
    other = predict(fitted.path, stages=["second"], case=case, output=tmp_path / "other.h5")
    assert isinstance(one, PredictionResult)
    column = one.gauges.stages.index("second")
    mean = one.data.prediction.mean[:, column]
    assert mean == pytest.approx(other.data.prediction.mean[:, column], rel=1e-9)
    assert mean[0] == pytest.approx(-1.077e-3, abs=5e-5)
    assert one.predictions.column("predicted")[0] == pytest.approx(1e3 * mean[0])


def test_a_scan_has_its_grid(case):
    found = scan(
        case.with_values({"fit.scan.grid": {"E": {"start": "2 GPa", "stop": "8 GPa", "points": 4}}})
    )
    assert isinstance(found, ScanResult)
    assert found.grid.names == ("E",)
    assert found.grid.objective.shape == (4,)
    frame = found.to_frame()
    assert list(frame.columns) == ["E [GPa]", "objective"]
    assert frame["E [GPa]"].to_numpy() == pytest.approx(1e-9 * found.grid.axes[0])
    data = found.to_xarray()
    assert data["misfit"].dims == ("E",)
    assert data["E"].values == pytest.approx(found.grid.axes[0])


def test_a_posterior_is_sampled_from_a_fit_or_its_file(fitted):
    one = sample(fitted, draws=500, effective=300)
    again = sample(fitted.path, draws=500, effective=300)
    assert isinstance(one, SampleResult)
    assert one.converged
    assert again.up_to_date
    assert one.draws.shape == (500, 2)
    assert one.parameters["E"].lower95 == pytest.approx(np.quantile(one.draws[:, 0], 0.025))
    assert len(one.to_frame()) == 500
    assert one.to_xarray()["draws"].dims == ("draw", "parameter")


def test_a_backtest_has_its_scores(case):
    found = backtest(case.with_values({"fit.stages": ["first", "second"]}))
    assert isinstance(found, BacktestResult)
    assert found.scores.readings == 3
    assert found.later_scores.readings == 0
    assert len(found.to_frame()) >= 2


def test_a_result_is_read_again_as_what_it_is(fitted, scanned, case):
    again = read_result(fitted.path)
    assert type(again) is FitResult
    assert again.up_to_date
    assert dict(again.parameters) == dict(fitted.parameters)
    assert type(read_result(scanned.path)) is ScanResult
    with pytest.raises(InputError):
        read_result(case.path)


def test_models_are_compared(case, tmp_path):
    free = fit(case)
    fixed = fit(
        case.with_values(
            {"parameters": {"E": {"start": "3 GPa", "bounds": ["1 GPa", "20 GPa"]}}}
            | {"in_situ.K0": 0.5}
        ),
        output=tmp_path / "fixed.fit.h5",
    )
    found = compare(free, fixed)
    assert found.chosen == "case"
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    assert "case is chosen" in repr(found)
    assert "<table>" in found._repr_html_()
    with pytest.raises(UsageError, match="compare\\(one, other\\)"):
        compare(free)


@pytest.mark.usefixtures("plain_pictures")
def test_a_report_is_that_of_the_command(scanned, tmp_path):
    page = report(scanned, output=tmp_path / "here.html")
    CliRunner().invoke(program, ["report", scanned.path, "-o", str(tmp_path / "there.html")])
    assert Path(page).read_bytes() == (tmp_path / "there.html").read_bytes()
    with pytest.raises(UsageError, match="a result"):
        report()


def test_exports_are_those_of_the_command(fitted, tmp_path):
    files = export(fitted, ["csv", "vtu"], output=tmp_path / "here")
    words = ["export", fitted.path, "--format", "csv", "--format", "vtu"]
    told = CliRunner().invoke(program, [*words, "-o", str(tmp_path / "there")])
    names = [Path(line).name for line in told.stdout.split()]
    assert [Path(file).name for file in files] == names
    for name in names:
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
    with pytest.raises(UsageError, match="no format 'xlsx'; there are csv, vtu, vtkhdf"):
        export(fitted, "xlsx")


def test_a_case_is_checked(case):
    found = check(case)
    assert found.summary.used == 3
    assert "valid" in repr(found)
    assert str(found).startswith(case.path)
    assert "<pre>" in found._repr_html_()


def test_readings_are_simulated_and_fitted(case, tmp_path):
    truth = case.with_values({"parameters.E.start": "7 GPa", "parameters.K0.start": 1.2})
    simulated = simulate(truth)
    file = simulated.write(tmp_path / "simulated.csv")
    assert Path(file).read_text().startswith(simulated.csv)
    Path(tmp_path / "mine.csv").write_text("mine")
    with pytest.raises(OutputError, match="force=True"):
        simulated.write(tmp_path / "mine.csv")
    found = fit(case.with_values({"readings": "simulated.csv"}))
    assert found.parameters["E"].value == pytest.approx(7e9, rel=1e-6)
    frame = simulated.to_frame(si=True)
    assert list(frame.columns) == ["channel", "stage", "value", "unit"]
    assert frame["value"].tolist() == [reading.value for reading in simulated.readings]
    assert simulated.to_frame()["value"].tolist() == pytest.approx((1e3 * frame["value"]).tolist())
    noisy = [simulate(truth, noise=True, seed=seed).csv for seed in (1, 1, 2)]
    assert noisy[0] == noisy[1] != noisy[2]


def test_a_template_is_written_and_loaded(tmp_path):
    found = init(tmp_path / "site", "opening")
    assert isinstance(found, CaseFile)
    assert found.parameters
    with pytest.raises(OutputError, match="force=True"):
        init(tmp_path / "site", "opening")
    with pytest.raises(UsageError, match="no template 'cave'; there are cavern, tunnel"):
        init(tmp_path / "other", "cave")


def printed_by(code):
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_the_package_loads_its_parts_when_asked():
    code = """
import sys, geoident
heavy = {'numpy', 'scipy', 'pydantic', 'h5py', 'yaml', 'matplotlib', 'pandas', 'xarray', 'click'}
print(sorted(heavy & set(sys.modules)), len([m for m in sys.modules if m.startswith('geoident')]))
"""
    assert printed_by(code) == "[] 1\n"


ON_DEMAND = ("matplotlib", "pandas", "xarray", "arviz", "scipy.stats", "scipy.optimize")
"""What the calls load when they draw, show, sample or search."""


@pytest.mark.slow
def test_calls_load_what_takes_long_when_it_is_needed():
    code = "import sys; from geoident import fit, load_case; print(*sys.modules)"
    assert not set(ON_DEMAND) & set(printed_by(code).split())


def test_nothing_but_drawings_imports_on_top_what_takes_long():
    top = re.compile(rf"^(?:from|import) (?:{'|'.join(ON_DEMAND)})\b", re.MULTILINE)
    package = ROOT / "geoident"
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if top.search(path.read_text(encoding="utf-8"))
    }
    assert {name for name in found if not name.startswith("report/drawing/")} == set()


def test_names_are_found_and_wrong_ones_are_not():
    assert {"fit", "load_case", "predict"} <= set(dir(geoident))
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        geoident.fitt  # noqa: B018


def test_a_star_brings_all_of_them():
    names = {}
    exec("from geoident import *", names)
    assert set(geoident._API) <= set(names)
    assert names["report"] is report


def test_the_function_stays_what_imports_of_its_namesake_do():
    """A folder of the package is called `report` too."""
    assert import_module("geoident.report.text.layout").number(1.0) == "1"
    assert geoident.report is report
    assert callable(report)


def test_names_and_types_are_the_same_everywhere():
    stub = (ROOT / "geoident" / "__init__.pyi").read_text()
    assert [line.split()[-1] for line in stub.splitlines() if " as " in line] == [*geoident._API]
    assert geoident.api.__all__ == [*geoident._API]
    assert all(getattr(geoident, name) is not None for name in geoident._API)


def functions():
    return {n: f for n in geoident._API if inspect.isfunction(f := getattr(geoident, n))}


def test_every_public_name_says_what_it_is():
    """Docstrings with arguments, errors, and units where numbers come back."""
    calls = functions()
    assert len(calls) == 21
    for name, call in calls.items():
        doc = inspect.getdoc(call)
        given = inspect.signature(call).parameters
        missing = [p for p in given if f"    {p}: " not in doc]
        assert not missing, (name, missing)
        assert "Raises:" in doc, name
    for name in set(geoident._API) - set(calls) - {"AnyPath", "Progress"}:
        described = getattr(geoident, name)
        assert len(inspect.getdoc(described)) > 30, name
        for part, member in vars(described).items():
            if not part.startswith("_") and (callable(member) or isinstance(member, property)):
                assert inspect.getdoc(member), f"{name}.{part}"


@pytest.mark.parametrize("call", [fit, scan, backtest, sample, batch])
@pytest.mark.parametrize("jobs", [0, -2, 1.5, True])
def test_a_number_of_processes_is_a_whole_number_from_one_on(call, jobs, case):
    given = case.path if call in (sample, batch) else case
    with pytest.raises(UsageError, match=r"jobs is .*: give a whole number from 1 on"):
        call(given, jobs=jobs)


@pytest.mark.parametrize(
    ("call", "step"),
    [(fit, "run_fit"), (scan, "run_scan"), (backtest, "run_backtest")],
    ids=["fit", "scan", "backtest"],
)
def test_processes_are_those_of_the_command(call, step, case, monkeypatch):
    case = case.with_values({"fit.scan.points": 3})
    asked = []
    module = import_module("geoident.api.runs")
    once = getattr(module, step)
    monkeypatch.setattr(
        module, step, lambda job, control: asked.append(control.jobs) or once(job, control)
    )
    with suppress(InputError):  # a case of one stage has no backtest
        call(case, jobs=1)
    with suppress(InputError):
        call(case)
    assert asked == [1, Options().jobs]


def test_calls_take_what_their_commands_take():
    """Who changes a default in one place is told of the other."""
    for call, request in ((fit, Request), (sample, SampleRequest)):
        for name, parameter in inspect.signature(call).parameters.items():
            known = {f: getattr(request, f) for f in ("seed", "solver", "draws", "effective")
                     if hasattr(request, f)}  # fmt: skip
            if name in known:
                assert parameter.default == known[name], (call, name)


def test_an_interrupted_call_goes_on(case):
    """As with the stop button of a notebook."""

    def stop(step):
        if step.number == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(case, progress=stop)
    checkpoint = Path(case.path).with_name("case.fit.checkpoint")
    assert checkpoint.exists()
    found = fit(case)
    assert found.converged
    assert not checkpoint.exists()
    whole = fit(case, output=Path(case.path).with_name("whole.h5"))
    assert found.parameters["E"].value == whole.parameters["E"].value
