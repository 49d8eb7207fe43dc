"""The staged model as arrays: they answer as the analysis does, and say why they are none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from support.all_at_once import bracing
from support.cases import displacement, material, model, rollers
from support.meshes import box, regroup
from support.yielding import given, mohr, rock

from geoident.forward.equations import export_obstacle
from geoident.model.actions import Pressure
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.ground import Attitude
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import WeakPlane

P = {"E": 8e9, "El": 1e10, "sv": 5e6, "q": 2e5, "k": 3e8}
HERE = np.array(list(P.values()))


def braced(**changes):
    """A dig in ground that could yield, filled again, with a plate, bolts and jacked struts."""
    mesh = regroup(
        box("quad4", (5, 5), size=(10.0, 10.0), distortion=0.1),
        dug=lambda c: (c[:, 0] < 2) & (c[:, 1] > 4) & (c[:, 1] < 8),
        soil=lambda c: c[:, 1] > 6,
    )
    normals = np.random.default_rng(4).normal(size=(3, 6))
    normals[:, 4:] = 0.0
    settings = {
        "parameters": tuple(Parameter(n, v, 0.2 * v, 5.0 * v) for n, v in P.items()),
        "materials": {
            "rock": rock(Scalar(1.0, "E"), 0.25,
                         given(normals, [Scalar(1.0, "k"), 4e8, Scalar(2.0, "k")], 1e8)),
            "soil": material("soil", Scalar(0.5, "E"), 0.3, 2000.0),
            "fill": rock(Scalar(1.0, "El"), 0.2, given(normals[:2], [5e8, Scalar(1.0, "k")]),
                         name="fill"),
        },
        "groups": {"dug": "rock", "soil": "soil", "rock": "rock"},
        "supports": (*rollers(2), Support("x1", (0,))),
        "in_situ": HeimStress(vertical=Scalar(1.0, "sv"), K0=Scalar(0.7)),
        "structures": bracing(((5.0, 8.5), (6.5, 9.5)), thickness=0.4),
        "stages": (
            Stage("open", excavate=("dug",), build=("plate", "bolts")),
            Stage("brace", build=("struts",), loads={"q": Pressure("y1", Scalar(1.0, "q"))}),
            Stage("aside", change={"rock": "soil"}, independent=True),
            Stage("fill", install={"dug": "fill"}, dismantle=("bolts",)),
            Stage("end", excavate=("soil",), remove=("q",), dismantle=("plate", "bolts"),
                  base="brace"),
        ),
        "channels": (
            displacement("a", (3.0, 5.0), (0.6, 0.8), zero="open"),
            displacement("b", (7.0, 3.0), (1.0, 0.0)),
            displacement("c", (5.0, 1.0), (0.0, 1.0), zero="brace"),
        ),
    }  # fmt: skip
    return model(mesh, **{**settings, **changes})


FAR = (displacement("b", (7.0, 3.0), (1.0, 0.0)),)
PAIRS = [
    *(("b", s) for s in ("open", "brace", "aside", "fill", "end")),
    *(("a", s) for s in ("brace", "aside", "fill")),
    *(("c", s) for s in ("aside", "fill", "end")),
]


def solved(system, p):
    """Unknowns of the equations where no multiplier is positive; readings and slacks there."""
    c, A = system.equations.at(p)
    free = np.setdiff1d(np.arange(A.shape[1]), system.multipliers)
    x = np.zeros(A.shape[1])
    x[free] = spsolve(A.tocsc()[:, free], -c)
    readings, slacks = (part.at(p) for part in (system.readings, system.slacks))
    return readings[0] + readings[1] @ x, slacks[0] + slacks[1] @ x


@pytest.mark.parametrize("gravity", [None, (0.4, -3.0)])
@pytest.mark.parametrize("scale", [np.ones(5), np.array([0.7, 1.3, 1.5, 2.0, 0.9])])
def test_equations_of_ground_far_from_yielding_answer_as_the_march(gravity, scale):
    """Also where the virgin stress is out of balance: then the virgin state is the first stage."""
    staged = braced(gravity=gravity)
    response, p = staged.response(PAIRS), HERE * scale
    assert response.system_obstacle() is None
    arrays = response.equation_arrays()
    names = [stage.name for stage in arrays.stages]
    assert names == [*(["virgin"] if gravity else []), "open", "brace", "aside", "fill", "end"]
    values = response.readings(p)
    found, slacks = solved(response.system(), p)
    np.testing.assert_allclose(found, values, rtol=1e-8, atol=1e-10 * np.abs(values).max())
    assert slacks.min() > 0.0
    # each slack is k - n^T sigma of a plane at a point of what yields there, in no virgin state
    laws = {law.n_planes for stage in arrays.stages for law in
            (arrays.laws[k] for k in stage.laws.values())}  # fmt: skip
    assert laws == {0, 2, 3}
    if gravity:
        assert {arrays.laws[k].n_planes for k in arrays.stages[0].laws.values()} == {0}
    assert [stage.base for stage in arrays.stages] == (
        [-1, 0, 1, 2, 2, 2] if gravity else [-1, 0, 1, 1, 1]
    )
    fresh = [sorted(arrays.sets[s].name for s in stage.fresh) for stage in arrays.stages]
    assert fresh[-5:] == [
        ["bolts", "plate", "plate"], [], [], ["dug"], []
    ]  # fmt: skip


def test_stress_that_is_not_there_at_first_is_none():
    """What is placed later has no in-situ stress, whatever the model of that would be."""
    staged = braced(groups={"dug": None, "soil": "soil", "rock": "rock"},
                    stages=(Stage("fill", install={"dug": "fill"}),), structures={},
                    channels=FAR)  # fmt: skip
    arrays = staged.response([("b", "fill")]).equation_arrays()
    initial = {one.name: one.initial.at(HERE) for one in arrays.sets}
    assert not initial["dug"].any()
    expected = np.array([-0.7, -1.0, -0.7, 0.0]) * P["sv"]
    np.testing.assert_allclose(
        initial["rock"], np.outer(expected, np.ones(initial["rock"].shape[1]))
    )


def obstacle(**changes):
    staged = braced(structures={}, channels=FAR, **changes)
    names = tuple(p.name for p in staged.case.parameters)
    values = {p.name: p.start for p in staged.case.parameters}
    return export_obstacle(staged.analysis, ParameterPoint(values, names))


def one(**stage):
    return {"stages": (Stage("first"), Stage("odd", **stage))}


def test_what_the_equations_do_not_know_is_named():
    assert obstacle(**one()) is None
    released = {"excavate": ("dug",), "release": {"dug": Scalar(0.5)}}
    assert obstacle(**one(**released)) == "the stage 'odd' releases stress in part"
    warm = {"temperature": {"rock": Scalar(5.0)}}
    assert obstacle(**one(**warm)) == "the stage 'odd' changes temperatures"
    support = {"supports": {"x1": None}}
    assert obstacle(**one(**support)) == "the stage 'odd' changes what is held"


def grounds(*surfaces, **more):
    """Only the rock, of some surfaces."""
    rocks = {"rock": rock(Scalar(1.0, "E"), 0.25, *surfaces)}
    names = {"materials": rocks, "groups": dict.fromkeys(("dug", "soil", "rock"), "rock")}
    return {**names, **one(), **more}


def test_what_the_planes_of_a_law_may_not_do_is_named():
    free = {"parameters": (Parameter("E", 8e9, 1e9, 1e10), Parameter("f", 0.5, 0.1, 0.7),
                           Parameter("sv", 5e6, 1e6, 9e6))}  # fmt: skip
    smooth = "rock yields by an exact surface, which has no planes (give 'planes')"
    assert obstacle(**grounds(mohr(1e9, 0.5), **free)) == smooth
    turned = mohr(1e9, Scalar(1.0, "f"), planes=8)
    assert obstacle(**grounds(turned, **free)) == "f turns the yield planes of rock"
    weak = WeakPlane(Attitude(Scalar(1.0, "f"), Scalar(np.pi / 2)), Scalar(1e9), Scalar(0.3))
    assert obstacle(**grounds(weak, **free)) == "f turns the yield planes of rock"
    assert obstacle(**grounds(mohr(1e9, 0.5, planes=8), **free)) is None
    assert obstacle(**grounds(mohr(Scalar(1e9, "f"), 0.5, planes=8), **free)) is None
