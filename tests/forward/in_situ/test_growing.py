"""Constants that grow: their values and what is wrong of them, at a few points by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import make_case
from support.meshes import box, regroup

from geoident.forward.in_situ.growth import (
    growth_faults,
    growth_notes,
    point_growths,
    start_faults,
)
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Material, Stage
from geoident.model.dual import ParameterPoint
from geoident.model.ground import Growth, Isotropic, WithDepth, WithStress
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.parameter import Parameter, Scalar

VALUES = {"E": 4e7, "n": 0.6, "P": 9e4, "least": 3e4, "K": 0.7, "w": 2e4, "grad": 3e6, "top": 9.0}
PARAMETERS = tuple(Parameter(name, value, -1e9, 1e9) for name, value in VALUES.items())
STRESS = HeimStress(Scalar(1.0, "K"), unit_weight=Scalar(1.0, "w"), surface=Scalar(8.0))


def p(name, factor=1.0):
    return Scalar(factor, name)


def with_stress(**changes):
    law = WithStress(p("n"), p("P"), p("least"))
    return Growth("soil", "E", p("E"), replace(law, **changes), path=("materials", "soil", "E"))


def with_depth(surface=None):
    law = WithDepth(p("grad"), p("top") if surface is None else surface)
    return Growth("soil", "E", p("E"), law)


def on(growth, **changes):
    """Three squares on one another beside three others, of which the right ones are of rock."""
    mesh = regroup(box("quad4", (2, 3), size=(4.0, 9.0)), soil=lambda c: c[:, 0] < 2)
    plain = Isotropic(E=Scalar(1e9), nu=Scalar(0.2))
    soil = Material("soil", replace(plain, E=growth.base), growths=(growth,))
    settings = {
        "materials": {"soil": soil, "stone": Material("stone", plain)},
        "groups": {"rock": "stone", "soil": "soil"},
        "in_situ": STRESS,
        "parameters": PARAMETERS,
    }
    return CaseOnMesh(make_case(mesh, **{**settings, **changes}), mesh)


def against(found, by_hand, names):
    point = ParameterPoint(VALUES, tuple(names))
    columns = found.value(point).columns
    np.testing.assert_allclose(columns[:, 0], by_hand(VALUES), rtol=1e-10)
    for k, name in enumerate(names):
        h = 1e-4 * abs(VALUES[name])
        a, b, c, d = (by_hand({**VALUES, name: VALUES[name] + j * h}) for j in (-2, -1, 1, 2))
        slope = (a - 8 * b + 8 * c - d) / (12 * h)
        np.testing.assert_allclose(
            columns[:, 1 + k], slope, rtol=1e-6, atol=1e-9 * abs(slope).max()
        )


def test_growth_with_stress_by_hand():
    """p' = w depth (1 + 2 K) / 3; near the surface the least that counts."""
    on_mesh = on(with_stress())
    (found,) = point_growths(on_mesh)
    assert len(found.points) == 12
    assert (found.positions[:, 0] < 2).all()

    def by_hand(v):
        pressure = v["w"] * np.maximum(8.0 - found.positions[:, 1], 0.0) * (1 + 2 * v["K"]) / 3
        return v["E"] * (np.maximum(pressure, v["least"]) / v["P"]) ** v["n"]

    low = np.isclose(by_hand(VALUES), VALUES["E"] * (3e4 / 9e4) ** 0.6)
    assert 0 < low.sum() < 12
    against(found, by_hand, ("E", "n", "P", "least", "K", "w"))
    assert found.typical == pytest.approx(by_hand(VALUES).mean(), rel=1e-12)
    assert found.names == set(VALUES)
    assert found.n_outside == 0
    (note,) = growth_notes((found,), VALUES)
    part = 100 * low.mean()
    assert note.endswith(
        f"; at {part:.2g} % of its points p' is not above 30 kPa, which counts there"
    )
    ends = by_hand(VALUES) / 1e6
    assert f"at the start values {ends.min():.4g} MPa near (" in note
    assert f"to {ends.max():.4g} MPa near (" in note
    level = {**VALUES, "n": 0.0}
    (note,) = growth_notes((found,), level)
    assert note.endswith("at the start values 40 MPa everywhere")


def test_growth_with_depth_by_hand():
    (found,) = point_growths(on(with_depth()))

    def by_hand(v):
        return v["E"] + v["grad"] * (v["top"] - found.positions[:, 1])

    against(found, by_hand, ("E", "grad", "top"))
    assert found.names == {"E", "grad", "top"}
    assert found.typical == pytest.approx(by_hand(VALUES).mean(), rel=1e-12)
    (faced,) = point_growths(on(with_depth("y1")))
    assert faced.names == {"E", "grad"}
    against(faced, by_hand, ("E", "grad"))
    slow = replace(with_depth(), base=Scalar(9e6), law=WithDepth(Scalar(3e5), Scalar(9.0)))
    (note,) = growth_notes(point_growths(on(slow)), VALUES)
    ends = 9.0 + 0.3 * (9.0 - found.positions[:, 1])
    assert f"values {ends.min():.4g} MPa near (" in note  # 9 MPa, and more than 10
    assert f"to {ends.max():.4g} MPa near (" in note
    nothing = replace(with_depth(), base=Scalar(0.0), law=WithDepth(Scalar(0.0), Scalar(1.0)))
    (zero,) = point_growths(on(nothing))
    assert (zero.typical, zero.names) == (1.0, frozenset())


FILL = Stage("fill", install={"soil": "soil"})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, None),
        ({"in_situ": None}, "and the case has none"),
        ({"in_situ": None, "in_situ_of": {"soil": STRESS}}, None),
        ({"in_situ_of": {"soil": STRESS}}, None),
        ({"groups": {"rock": "stone", "soil": None}, "stages": (FILL,)},
         "and 'soil' is placed later, with no stress in situ"),
        ({"stages": (Stage("s", install={"rock": "soil"}, excavate=("rock",)),)}, None),
        ({"groups": {"rock": None, "soil": None},
          "stages": (Stage("a", install={"rock": "soil"}), Stage("b", install={"soil": "soil"}))},
         "and 'rock', 'soil' is placed later, with no stress in situ"),
        ({"groups": {"rock": None, "soil": "soil"},
          "stages": (Stage("a", install={"rock": "stone"}),)}, None),
    ],
)  # fmt: skip
def test_growth_with_a_stress_that_is_not_there(changes, said):
    found = growth_faults(on(with_stress(), **changes))
    assert [fault.message for fault in found] == (
        [] if said is None else [f"E of soil grows with the in-situ stress, {said}"]
    )
    assert all(fault.path == "materials.soil.E" for fault in found)
    assert growth_faults(on(with_depth(), **changes)) == []


@pytest.mark.parametrize(
    ("changes", "faulty"),
    [
        ({}, False),
        ({"pressure": p("P", -1.0)}, True),
        ({"least": Scalar(0.0)}, True),
        ({"least": Scalar(1e-9)}, False),
    ],
)
def test_pressures_of_growth_are_positive_at_the_start(changes, faulty):
    on_mesh = on(with_stress())
    (found,) = point_growths(on_mesh)
    found = replace(found, growth=with_stress(**changes))
    faults = start_faults(on_mesh.case, (found,))
    assert bool(faulty) == bool(faults)
    if faults:
        assert (
            "its 'pressure' and 'least' must be positive at the start values" in faults[0].message
        )


def test_values_of_growth_are_positive_at_the_start():
    growth = replace(with_depth(), law=WithDepth(p("grad", -3.0), p("top")))
    on_mesh = on(growth)
    (found,) = point_growths(on_mesh)
    (fault,) = start_faults(on_mesh.case, (found,))
    assert fault.message.endswith("where it must be positive at the start values")
    assert fault.hint.startswith("Correct the base, the growth, or the surface")
    (good,) = point_growths(on(with_depth()))
    assert start_faults(on_mesh.case, (good, found, good)) == [fault]
    pulled = ConstantStress((*[Scalar(5e4)] * 3, *[Scalar(0.0)] * 3))
    (least,) = point_growths(on(with_stress(), in_situ=pulled))
    np.testing.assert_allclose(
        least.value(ParameterPoint(VALUES, ())).value, 4e7 * (3e4 / 9e4) ** 0.6, rtol=1e-12
    )
