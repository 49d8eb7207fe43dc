"""What a staged model and its responses say, and what they keep of an analysis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.meshes import box, regroup
from support.yielding import mohr, rock

from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.staged import equal_notes
from geoident.forward.stages import VIRGIN
from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.ground import Growth, WithDepth
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar

PARAMETERS = (
    Parameter("E", 6e9, 1e9, 2e10),
    Parameter("K0", 0.8, 0.3, 2.0),
    Parameter("b", 2e-3, -1.0, 1.0),
)
P, THERE = np.array([6e9, 0.8, 2e-3]), np.array([7e9, 0.9, 3e-3])
STAGES = (
    Stage("s1", excavate=("b0",)),
    Stage("s2", excavate=("b1",)),
    Stage("aside", loads={"q": Pressure("y1", Scalar(3e5))}, independent=True),
    Stage("s4", loads={"q": Pressure("y1", Scalar(2e5))}),
)
CHANNELS = (
    displacement("a", (2.0, 3.1), (0.6, 0.8)),
    displacement("late", (3.3, 2.2), (0.0, 1.0), zero="s1"),
    replace(displacement("own", (1.1, 3.7), (1.0, 0.0)), offset=Scalar(1.0, "b")),
)
NAMES = [stage.name for stage in STAGES]
ALL = [(c.name, s) for c in CHANNELS for s in NAMES if (c.name, s) != ("late", "s1")]


def mesh():
    made = box("quad4", (4, 5), size=(4.0, 5.0), distortion=0.1)
    return regroup(
        made, b0=lambda c: (c[:, 0] < 1) & (c[:, 1] < 1), b1=lambda c: (c[:, 0] < 1) & (c[:, 1] < 2)
    )


def staged(**changes):
    settings = {
        "materials": {"rock": material("rock", Scalar(1.0, "E"), 0.27)},
        "groups": dict.fromkeys(("b0", "b1", "rock"), "rock"),
        "supports": rollers(2),
        "in_situ": HeimStress(K0=Scalar(1.0, "K0"), vertical=Scalar(5e6)),
        "parameters": PARAMETERS,
        "stages": STAGES,
        "channels": CHANNELS,
    }
    return model(mesh(), **{**settings, **changes})


def table_of(found):
    return {(c.name, s): found.computed[k, j] for k, c in enumerate(CHANNELS)
            for j, s in enumerate(NAMES)}  # fmt: skip


def test_a_survey_is_what_a_response_reads_and_its_derivatives():
    found, table = staged().survey(P, fields=False), staged()
    values, jacobian = table.response(ALL).evaluate(P)
    listed = table_of(found)
    np.testing.assert_allclose([listed[pair] for pair in ALL], values, rtol=1e-10)
    places = [([c.name for c in CHANNELS].index(c), NAMES.index(s)) for c, s in ALL]
    size = np.abs(jacobian).max(axis=0)
    for (k, j), row in zip(places, jacobian, strict=True):
        np.testing.assert_allclose(found.sensitivity[k, j] / size, row / size, atol=1e-9)
    assert found.computed[1, 0] == pytest.approx(0.0, abs=1e-18)  # at its zero
    assert np.isfinite(found.computed).all()
    assert found.fields is None
    assert table.unreadable("late", VIRGIN) is not None
    assert table.unreadable("late", "s2") is None


def test_a_survey_to_a_state_leaves_the_later_ones_open():
    whole = staged().survey(P, fields=True)
    for last in (1, 2):
        part = staged()
        found = part.survey(P, fields=True, last=last)
        np.testing.assert_allclose(found.computed[:, :last], whole.computed[:, :last], rtol=1e-9)
        assert np.isnan(found.computed[:, last:]).all()
        assert np.isnan(found.sensitivity[:, last:]).all()
        assert len(found.fields.displacement) == last + 1
        assert part.counts.factorizations == last


@pytest.mark.parametrize("derivatives", [True, False])
def test_an_evaluation_depends_on_its_parameters_alone(derivatives):
    """Whatever was evaluated, surveyed or asked for at other places before."""
    fresh, used = staged().response(ALL), staged()
    response = used.response(ALL)
    response.evaluate(THERE)
    used.survey(THERE, fields=True, last=2)
    used.response(ALL[:2]).evaluate(P)
    used.computed(THERE)
    found, exact = (r.evaluation(P, derivatives=derivatives) for r in (response, fresh))
    np.testing.assert_allclose(found.readings, exact.readings, rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(found.increments, exact.increments, rtol=1e-9, atol=1e-15)
    if derivatives:
        size = np.abs(exact.jacobian).max(axis=0)
        np.testing.assert_allclose(found.jacobian / size, exact.jacobian / size, atol=1e-9)
    else:
        assert found.jacobian is exact.jacobian is None


def test_increments_add_up_to_readings():
    one = staged()
    response = one.response(ALL)
    first = response.increments(P)
    assert np.abs(response.increments(THERE) - first).max() > 1e-6
    assert first.shape == (5, 3)
    parts = one.steps(ALL) * first[:, [[c.name for c in CHANNELS].index(c) for c, _ in ALL]]
    offsets = [P[2] * (c == "own") for c, _ in ALL]
    np.testing.assert_allclose(parts.sum(axis=0) + offsets, response.readings(P), rtol=1e-9)
    early = one.response([("a", "s2")]).increments(P)  # up to the last stage that is read
    np.testing.assert_allclose(early[:3], first[:3], rtol=1e-9, atol=1e-15)
    assert not early[3:].any()


def test_what_is_known_of_a_model():
    one = staged()
    assert one.values(P) == {"E": 6e9, "K0": 0.8, "b": 2e-3}
    assert one.admissible(P) is None
    assert one.admissible(P * [np.inf, 1, 1]) == "a parameter is not finite"
    assert "E of rock is -6" in one.admissible(-P)
    assert len(one.n_dofs) == 5
    free = len(np.unique(mesh().blocks[0].nodes)) * 2 - 5 - 6
    assert one.n_dofs[0] == free
    assert one.n_dofs[1:] == (free, *(free - 1,) * 3)  # a node on x = 0 leaves with b1
    told = []
    one.on_state = told.append
    one.computed(P)
    assert told == [0, 1, 2, 3, 4]


def test_condensed_equations_with_errors_that_are_shared():
    """A matrix of weights that is diagonal is a list of deviations; any other weighs residuals."""
    one = staged(stages=STAGES[:2])
    pairs = [("a", "s1"), ("a", "s2"), ("own", "s2")]
    response = one.response(pairs)
    v, jacobian = response.evaluate(P)
    measured = v * [1.1, 0.8, 1.3]
    sd = np.array([1e-4, 2e-4, 5e-5])
    by_list = response.condense(P, measured, sd)
    by_matrix = response.condense(P, measured, np.diag(1.0 / sd))
    rows = [np.asarray(x) for x in vars(by_list).values()]
    same = [np.asarray(x) for x in vars(by_matrix).values()]
    for x, y in zip(rows, same, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-7, atol=1e-9 * np.abs(x).max())
    # at readings that are computed nothing is to be corrected: the Jacobian is that of the analysis
    still = [np.asarray(x) for x in vars(response.condense(P, v, sd)).values()]
    np.testing.assert_allclose(still[0], v, rtol=1e-9)
    size = np.abs(jacobian).max(axis=0)
    np.testing.assert_allclose(-still[2] / size, jacobian / size, atol=1e-8)
    np.testing.assert_allclose(still[3], still[2] @ P, rtol=1e-7)


def test_what_comes_before_a_collapse_has_fields():
    """A column that is loaded from above, lightly and then beyond its strength."""
    loads = [{"q": Pressure("y1", Scalar(q))} for q in (1e5, 6e7)]
    one = model(
        box("quad4", (1, 1)), materials={"rock": rock(6e9, 0.27, mohr(Scalar(1.0, "c"), 0.0))},
        groups={"all": "rock"}, supports=rollers(2), parameters=(Parameter("c", 9e7, 1e4, 1e8),),
        stages=(Stage("light", loads=loads[0]), Stage("heavy", loads=loads[1])),
        channels=(displacement("a", (0.4, 0.9), (0.0, 1.0)),),
    )  # fmt: skip
    strong, weak = np.array([9e7]), np.array([2e6])
    whole = one.survey(strong, fields=True)
    known = one.fields_up_to_collapse(strong)
    np.testing.assert_allclose(known.displacement, whole.fields.displacement, rtol=1e-9)
    with pytest.raises(CollapseError):
        one.response([("a", "heavy")]).readings(weak)
    part = one.survey(weak, fields=True, partial=True)
    assert len(part.collapses) == 1
    assert np.isfinite(part.computed).tolist() == [[True, False]]
    found = one.fields_up_to_collapse(weak)
    np.testing.assert_allclose(found.displacement, part.fields.displacement, rtol=1e-9)
    np.testing.assert_allclose(found.displacement[1], whole.fields.displacement[1], rtol=1e-9)
    assert len(list(one.at(strong, RunOptions(derivatives=False)).states())) == 3


def test_channels_of_equal_principal_stresses_are_told_with_a_stage():
    (first, second) = equal_notes({"a": 2, "b": 1}, ("virgin", "one", "two"))
    assert first.startswith("gauge 'a' reads one of several equal principal stresses at 'two':")
    assert second.startswith("gauge 'b' reads one of several equal principal stresses at 'one':")


def test_most_points_beside_surfaces_are_told_of_ground_loads_and_growth():
    """The largest number of the three, not their sum."""
    made = mesh()
    top = made.facet_groups["y1"]
    centres = np.concatenate([made.points[f.nodes].mean(axis=1) for f in made.facets])
    groups = {
        **made.facet_groups,
        "half": top[centres[top, 0] < 2],
        "most": top[centres[top, 0] < 3],
    }
    made = replace(made, facet_groups=groups)

    def told(stress, growth):
        own = Growth("rock", "E", Scalar(1.0, "E"), WithDepth(Scalar(1e6), growth))
        ground = replace(material("rock", Scalar(1.0, "E"), 0.27), growths=(own,))
        in_situ = HeimStress(Scalar(1.0, "K0"), unit_weight=Scalar(1e4), surface=stress)
        notes = model(
            made, materials={"rock": ground}, groups=dict.fromkeys(("b0", "b1", "rock"), "rock"),
            supports=rollers(2), in_situ=in_situ, parameters=PARAMETERS, stages=STAGES[:1],
        ).notes  # fmt: skip
        found = [note for note in notes if "lie beside the faces" in note]
        return [int(note.split()[0]) for note in found]

    assert told(Scalar(5.0), Scalar(5.0)) == []
    (half,), (most,) = told("half", Scalar(5.0)), told("most", Scalar(5.0))
    assert half > most > 0
    assert told("most", "half") == told("half", "most") == [half]
    assert told(Scalar(5.0), "most") == [most]
