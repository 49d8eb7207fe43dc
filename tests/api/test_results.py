"""Results to look at: tables, data frames, data sets, figures, and what a notebook shows."""

import base64
import json
import math
import re
from pathlib import Path

import matplotlib.axes
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from geoident import FitResult, fit
from geoident.api import calling
from geoident.cli.app import geoident as program
from geoident.errors import MissingExtra, UsageError
from geoident.report.text.csv_tables import csv_tables


def test_a_parameter_says_itself_in_the_unit_of_the_case(fitted):
    modulus = fitted.parameters["E"]
    assert modulus.unit == "Pa"
    assert modulus.lower95 < modulus.value < modulus.upper95
    assert re.fullmatch(r"4\.9\d? GPa \(95 %: \d.* to \d.*\)", str(modulus))
    with pytest.raises(KeyError, match=r"no parameter 'G'\. Parameters: E, K0"):
        fitted.parameters["G"]
    assert len(fitted.parameters) == 2
    assert fitted.parameters.values_si == {n: p.value for n, p in fitted.parameters.items()}


def test_what_is_not_determined_has_no_number(case):
    gauges = ("CV", "S", "X")
    found = fit(case.with_values({f"gauges.{name}.accuracy": "1 m" for name in gauges}))
    assert found.status == "not-determined"
    loose = [name for name, p in found.parameters.items() if not p.determined]
    assert loose
    for name in loose:
        assert math.isnan(found.parameters[name].value)
        assert str(found.parameters[name]) == "not determined"
        assert f"{name} not determined" in repr(found)
    assert found.parameters.to_frame().loc[loose, "value"].isna().all()
    assert np.isnan(found.to_xarray()["estimate"].sel(parameter=loose)).all()


def test_a_channel_stage_by_stage(fitted):
    channel = fitted.gauges["CV"]
    assert channel.stages == ("first", "second")
    assert channel.measured == pytest.approx([-0.598e-3, -1.077e-3])
    assert channel.at("first") == (channel.measured[0], channel.computed[0])
    assert channel.at("first")[1] == pytest.approx(-0.598e-3, abs=3e-5)
    assert channel.used.tolist() == [True, False]
    assert channel.unit == "m"
    assert channel.lower95[1] < channel.predicted[1] < channel.upper95[1]
    assert math.isnan(channel.predicted[0])
    assert set(fitted.gauges) == {"CV", "S", "X.a"}
    with pytest.raises(KeyError, match=r"no channel 'Y'\. Channels: CV, S, X"):
        fitted.gauges["Y"]
    with pytest.raises(KeyError, match=r"no channel 'X'\. Its channels: X\.a"):
        fitted.gauges["X"]
    with pytest.raises(KeyError, match="no stage 'third'"):
        channel.at("third")


def test_gauges_as_a_frame_agree_with_the_table_of_the_command(fitted):
    frame = fitted.gauges.to_frame()
    told = csv_tables(fitted.data)["gauges"]
    for name, other in (("channel", "gauge"), *((c, c) for c in ("stage", "unit", "used"))):
        assert frame[name].tolist() == [row[told.header.index(other)] for row in told.rows]
    for name in ("measured", "computed", "residual", "sd"):
        cells = [row[told.header.index(name)] for row in told.rows]
        assert frame[name].to_numpy() == pytest.approx(np.array(cells), nan_ok=True)
    assert frame["gauge"].tolist() == ["CV", "S", "X"] * 2
    later = frame[frame["stage"] == "second"]
    assert (later["lower95"] < later["upper95"]).all()
    si = fitted.gauges.to_frame(si=True)
    assert si["unit"].unique().tolist() == ["m"]
    assert 1e3 * si["measured"].to_numpy() == pytest.approx(frame["measured"].to_numpy())


def test_dated_stages_have_their_dates(case, fitted):
    assert "date" not in fitted.gauges.to_frame()
    assert "date" not in fitted.to_xarray().coords
    dates = {"first": "2025-03-03", "second": "2025-04-07 12:00"}
    found = fit(case.with_values({"dates": dates}))
    days = found.gauges.to_frame().set_index("stage")["date"]
    assert days.loc["first"].unique().tolist() == [pd.Timestamp("2025-03-03")]
    assert days.loc["second"].unique().tolist() == [pd.Timestamp("2025-04-07 12:00")]
    assert found.to_xarray()["date"].values[0] == np.datetime64("2025-03-03")


def test_every_table_of_the_export_is_there(fitted):
    told = csv_tables(fitted.data)
    assert list(fitted.tables) == list(told)
    for name, table in fitted.tables.items():
        frame = table.to_frame()
        assert tuple(frame.columns) == told[name].header
        assert len(frame) == len(table) == len(told[name].rows)
    assert fitted.predictions.column("stage") == ("second",) * 3
    assert "<table>" in fitted.predictions._repr_html_()
    with pytest.raises(KeyError, match="no column 'mean'"):
        fitted.predictions.column("mean")


def test_long_tables_are_shown_in_part(fitted):
    long = type(fitted.predictions)(("k",), tuple((float(k),) for k in range(100)))
    assert "... 70 more" in repr(long)
    assert len(long.to_frame()) == 100


def test_a_data_set_has_all_arrays_with_names(fitted):
    data, result = fitted.to_xarray(), fitted.data
    assert float(data["computed"].sel(channel="S", stage="second")) == result.gauges.computed[1, 1]
    assert data["sensitivity"].dims == ("channel", "stage", "parameter")
    assert float(data["estimate"].sel(parameter="E")) == fitted.parameters["E"].value
    moved = data["displacement"].sel(state="second", axis="y") - data["displacement"].sel(
        state="virgin", axis="y"
    )
    assert moved.values == pytest.approx(
        result.fields.displacement[2, :, 1] - result.fields.displacement[0, :, 1]
    )
    assert data["stress"].sel(component="yy").shape == (3, 24)
    assert data["displacement"].attrs["units"] == "m"
    assert data["reading_unit"].values.tolist() == ["m"] * 3
    assert data["parameter_unit"].values.tolist() == ["Pa", ""]
    assert data.attrs["status"] == "converged"
    assert float(data["predicted_upper95"].sel(channel="CV", stage="second")) == pytest.approx(
        fitted.gauges["CV"].upper95[1]
    )


def test_a_data_set_is_written_and_read_by_xarray(fitted, tmp_path):
    xarray = pytest.importorskip("xarray")
    fitted.to_xarray().to_netcdf(tmp_path / "all.nc", engine="h5netcdf")
    again = xarray.load_dataset(tmp_path / "all.nc", engine="h5netcdf")
    assert again["measured"].values == pytest.approx(fitted.data.gauges.measured)
    assert again["channel"].values.tolist() == ["CV", "S", "X.a"]


OVERVIEW = pytest.param("overview", marks=pytest.mark.slow)  # a notebook shows it, below


@pytest.mark.parametrize("name", [OVERVIEW, "gauges", "parameters", "field"])
def test_figures_are_axes(fitted, name):
    drawn = getattr(fitted.plot, name)()
    assert len(drawn) >= 1
    assert all(isinstance(axes, matplotlib.axes.Axes) for axes in drawn)
    assert {axes.get_figure(root=True) for axes in drawn} == set(drawn.figures)
    image = re.search(r'base64,([^"]+)"', drawn._repr_html_())
    assert base64.b64decode(image[1]).startswith(b"\x89PNG")


def test_a_field_is_that_of_its_stage(fitted):
    first, second = (fitted.plot.field(stage) for stage in ("first", "second"))
    assert "first" in first[0].get_title("left")
    assert "second" in second[0].get_title("left")
    assert "first" in fitted.plot.field()[0].get_title("left")  # the last that was fitted
    with pytest.raises(UsageError, match="Did you mean 'second'"):
        fitted.plot.field("secnd")
    with pytest.raises(UsageError, match="no quantity 'heat'"):
        fitted.plot.field(quantity="heat")
    with pytest.raises(UsageError, match="no section '2'"):
        fitted.plot.field(section=2)
    for quantity in fitted.plot.quantities():
        assert len(fitted.plot.field("second", quantity)) >= 1


def test_a_result_without_fields_says_so(scanned):
    assert scanned.plot.quantities() == ()
    with pytest.raises(UsageError, match="This scan holds no displacements and stresses: draw"):
        scanned.plot.field()


@pytest.mark.usefixtures("plain_pictures")
def test_figures_go_by_the_names_of_the_report(fitted, scanned, tmp_path):
    CliRunner().invoke(program, ["report", scanned.path, "--no-page", "--figures", str(tmp_path)])
    assert {path.stem for path in tmp_path.glob("*.svg")} == set(scanned.plot.names())
    drawn = fitted.plot.named("residuals")
    drawn[0].set_title("mine")
    assert drawn.figure.axes[0].get_title() == "mine"
    with pytest.raises(UsageError, match="Did you mean 'residuals'"):
        fitted.plot.named("residual")


def test_figures_are_not_left_to_pyplot(fitted):
    import matplotlib.pyplot as plt  # noqa: PLC0415

    fitted.plot.parameters()
    assert plt.get_fignums() == []


def test_a_result_shows_itself_briefly(fitted):
    assert repr(fitted).startswith("FitResult(case.fit.h5: converged; E = 4.9")
    assert len(repr(fitted)) < 200
    assert "\n" not in repr(fitted)
    told = CliRunner().invoke(program, ["show", fitted.path]).stdout
    assert str(fitted.parameters) in told
    assert str(fitted).splitlines()[0] in told


def test_a_notebook_shows_parameters_and_overview(fitted):
    html = fitted._repr_html_()
    assert "Trench" in html
    assert "<td>E</td>" in html
    assert html.count("<img ") == 1
    assert "<script" not in html
    assert "Displacements and gauges at a glance" in html
    assert "format: geoident-case" not in html


def test_a_notebook_escapes_what_users_write(case, monkeypatch):
    monkeypatch.setattr("geoident.api.plots._image", lambda figure, words: "")
    found = fit(case.with_values({"title": "<b>1 & 2</b>"}))
    assert "&lt;b&gt;1 &amp; 2" in found._repr_html_()
    assert "&lt;b&gt;1 &amp; 2" in case.with_values({"title": "<b>1 & 2</b>"})._repr_html_()


def test_a_missing_package_is_named_with_the_command_that_brings_it(fitted, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(calling, "import_module", missing)
    again = FitResult(fitted.data, fitted.path)
    for call, words in (
        (again.parameters.to_frame, 'to_frame needs pandas: pip install "geoident[notebook]"'),
        (again.to_xarray, 'to_xarray needs xarray: pip install "geoident[notebook]"'),
        (again.plot.overview, 'a figure needs matplotlib: pip install "geoident[report]"'),
    ):
        with pytest.raises(MissingExtra) as caught:
            call()
        assert str(caught.value) == words
        assert isinstance(caught.value, ImportError)
    html = again._repr_html_()  # the table is there all the same
    assert "<td>E</td>" in html
    assert "pip install" in html


def test_a_broken_package_is_not_called_missing(monkeypatch):
    def broken(name):
        raise ModuleNotFoundError("No module named 'numexpr'", name="numexpr")

    monkeypatch.setattr(calling, "import_module", broken)
    with pytest.raises(ModuleNotFoundError, match="numexpr"):
        calling.needed("pandas", extra="notebook", what="to_frame")


def test_json_and_python_say_the_same_of_predictions(fitted):
    told = json.loads(CliRunner().invoke(program, ["show", fitted.path, "--json"]).stdout)
    for entry in told["predictions"]:
        channel = fitted.gauges[entry["gauge"]]
        place = channel.stages.index(entry["stage"])
        assert channel.predicted[place] == entry["mean"]
        assert channel.upper95[place] == entry["upper95"]
    assert Path(told["output"]) == Path(fitted.path)
