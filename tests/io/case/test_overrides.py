"""Values given with --set."""

import pytest

from geoident.errors import InputError, Location
from geoident.io.text.faults import OVERRIDES
from geoident.model.methods import SimplexOptions


def test_values_and_sections_are_replaced(project):
    case = project.read(
        project.read().text,
        "parameters.K0={start: 2, bounds: [1, 3]}",
        "stages[1].name=bench one",
        "fit.stages[0]=bench one",
        "fit.method=simplex",
        "fit.simplex.restarts=0",
        'gauges["CV1"].accuracy=1 mm',
        "readings=[]",
        "gravity=",
    ).case
    assert (case.parameters[1].start, case.parameters[1].lower) == (2.0, 1.0)
    assert case.stages[1].name == "bench one"
    assert case.fit.methods == (SimplexOptions(restarts=0),)
    assert case.fit.stages == ("bench one",)
    assert case.channels[1].accuracy == 1e-3
    assert case.readings == ()
    assert case.gravity is None


def test_a_fit_section_is_made_where_the_case_has_none(project, changed):
    text = changed("fit: {method: gauss-newton, stages: [bench 1]}", "")
    assert project.read(text, "fit.method=simplex").case.fit.methods == (SimplexOptions(),)


def test_the_last_of_two_overrides_holds(project):
    case = project.read(project.read().text, "title=a", "title=b").case
    assert case.title == "b"


@pytest.mark.parametrize(
    ("override", "path", "words"),
    [
        ("parameters.E_rock.start=20", "parameters.E_rock.start", "no unit"),
        ("parameters.E_rock.start=200 GPa", "parameters.E_rock.start", "outside the bounds"),
        ("parameters.E_rok.start=20 GPa", "parameters.E_rok", "Did you mean 'E_rock'?"),
        ("fit={method: simplx}", "fit.method", "Did you mean 'simplex'?"),
        ("fit.metod=simplex", "fit.metod", "Did you mean 'method'?"),
        ("stages[7].name=x", "stages[7]", "has 2 entries"),
        ("stages.name=x", "stages.name", "is a list"),
        ("stages.1.name=x", "stages.1", "Write stages[1]: entries of a list are counted from 0"),
        ("stages.nothing.name=x", "stages.nothing", "Write stages[0]: entries"),
        ("gauges[0]=x", "gauges[0]", "Known: "),
        ("title.a=x", "title.a", "no mapping and no list"),
        ("title.a=x", "title.a", "Set it as a whole: title=VALUE."),
        ("title", "", "no '='"),
        ("=1", "", "not the path of a key"),
        ("a..b=1", "", "not the path of a key"),
        (".a=1", "", "not the path of a key"),
        ("[0]=1", "", "not the path of a key"),
        ("title=[", "", "not YAML"),
        ("title=*a", "", "alias"),
        ("title=\udcff", "", "UTF-8"),
    ],
)
def test_a_faulty_override_is_located_at_the_flag(override, path, words, project):
    text = project.read().text
    (fault,) = project.faults(text, override)
    assert fault.location == Location(OVERRIDES)
    assert words in f"{fault.message} {fault.hint}"
    if fault.path:
        assert fault.path.startswith(path) or path.startswith(fault.path)


@pytest.mark.parametrize("title", ["Cavern", "K0 is sought ($K0)"])
def test_parameters_that_an_override_leaves_idle_are_not_sought_and_that_is_noted(
    title, project, changed
):
    text = changed("title: Cavern", f"title: {title}")
    case = project.read(text, "in_situ.K0=1.2").case
    assert [parameter.name for parameter in case.parameters] == ["E_rock"]
    assert case.notes == ("K0 is not sought: overrides took away what depended on it",)
    both = ("in_situ.K0=$E_rock", "materials.rock.E=5 GPa")  # K0 idle, and another fault
    with pytest.raises(InputError) as caught:
        project.read(text, *both)
    assert [fault.code for fault in caught.value.faults] == ["unit"]
