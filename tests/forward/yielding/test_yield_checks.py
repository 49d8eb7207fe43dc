"""What is said of yield limits before and while they are computed with."""

from __future__ import annotations

from math import pi, radians
from types import SimpleNamespace

import pytest
from support.cases import make_case, material, model, rollers
from support.meshes import box

from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.yielding.checks import no_stress_left, yield_faults, yield_notes
from geoident.model.case import Analysis, Material, Stage
from geoident.model.ground import Attitude
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import (
    DruckerPrager,
    GivenPlanes,
    MohrCoulomb,
    WeakPlane,
    YieldPlane,
    YieldSurface,
)

SECTION = SimpleNamespace(dim=2)
SOUND = MohrCoulomb(Scalar(1e6), Scalar(0.5))
FLAT = Attitude(Scalar(0.0), Scalar(0.0))
IN_SITU = ConstantStress((Scalar(-1e6),) * 4)


def yielding(*surfaces: YieldSurface) -> Material:
    plain = material("rock", 1e9, 0.25)
    return Material("rock", plain.elastic, yields=surfaces)


def case_of(*surfaces: YieldSurface, **changes):
    changes = {"materials": {"rock": yielding(*surfaces)}, "in_situ": IN_SITU, **changes}
    return make_case(SECTION, **changes)


def facing(left: Scalar, right: Scalar) -> GivenPlanes:
    """Planes that leave -left <= sigma_xx <= right."""
    return GivenPlanes(
        (
            YieldPlane("right", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), right),
            YieldPlane("left", (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0), left),
        )
    )


def parameter(name, start, lower, upper):
    return Parameter(name, start, lower, upper, dimension="pressure", unit="Pa")


def test_every_material_that_yields_is_described():
    assert yield_notes(make_case(SECTION, materials={"steel": material("steel", 1e9, 0.3)})) == []
    (note,) = yield_notes(case_of(SOUND))
    assert note == "'rock' yields by Mohr-Coulomb, smooth, with associated flow"
    (note,) = yield_notes(
        case_of(
            MohrCoulomb(Scalar(1e6), Scalar(0.0), planes=8),
            WeakPlane(Attitude(Scalar(0.3), Scalar(pi / 2)), Scalar(1e5), Scalar(0.4)),
        )
    )
    assert note == (
        "'rock' yields by Tresca (best fit) and a weak plane: 26 planes, with associated flow"
    )


def test_a_cut_off_beyond_the_apex_is_noted():
    apex = 1e6 / 0.5463024898437905  # tan(0.5)
    for tension, known in ((0.99 * apex, 1), (1.01 * apex, 2)):
        notes = yield_notes(case_of(MohrCoulomb(Scalar(1e6), Scalar(0.5), tension=Scalar(tension))))
        assert len(notes) == known


def test_planes_without_stress_between_them():
    bounds = (parameter("k", -2e6, -3e6, 2e6), parameter("q", 1e6, 1e6, 2e6))
    left = facing(Scalar(1.0, "k"), Scalar(1.0, "q"))
    (fault,) = yield_faults(case_of(left, parameters=bounds))
    assert fault.code == "empty-domain"
    assert "'right' and 'left'" in fault.message
    assert "at the start" in fault.message
    (fault,) = yield_faults(
        case_of(left, parameters=(parameter("k", -2.5e6, -3e6, -2.1e6), bounds[1]))
    )
    assert "wherever the parameters are" in fault.message
    tied = facing(Scalar(-1.5, "q"), Scalar(1.0, "q"))  # each alone could do, not both
    (fault,) = yield_faults(case_of(tied, parameters=bounds))
    assert "wherever the parameters are" in fault.message
    assert yield_faults(case_of(facing(Scalar(1e6), Scalar(0.0)))) == []


def test_planes_that_leave_no_stress_are_outside_the_domain_of_the_model():
    case = case_of(facing(Scalar(1.0, "k"), Scalar(1.0, "q")))
    rock = case.materials["rock"]
    assert no_stress_left(case, rock, {"k": -1e6, "q": 2e6}) is None
    assert no_stress_left(case, rock, {"k": 1e6, "q": 2e6}) is None
    reason = no_stress_left(case, rock, {"k": -1e6, "q": 0.5e6})
    assert reason == ("no stress satisfies the yield planes 'right' and 'left' of rock together")


@pytest.mark.parametrize(
    ("surface", "values", "reason"),
    [
        (MohrCoulomb(Scalar(1.0, "c"), Scalar(0.5)), {"c": -1e6}, "cohesion of rock is -1e+06 Pa"),
        (MohrCoulomb(Scalar(1.0, "c"), Scalar(0.0)), {"c": 0.0}, "must be positive"),
        (MohrCoulomb(Scalar(1e6), Scalar(1.0, "f")), {"f": pi / 2}, "friction of rock is 90 deg"),
        (DruckerPrager(Scalar(1e6), Scalar(1.0, "f")), {"f": -0.1}, "from 0 to below 90 deg"),
        (
            MohrCoulomb(Scalar(1e6), Scalar(0.5), Scalar(1.0, "f")),
            {"f": radians(40)},
            "dilation of rock is 40 deg",
        ),
        (
            WeakPlane(
                Attitude(Scalar(0.0), Scalar(0.0)), Scalar(1e6), Scalar(0.5), Scalar(1.0, "t")
            ),
            {"t": -1.0},
            "tension of rock is -1 Pa, it must not be negative",
        ),
    ],
)
def test_strengths_outside_the_domain_are_named(surface, values, reason):
    assert reason in inadmissible(yielding(surface), values)
    assert inadmissible(yielding(SOUND), {}) is None


def test_what_enters_free_of_stress_must_bear_that():
    below = facing(Scalar(-1e6), Scalar(2e6))
    stages = (Stage("fill", install={"a": "rock"}),)
    (fault,) = yield_faults(case_of(below, stages=stages))
    assert "installed free of stress at stage 'fill'" in fault.message
    (fault,) = yield_faults(case_of(below, in_situ=None, groups={"a": "rock"}))
    assert "begins free of stress" in fault.message
    case = case_of(below, groups={"a": "rock"})
    assert yield_faults(case) == []
    assert "cannot be free of stress" in yield_notes(case)[1]


def test_weak_planes_about_an_axis_lie_flat_or_upright():
    def faults(dip):
        weak = WeakPlane(Attitude(Scalar(dip), Scalar(pi / 2)), Scalar(1e6), Scalar(0.5))
        return yield_faults(case_of(weak, analysis=Analysis.AXISYMMETRIC))

    assert faults(0.0) == []
    assert faults(pi / 2) == []
    assert "all around" in faults(0.5)[0].message


def test_weak_planes_strike_across_a_section():
    weak = WeakPlane(Attitude(Scalar(0.5), Scalar(pi / 3)), Scalar(1e6), Scalar(0.5))
    (fault,) = yield_faults(case_of(weak))
    assert fault.code == "antiplane"
    assert yield_faults(case_of(weak, analysis=Analysis.SOLID)) == []


def test_condensation_is_told_that_the_ground_yields():
    def obstacle(*surfaces):
        staged = model(
            box("quad4", (2, 2)),
            materials={"rock": yielding(*surfaces), "spare": yielding(SOUND)},
            groups={"all": "rock"},
            supports=rollers(2),
        )
        return staged.response(()).obstacle()

    assert obstacle() is None
    assert obstacle(SOUND) == "rock yields: its stresses are not linear in the displacements"
