"""Cases from Python: varied, from texts and mappings, and what is said when they are wrong."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from geoident import check, fit, init, load_case, predict, simulate
from geoident.errors import InputError, OutputError, UsageError


def test_a_case_says_what_it_is(case):
    assert repr(case) == (
        f"CaseFile({case.path}: Trench, 2 stages, 3 channels, 6 readings, 2 parameters)"
    )
    assert (case.title, case.stages, case.parameters) == (
        "Trench",
        ("first", "second"),
        ("E", "K0"),
    )
    assert case.channels == ("CV", "S", "X.a")
    html = case._repr_html_()
    assert "<td>trench.inp</td>" in html
    assert "0.1 to 50" in html


@pytest.mark.parametrize(
    ("key", "value", "found"),
    [
        ("materials.rock.nu", 0.3, lambda c: c.materials["rock"]),
        ("parameters.E.start", "9 GPa", lambda c: c.start["E"]),
        ("parameters.E", {"start": "9 GPa", "bounds": ["1 GPa", "20 GPa"]}, lambda c: c.start["E"]),
        ("fit.stages", ["first", "second"], lambda c: c.fit.stages),
        ("fit.stages", ("first", "second"), lambda c: c.fit.stages),
        ("fit.gauss-newton.max_iterations", np.int64(3), lambda c: c.fit.methods[0].max_iterations),
        ("parameters.K0.bounds", np.array([0.1, 2.0]), lambda c: c.parameters[1].upper),
        ("fit.mesh_error", True, lambda c: c.fit.mesh_error),
        ("fit.reduced", False, lambda c: c.fit.reduced),
        ("fit.reduced", "keep", lambda c: c.fit.keep_reduced),
        ("title", "a: b", lambda c: c.title),
        ("title", "[one, two] \u2013 \U0001f600", lambda c: c.title),
    ],
)
def test_values_are_those_one_would_write(case, key, value, found):
    varied = case.with_values({key: value})
    assert found(varied.case) != found(case.case)
    assert key != "title" or varied.title == value
    assert load_case(case.path, {key: value}).case == varied.case


def test_values_add_up_and_the_last_one_counts(case):
    varied = case.with_values({"materials.rock.nu": 0.3}).with_values(
        {"parameters.E.start": "9 GPa"}
    )
    assert varied.overrides == ("materials.rock.nu=0.3", "parameters.E.start=9 GPa")
    assert "with materials.rock.nu=0.3" in repr(varied)
    again = varied.with_values({"parameters.E.start": "8 GPa"})
    assert again.case.start["E"] == 8e9
    assert case.case.start["E"] == 2e9


def test_a_parameter_is_taken_out_by_none(case):
    fixed = case.with_values({"parameters.K0": None, "in_situ.K0": 1.5})
    assert fixed.parameters == ("E",)


def test_a_study_varies_a_case(case, tmp_path):
    moduli = [
        fit(case.with_values({"materials.rock.nu": nu}), output=tmp_path / f"{nu}.h5")
        .parameters["E"]
        .value
        for nu in (0.2, 0.3)
    ]
    assert moduli[0] != pytest.approx(moduli[1], rel=1e-3)


def test_a_case_may_stand_in_a_text_or_a_mapping(case, tmp_path):
    text = Path(case.path).read_text()
    mapping = yaml.safe_load(text)
    mapping["materials"]["rock"]["nu"] = np.float64(0.25)
    place = Path(case.path).with_name("study.yaml")
    for content in (text, mapping):
        written = load_case(place, content=content)
        assert not place.exists()
        assert written.case.start == case.case.start
        varied = written.with_values({"parameters.E.start": "9 GPa"})
        assert varied.case.start["E"] == 9e9
        assert simulate(varied).readings
    assert check(written).summary.used == 3
    found = fit(written)
    assert Path(found.path).name == "study.fit.h5"
    assert found.parameters["E"].value == pytest.approx(fit(case).parameters["E"].value)
    assert predict(found).predictions.rows == found.predictions.rows
    assert predict(found, case=varied, output=tmp_path / "p.h5").converged


def test_faults_are_raised_with_their_places(case):
    Path(case.path).write_text(Path(case.path).read_text().replace("E: $E", "E: $F"))
    with pytest.raises(InputError) as caught:
        load_case(case.path)
    assert caught.value.faults[0].location.line > 1


def test_errors_come_from_the_call_alone(case):
    """Nobody has to read through the frames of geoident and of what it uses."""
    with pytest.raises(InputError) as caught:
        case.with_values({"materials.rock.mu": 0.3})
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__
    assert [Path(entry.path).name for entry in caught.traceback] == ["test_cases.py", "calling.py"]


def test_faults_of_a_text_have_lines_and_those_of_a_mapping_keys(case):
    text = Path(case.path).read_text().replace("E: $E", "E: $F")
    for content, line in ((text, True), (yaml.safe_load(text), False)):
        with pytest.raises(InputError) as caught:
            load_case(case.path, content=content)
        (fault, *_) = caught.value.faults
        assert bool(fault.location.line) is line
        assert "materials.rock.E" in str(caught.value)


def test_errors_speak_python(case, fitted, tmp_path):
    """Each of these names flags on a command line."""
    with pytest.raises(InputError) as caught:
        case.with_values({"materials.rock.mu": 0.3})
    assert str(caught.value).startswith("overrides: ")
    with pytest.raises(InputError) as caught:
        load_case(case.path, {"": 1})
    assert caught.value.faults[0].location.file == "overrides"
    taken = tmp_path / "taken.h5"
    taken.write_text("mine")
    with pytest.raises(
        OutputError, match=r"force=True replaces it, output=\.\.\. writes elsewhere"
    ):
        fit(case, output=taken)
    with pytest.raises(OutputError, match=r"choose another place with output="):
        fit(case, output="no/such/folder/")
    with pytest.raises(OutputError, match="input of this call"):
        fit(case, output=case.path, force=True)
    with pytest.raises(UsageError, match=r"to output=\.\.\."):
        fit(case, output="-")
    with pytest.raises(InputError, match=r"`simulate\(case\)` needs none"):
        fit(case.with_values({"parameters.E": None, "parameters.K0": None,
                              "materials.rock.E": "1 GPa", "in_situ.K0": 1}))  # fmt: skip
    with pytest.raises(UsageError, match="There is no stage 'third'"):
        predict(fitted, stages=["third"])


def test_the_model_is_drawn_if_there_is_a_mesh(case, tmp_path):
    drawn = check(case).plot.model()
    assert len(drawn) >= 1
    assert "Trench" in drawn.captions[0]
    with pytest.raises(UsageError, match="no mesh"):
        check(init(tmp_path / "opening", "opening")).plot.model()
