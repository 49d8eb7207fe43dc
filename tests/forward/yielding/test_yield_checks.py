"""What is said of yield limits before and while they are computed with."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians, tan
from types import SimpleNamespace

import pytest
from support.cases import make_case, material, model, rollers
from support.meshes import box
from support.yielding import hoek, mohr

from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.yielding.checks import no_stress_left, yield_faults, yield_notes
from geoident.model.case import Analysis, Material, Stage
from geoident.model.ground import Attitude, Growth, RandomField, TransverselyIsotropic, WithDepth
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import (
    DruckerPrager,
    GivenPlanes,
    WeakPlane,
    YieldPlane,
    YieldSurface,
)

SECTION = SimpleNamespace(dim=2)
SOUND = mohr(1e6, 0.5)
FLAT = Attitude(Scalar(0.0), Scalar(0.0))
IN_SITU = ConstantStress((Scalar(-1e6),) * 4)


def yielding(*surfaces: YieldSurface) -> Material:
    plain = material("rock", 1e9, 0.25)
    return Material("rock", plain.elastic, yields=surfaces)


def case_of(*surfaces: YieldSurface, **changes):
    changes = {"materials": {"rock": yielding(*surfaces)}, "in_situ": IN_SITU, **changes}
    return make_case(SECTION, **changes)


def tied(name: str) -> Scalar:
    return Scalar(1.0, name)


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
    assert note == "'rock' yields by Mohr-Coulomb, exact, with associated flow"
    (note,) = yield_notes(
        case_of(
            mohr(1e6, 0.0, planes=8),
            WeakPlane(Attitude(Scalar(0.3), Scalar(pi / 2)), Scalar(1e5), Scalar(0.4)),
        )
    )
    assert note == (
        "'rock' yields by Tresca (best fit) and a weak plane: 26 planes, with associated flow"
    )


def test_planes_that_leave_no_stress_are_outside_the_domain_of_the_model():
    case = case_of(facing(tied("k"), tied("q")))
    rock = case.materials["rock"]
    assert no_stress_left(case, rock, {"k": -1e6, "q": 2e6}) is None
    assert no_stress_left(case, rock, {"k": 1e6, "q": 2e6}) is None
    reason = no_stress_left(case, rock, {"k": -1e6, "q": 0.5e6})
    assert reason == ("no stress satisfies the yield planes 'right' and 'left' of rock together")


@pytest.mark.parametrize(
    ("surface", "values", "reason"),
    [
        (mohr(tied("c"), 0.5), {"c": -1e6}, "cohesion of rock is -1e+06 Pa"),
        (mohr(tied("c"), 0.0), {"c": 0.0}, "must be positive"),
        (mohr(1e6, tied("f")), {"f": pi / 2}, "friction of rock is 90 deg"),
        (DruckerPrager(Scalar(1e6), tied("f")), {"f": -0.1}, "from 0 to below 90 deg"),
        (mohr(1e6, 0.5, psi=tied("f")), {"f": radians(40)}, "dilation of rock is 40 deg"),
        (
            WeakPlane(FLAT, Scalar(1e6), Scalar(0.5), tied("t")),
            {"t": -1.0},
            "tension of rock is -1 Pa, it must not be negative",
        ),
    ],
)
def test_strengths_outside_the_domain_are_named(surface, values, reason):
    assert reason in inadmissible(yielding(surface), values)
    assert inadmissible(yielding(SOUND), {}) is None


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


def field(constant, surface=None, *, path="here"):
    return RandomField(
        "rock", constant, Scalar(1e6), 0.3, (5.0,), FLAT, surface=surface, path=(path,)
    )


def varied(*surfaces, fields=(), growths=(), elastic=None):
    """Faults of a material of which some constants vary, as code, path, message and hint."""
    ground = replace(yielding(*surfaces), fields=fields, growths=growths)
    ground = ground if elastic is None else replace(ground, elastic=elastic)
    faults = yield_faults(make_case(SECTION, materials={"rock": ground}, in_situ=IN_SITU))
    assert {fault.code for fault in faults} <= {"field"}
    return [(fault.path, fault.message, fault.hint) for fault in faults]


SMALL = GivenPlanes(
    (
        YieldPlane("first", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), Scalar(1e6)),
        YieldPlane("second", (0.0, 1.0, 0.0, 0.0, 0.0, 0.0), Scalar(1e6)),
    ),
    Scalar(2e6),
)


def test_elasticity_varies_as_a_whole_or_not_at_all():
    assert varied(SOUND, fields=(field("E"),)) == []
    growth = Growth("rock", "E", Scalar(1e6), WithDepth(Scalar(1e5), Scalar(0.0)), path=("up",))
    assert varied(SOUND, growths=(growth,)) == []
    moduli = {name: Scalar(1e9) for name in ("E_p", "E_n", "G_np")}
    ratios = {name: Scalar(0.2) for name in ("nu_p", "nu_np")}
    strata = TransverselyIsotropic(**moduli, **ratios, frame=FLAT)
    (found,) = varied(SOUND, fields=(field("E_p"),), elastic=strata)
    assert found == (
        "here",
        "E_p of 'rock' varies from place to place, but E_n, G_np not, and it yields: its "
        "elasticity must vary as a whole",
        "Give E and nu and let E vary, or leave out 'yield' or what varies.",
    )
    (found,) = varied(SOUND, growths=(replace(growth, constant="G_np"),), elastic=strata)
    assert found[0] == "up"
    assert found[1].startswith("G_np of 'rock' varies from place to place, but E_p, E_n not, and ")


@pytest.mark.parametrize("angle", ["friction", "dilation"])
def test_angles_are_the_same_at_all_points(angle):
    (found,) = varied(mohr(1e6, 0.5, psi=0.1), fields=(field(angle, 0),))
    assert found == (
        "here",
        f"{angle} of 'rock' is an angle, which cannot be a field: it makes the shape of the yield "
        "surface, which is the same at all points of a material",
        "Let the cohesion vary, or give places of another angle a material of their own.",
    )


def test_strengths_vary_together():
    """All strengths of all surfaces but angles, numbers of zero and those without a dimension."""
    assert varied(SOUND, fields=(field("cohesion", 0),)) == []
    loose = mohr(1e6, 0.5, tension=0.0)
    assert varied(loose, fields=(field("cohesion", 0),)) == []
    none_yet = mohr(1e6, 0.5, tension=Scalar(0.0, "T"))
    told = "cohesion of 'rock' varies from place to place, but tension of its surface 1 does not: "
    told += "a yield surface can grow and shrink from place to place, but not change its shape"
    ground = replace(yielding(none_yet), fields=(field("cohesion", 0),))
    (fault,) = yield_faults(
        make_case(
            SECTION, materials={"rock": ground}, in_situ=IN_SITU,
            parameters=(parameter("T", 1e5, 0.0, 1e6),),
        )
    )  # fmt: skip
    assert fault.message == told
    assert fault.hint == "Leave out tension, or give cohesion without a field."
    cut = mohr(1e6, 0.5, tension=1e5)
    ((path, message, _),) = varied(cut, fields=(field("cohesion", 0, path="there"),))
    assert (path, message) == ("there", told)
    ((_, message, hint),) = varied(cut, fields=(field("tension", 0),))
    assert message.startswith("tension of 'rock' varies from place to place, but cohesion of its ")
    assert hint == "Leave out cohesion, or give tension without a field."
    (_, both) = (found[1] for found in varied(cut, SMALL, fields=(field("cohesion", 0),))[:2])
    assert "but the plane 'first', the plane 'second' of its surface 2 do not: a yield" in both
    assert varied(hoek(1e7, mb=1.0, s=0.1, a=0.5), fields=(field("sigci", 0),)) == []


def test_what_hardens_varies_nowhere():
    hard = (
        "here",
        "'rock' hardens, and E varies from place to place",
        "Leave out the hardening, or let nothing vary: the hardening would have to as well.",
    )
    assert varied(SMALL, fields=(field("E"),)) == [hard]
    assert varied(replace(SMALL, hardening=Scalar(0.0)), fields=(field("E"),)) == []
    assert varied(SOUND, SMALL, fields=(field("E"),)) == [hard]
    assert varied(SMALL) == []


def test_cut_offs_without_effect_are_told_in_megapascal():
    apex = 1e6 / tan(0.5)
    surface = mohr(1e6, 0.5, tension=apex)
    _, note = yield_notes(case_of(surface))
    assert note == (
        "the tension of 'rock' is not less than c / tan(phi), at the start 1.83 MPa: its cut-off "
        "has no effect"
    )
    assert len(yield_notes(case_of(replace(surface, tension=Scalar(apex * (1 - 1e-9)))))) == 1
    curved = hoek(1e7, mb=2.0, s=0.1, a=0.5, tension=0.6e6)
    assert yield_notes(case_of(curved))[1].startswith(
        "the tension of 'rock' is not less than s sigci / mb, at the start 0.5 MPa"
    )


def test_planes_are_counted():
    one = GivenPlanes(SMALL.planes[:1])
    assert yield_notes(case_of(one)) == [
        "'rock' yields by given planes: 1 plane, with associated flow"
    ]
    (note,) = yield_notes(case_of(SMALL))
    assert note == "'rock' yields by given planes: 2 planes, with associated flow"
    below = GivenPlanes((replace(SMALL.planes[0], distance=Scalar(-1.0)), SMALL.planes[1]))
    assert yield_notes(case_of(below))[1] == (
        "'rock' cannot be free of stress: a distance is negative"
    )


def test_oblique_planes_are_told_word_by_word():
    weak = WeakPlane(Attitude(Scalar(0.5), Scalar(pi / 3)), Scalar(1e6), Scalar(0.5))
    (fault,) = yield_faults(case_of(SOUND, weak))
    assert (fault.code, fault.path) == ("antiplane", "materials.rock.yield")
    assert fault.message == (
        "the weak planes of 'rock' are oblique to the section, or may turn so in the fit, so the "
        "ground would also slide out of the plane"
    )
    assert fault.hint == "Use analysis: solid, or give a strike normal to the section."
    assert yield_faults(case_of(weak, analysis=Analysis.SOLID)) == []
    dips = WeakPlane(Attitude(Scalar(0.5), Scalar(pi / 2)), Scalar(1e6), Scalar(0.5))
    (fault,) = yield_faults(case_of(dips, analysis=Analysis.AXISYMMETRIC))
    assert fault.message == "weak planes of 'rock' that dip are not the same all around the axis"
    assert fault.hint == "Use 'dip: 0 deg', or analysis: solid."
    for dip in (0.0, pi / 2):
        lies = replace(dips, frame=Attitude(Scalar(dip), Scalar(pi / 2)))
        assert yield_faults(case_of(lies, analysis=Analysis.AXISYMMETRIC)) == []
    # a strike that may turn in the fit
    turns = WeakPlane(Attitude(Scalar(0.5), Scalar(1.0, "d")), Scalar(1e6), Scalar(0.5))
    bounds = (Parameter("d", pi / 2, 1.0, 2.0, dimension="angle", unit="deg"),)
    (fault,) = yield_faults(case_of(turns, parameters=bounds))
    assert fault.code == "antiplane"


def test_a_surface_of_a_list_is_named_by_its_place():
    """Keys of the file say whether surfaces are written as a list."""
    weak = WeakPlane(Attitude(Scalar(0.5), Scalar(pi / 3)), Scalar(1e6), Scalar(0.5))
    case = case_of(SOUND, weak)
    key = ("materials", "rock", "yield", 1, "cohesion")
    source = replace(case.source, positions={key: (7, 3)})
    (fault,) = yield_faults(replace(case, source=source))
    assert fault.path == "materials.rock.yield[1]"


def test_planes_that_leave_no_stress_are_told_with_a_remedy():
    bounds = (parameter("k", -2e6, -3e6, 2e6), parameter("q", 1e6, 1e6, 2e6))
    surface = facing(tied("k"), tied("q"))
    (fault,) = yield_faults(case_of(surface, parameters=bounds))
    assert fault.path == "materials.rock.yield.planes"
    said = "no stress satisfies the yield planes 'right' and 'left' of rock together"
    assert fault.message == f"{said} at the start of the parameters"
    assert fault.hint == (
        "Enlarge a distance: planes that face each other need a positive sum of distances."
    )
    # with k + q at most -1e5, or just above zero
    for most, nowhere in ((-2.1e6, True), (-2e6 + 1.0, False)):
        within = (parameter("k", -2.5e6, -3e6, most), bounds[1])
        (fault,) = yield_faults(case_of(surface, parameters=within))
        assert fault.message.startswith(said)
        assert fault.message.endswith("within their bounds") == nowhere
        if nowhere:
            assert fault.message == f"{said}, wherever the parameters are within their bounds"
            assert fault.hint == (
                "Turn a normal round, or change the bounds: planes that face each other need a "
                "positive sum of distances."
            )


def test_the_lower_bounds_count_where_a_distance_falls_with_a_parameter():
    """-k and q: with k down to 1e6 and q up to 0.9e6 nothing is left, with k down to 0.8e6 some."""
    surface = facing(Scalar(-1.0, "k"), Scalar(1.0, "q"))
    for least, nowhere in ((1e6, True), (0.8e6, False)):
        bounds = (parameter("k", 2e6, least, 3e6), parameter("q", 0.5e6, 0.1e6, 0.9e6))
        (fault,) = yield_faults(case_of(surface, parameters=bounds))
        assert ("wherever" in fault.message) == nowhere


def test_ground_that_begins_outside_its_surface_is_told():
    below = facing(Scalar(-1e6), Scalar(2e6))
    stages = (Stage("dig"), Stage("fill", install={"a": "rock"}))
    (fault,) = yield_faults(case_of(below, stages=stages, groups={"b": "rock"}))
    assert (fault.code, fault.path) == ("outside-at-zero", "materials.rock.yield")
    assert fault.message == (
        "'rock' is installed free of stress at stage 'fill', which is outside its yield surface"
    )
    assert fault.hint == "Make all its distances positive at the start of the parameters."
    (fault,) = yield_faults(case_of(below, in_situ=None, groups={"a": "rock"}))
    assert fault.message == "'rock' begins free of stress, which is outside its yield surface"
    assert yield_faults(case_of(below, in_situ=None, groups={"a": "other"})) == []
    zones = {"in_situ": None, "in_situ_of": {"a": IN_SITU}, "groups": {"a": "rock"}}
    assert yield_faults(case_of(below, **zones)) == []
    on_it = facing(Scalar(0.0), Scalar(2e6))
    assert yield_faults(case_of(on_it, in_situ=None, groups={"a": "rock"})) == []
    assert len(yield_notes(case_of(on_it))) == 1
