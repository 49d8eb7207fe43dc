"""The analysis through the stages: what construction must and must not do, and derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, imbalance, material, model, rollers
from support.derivatives import assert_slopes
from support.meshes import box, regroup

from geoident.errors import ModelError
from geoident.model.actions import Pressure, Traction
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.parameter import Parameter, Scalar

ROCK = material("rock", 8e9, 0.3, 2600.0)
STRESS = ConstantStress((*(Scalar(v) for v in (-9e6, -6e6, -7e6, 0.5e6)), Scalar(0.0), Scalar(0.0)))


def square(kind="quad8", n=8):
    """A square of 8 m with five blocks to excavate in its middle."""
    mesh = box(kind, (n, n), size=(8.0, 8.0), distortion=0.1)

    def slab(k):
        return lambda c: (abs(c[:, 0] - 4) < 1) & (c[:, 1] > 1.5 + k) & (c[:, 1] < 2.5 + k)

    return regroup(mesh, **{f"b{k}": slab(k) for k in range(5)})


BLOCKS = tuple(f"b{k}" for k in range(5))


def fields(mesh, **changes):
    return model(mesh, **changes).survey(np.empty(0), fields=True).fields


def test_one_stage_or_five_end_in_the_same_state():
    common = {
        "materials": {"rock": ROCK},
        "groups": dict.fromkeys(("rock", *BLOCKS), "rock"),
        "supports": rollers(2),
        "in_situ": STRESS,
        "gravity": (0.0, -9.81),
    }
    mesh = square()
    one = fields(mesh, stages=(Stage("all", excavate=BLOCKS),), **common)
    five = fields(mesh, stages=tuple(Stage(b, excavate=(b,)) for b in BLOCKS[::-1]), **common)
    present = one.present[-1]
    scale = np.abs(one.displacement[-1]).max()
    np.testing.assert_allclose(five.displacement[-1], one.displacement[-1], atol=1e-10 * scale)
    np.testing.assert_allclose(
        five.stress[-1][present],
        one.stress[-1][present],
        atol=1e-10 * np.nanmax(np.abs(one.stress)),
    )


def test_replacing_rock_by_the_same_rock_leaves_only_its_released_stress():
    """Install in place: what enters bears no stress, as if excavated and filled at once."""
    common = {
        "materials": {"rock": ROCK},
        "groups": dict.fromkeys(("rock", *BLOCKS), "rock"),
        "supports": rollers(2),
        "in_situ": STRESS,
    }
    mesh = square()
    result = fields(mesh, stages=(Stage("swap", install={"b2": "rock"}),), **common)
    assert np.abs(result.displacement[-1]).max() > 0
    inside = mesh.groups["b2"]
    virgin, after = result.stress[0][inside], result.stress[-1][inside]
    assert np.all(np.abs(after[:, 1]) < np.abs(virgin[:, 1]))


def test_changing_the_material_keeps_its_stress_and_moves_nothing():
    common = {
        "materials": {"rock": ROCK, "soft": material("soft", 1e9, 0.2, 2600.0)},
        "groups": dict.fromkeys(("rock", *BLOCKS), "rock"),
        "supports": rollers(2),
        "in_situ": STRESS,
    }
    result = fields(square(), stages=(Stage("soften", change={"b2": "soft"}),), **common)
    assert np.abs(result.displacement[-1]).max() < 1e-15
    np.testing.assert_allclose(result.stress[1], result.stress[0], rtol=1e-12)


def test_balanced_in_situ_stress_needs_no_solve_and_moves_nothing():
    staged = model(
        square(),
        materials={"rock": ROCK},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=rollers(2),
        in_situ=STRESS,
        stages=(Stage("nothing"),),
    )
    survey = staged.survey(np.empty(0), fields=True)
    assert staged.counts.factorizations == 1
    assert np.abs(survey.fields.displacement).max() < 1e-16
    np.testing.assert_allclose(survey.fields.stress[-1][:, 0], -9e6, rtol=1e-12)


def test_heim_stress_growing_with_depth_balances_gravity():
    weight, K0 = 2600.0 * 9.81, 0.3 / 0.7
    staged = model(
        square(),
        materials={"rock": ROCK},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=(*rollers(2), Support("x1", (0,))),
        in_situ=HeimStress(K0=Scalar(K0), unit_weight=Scalar(weight), surface=Scalar(8.0)),
        gravity=(0.0, -9.81),
        stages=(Stage("nothing"),),
    )
    survey = staged.survey(np.empty(0), fields=True)
    assert imbalance(staged) < 1e-12
    assert np.abs(survey.fields.displacement).max() < 1e-16


def test_unbalanced_in_situ_stress_is_brought_to_equilibrium_and_said():
    staged = model(
        square(),
        materials={"rock": ROCK},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=(*rollers(2), Support("x1", (0,))),
        gravity=(0.0, -9.81),
        stages=(Stage("nothing"),),
    )
    survey = staged.survey(np.empty(0), fields=True)
    assert any("out of balance" in note for note in survey.notes)
    assert np.abs(survey.fields.displacement).max() < 1e-12
    # Now the ground bears its weight: at mid-height 4 m of it.
    centres = np.array([staged.mesh.points[b].mean(0) for b in staged.mesh.blocks[0].nodes[:, :4]])
    mid = np.abs(centres[:, 1] - 3.5) < 0.3
    vertical = survey.fields.stress[-1][mid, 1]
    np.testing.assert_allclose(vertical.mean(), -2600 * 9.81 * 4.5, rtol=0.02)


def test_pressure_and_traction_compress_a_bar():
    """A bar of 8 m under 2 MPa from above, free to the sides: s = q (1 - nu^2) h / E."""
    for load in (
        Pressure("y1", Scalar(2e6)),
        Traction("y1", (Scalar(0.0), Scalar(-2e6))),
    ):
        result = fields(
            square(),
            materials={"rock": ROCK},
            groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
            supports=rollers(2),
            stages=(Stage("load", loads={"q": load}), Stage("unload", remove=("q",))),
        )
        top = np.isclose(result.mesh.points[:, 1], 8.0)
        expected = -2e6 * 8 * (1 - 0.3**2) / 8e9
        np.testing.assert_allclose(result.displacement[1][top, 1], expected, rtol=1e-10)
        np.testing.assert_allclose(result.displacement[2], 0.0, atol=1e-15)


def test_backfill_counts_its_displacement_from_its_placing():
    """Nodes that went and came again start from zero."""
    result = fields(
        square(),
        materials={"rock": ROCK},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=rollers(2),
        in_situ=STRESS,
        stages=(Stage("out", excavate=BLOCKS), Stage("in", install=dict.fromkeys(BLOCKS, "rock"))),
    )
    mesh = result.mesh
    inner = np.setdiff1d(
        np.unique(mesh.blocks[0].nodes[mesh.groups["b2"]]),
        np.unique(mesh.blocks[0].nodes[mesh.groups["rock"]]),
    )
    assert len(inner)
    assert np.abs(result.displacement[2][inner]).max() < 1e-15


# Derivatives ------------------------------------------------------------------------------------

PARAMETERS = {
    "E": 8e9, "nu": 0.27, "K": 5e9, "G": 3e9, "density": 2500.0, "sv": 7e6, "K0": 1.4,
    "gamma": 26e3, "xx": -5e6, "xy": 0.6e6, "q": 1.5e6, "t": -0.7e6,
}  # fmt: skip


def _everything(in_situ, **more):
    """A case in which every kind of parameter acts, over lifts, lining, backfill and loads."""
    mesh = square("tri6")
    names = tuple(
        dict.fromkeys((*_parameters_of(in_situ), "E", "nu", "K", "G", "density", "q", "t"))
    )
    rock = material("rock", Scalar(1.0, "E"), Scalar(1.0, "nu"), Scalar(1.0, "density"))
    fill = Material(
        "fill", Isotropic(K=Scalar(1.0, "K"), G=Scalar(1.0, "G")), Scalar(0.8, "density")
    )
    shot = material("shot", Scalar(1.8, "E"), 0.2, 2400.0)
    channels = tuple(
        displacement(f"c{k}", point, (0.6, 0.8), zero=zero)
        for k, (point, zero) in enumerate(
            [((1.0, 5.0), "virgin"), ((6.5, 3.1), "s1"), ((4.0, 7.0), "s3"), ((4.0, 2.0), "s4")]
        )
    )
    return model(
        mesh,
        parameters=tuple(
            Parameter(n, PARAMETERS[n], -np.inf, np.inf, "linear") for n in names
        ),
        materials={"rock": rock, "fill": fill, "shot": shot},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=(*rollers(2), Support("x1", (0,))),
        in_situ=in_situ,
        gravity=(0.3, -9.81),
        loads={"dead": Pressure("y1", Scalar(0.2, "q"))},
        stages=(
            Stage("s1", excavate=("b4", "b3")),
            Stage("s2", excavate=("b2",), loads={"q": Pressure("y1", Scalar(1.0, "q"))}),
            Stage("s3", excavate=("b1", "b0"), install={"b4": "shot"}),
            Stage("s4", install={"b0": "fill", "b1": "fill"}, remove=("q",)),
            Stage("s5", change={"b0": "shot"}, loads={
                "t": Traction("y1", (Scalar(1.0, "t"), Scalar(-1e5)))}),
        ),
        channels=channels,
        **more,
    )  # fmt: skip


def _parameters_of(in_situ):
    if isinstance(in_situ, ConstantStress):
        scalars = in_situ.components
    else:
        scalars = (in_situ.K0, in_situ.vertical, in_situ.unit_weight)
    return tuple(s.parameter for s in scalars if s is not None and s.parameter)


IN_SITU = {
    "constant": ConstantStress(
        (
            Scalar(1.0, "xx"),
            Scalar(-6e6),
            Scalar(0.9, "xx"),
            Scalar(1.0, "xy"),
            Scalar(0.0),
            Scalar(0.0),
        )
    ),
    "heim": HeimStress(K0=Scalar(1.0, "K0"), vertical=Scalar(1.0, "sv")),
    "heim-depth": HeimStress(
        K0=Scalar(1.0, "K0"), unit_weight=Scalar(1.0, "gamma"), surface=Scalar(50.0)
    ),
    "heim-free": HeimStress(
        K0=Scalar(1.0, "K0"), unit_weight=Scalar(1.0, "gamma"), surface=Scalar(9.0), held=False
    ),
}
PAIRS = (
    *((c, s) for c, first in (("c0", 1), ("c1", 2), ("c2", 4), ("c3", 5))
      for s in [f"s{n}" for n in range(first, 6)]),
)  # fmt: skip


@pytest.mark.parametrize("kind", IN_SITU)
def test_jacobian_agrees_with_richardson_differences(kind):
    staged = _everything(IN_SITU[kind])
    response = staged.response(PAIRS)
    p = np.array([PARAMETERS[n] for n in staged.names])
    v, jacobian = response.evaluate(p)
    np.testing.assert_allclose(response.readings(p), v, rtol=1e-12)
    for name, column in zip(staged.names, jacobian.T, strict=True):
        assert column.any(), f"{name} acts on nothing in this test"
    assert_slopes(response.readings, p, jacobian, staged.names, step=2e-3)


def test_march_ends_with_the_last_stage_that_is_read():
    staged = _everything(IN_SITU["heim"])
    response = staged.response([("c0", "s2")])
    p = np.array([PARAMETERS[n] for n in staged.names])
    before = staged.counts.factorizations
    response.readings(p)
    assert staged.counts.factorizations - before == 3


def test_a_gauge_that_is_zeroed_after_the_last_stage_that_is_read_is_no_hindrance():
    early, late = (displacement(name, (1.0, 1.0), (1.0, 0.0)) for name in ("early", "late"))
    staged = model(
        square(),
        materials={"rock": ROCK},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=rollers(2),
        in_situ=STRESS,
        channels=(early, replace(late, zero="b1")),
        stages=tuple(Stage(b, excavate=(b,)) for b in BLOCKS[::-1]),
    )
    pairs = [("early", BLOCKS[4]), ("late", BLOCKS[0])]
    both = staged.response(pairs).readings(np.empty(0))
    np.testing.assert_allclose(staged.response(pairs[:1]).readings(np.empty(0)), both[:1])


# Condensation's run ----------------------------------------------------------------------------


def _lined():
    mesh = square("quad4", 16)
    moduli = {"K": 5e9, "G": 3e9, "xx": -5e6, "xy": 0.6e6}
    rock = Material("rock", Isotropic(K=Scalar(1.0, "K"), G=Scalar(1.0, "G")))
    return model(
        mesh,
        parameters=tuple(Parameter(n, v, -np.inf, np.inf, "linear") for n, v in moduli.items()),
        materials={"rock": rock, "shot": material("shot", 15e9, 0.2)},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=rollers(2),
        in_situ=IN_SITU["constant"],
        stages=(
            Stage("s1", excavate=("b4", "b3")),
            Stage("s2", excavate=("b2",), install={"b4": "shot"}),
            Stage("s3", excavate=("b1",)),
        ),
        channels=tuple(
            displacement(f"c{k}", (x, y), (0.6, 0.8), zero=zero)
            for k, (x, y, zero) in enumerate(
                [(1.0, 5.0, "virgin"), (6.5, 3.1, "s1"), (4.0, 7.0, "virgin"), (7.0, 7.5, "s2")]
            )
        ),
    )


def test_condensed_equations_vanish_at_the_truth_for_exact_readings():
    """Whatever the current parameters: the readings hold, so the truth leaves no equation error."""
    staged = _lined()
    pairs = [("c0", "s1"), ("c0", "s3"), ("c1", "s2"), ("c2", "s2"), ("c2", "s3"), ("c3", "s3")]
    response = staged.response(pairs)
    truth = np.array([5e9, 3e9, -5e6, 0.6e6])
    measured = response.readings(truth)
    p = truth * [1.02, 0.98, 1.01, 1.03]
    condensed = response.condense(p, measured, np.full(len(pairs), 1e-4))
    at_p = condensed.matrix @ p - condensed.vector
    np.testing.assert_allclose(at_p, measured - response.readings(p), rtol=1e-9, atol=1e-14)
    # Second order in the distance of p: the corrected displacements are exact only at the gauges.
    at_truth = condensed.matrix @ truth - condensed.vector
    assert np.abs(at_truth).max() < 0.05 * np.abs(at_p).max()


def test_flexibility_is_the_response_to_unit_forces():
    staged = _lined()
    pairs = [("c0", "s1"), ("c0", "s3"), ("c2", "s1")]
    response = staged.response(pairs)
    truth = np.array([5e9, 3e9, -5e6, 0.6e6])
    condensed = response.condense(truth, response.readings(truth) + 1e-4, np.full(3, 1e-4))
    S = condensed.flexibility
    first = S[np.ix_([0, 2], [0, 2])]  # within one stage the operator is symmetric
    np.testing.assert_allclose(first, first.T, rtol=1e-10)
    assert np.all(np.linalg.eigvalsh(first) > 0)


def test_obstacle_names_what_is_not_affine():
    assert "nu of rock" in _everything(IN_SITU["heim"]).response(PAIRS).obstacle()
    assert _lined().response([("c0", "s1")]).obstacle() is None
    staged = model(
        square(),
        parameters=(Parameter("sv", 7e6, 0, 1e8), Parameter("K0", 1.0, 0, 5)),
        materials={"rock": ROCK},
        groups=dict.fromkeys(("rock", *BLOCKS), "rock"),
        supports=rollers(2),
        in_situ=IN_SITU["heim"],
        stages=(Stage("s1", excavate=BLOCKS),),
        channels=(displacement("c", (1.0, 5.0), (1.0, 0.0)),),
    )
    assert "product of sv and K0" in staged.response([("c", "s1")]).obstacle()


@pytest.mark.parametrize("block", [0, 3])
def test_a_stiffness_that_is_not_positive_definite_is_told_with_its_place(block):
    """Where a modulus is negative; nodes of the block are within its metre."""
    group = f"b{block}"
    soft = Material("soft", Isotropic(E=Scalar(1.0, "E"), nu=Scalar(0.3)), Scalar(0.0))
    staged = model(
        square(),
        parameters=(Parameter("E", 8e9, 1e6, 1e11),),
        materials={"rock": ROCK, "soft": soft},
        groups={**dict.fromkeys(("rock", *BLOCKS), "rock"), group: "soft"},
        supports=rollers(2),
        in_situ=STRESS,
        stages=(Stage("dig", excavate=(BLOCKS[4],)),),
    )
    with pytest.raises(ModelError, match="not positive definite near") as caught:
        staged.survey(np.array([-8e9]), fields=False)
    remedy = "look there for elements without stiffness, or held by next to nothing"
    assert caught.value.hint == remedy
    x, y = map(float, str(caught.value).split("near (")[1].split(") m")[0].split(","))
    assert abs(x - 4) < 1.3
    assert 1.2 + block < y < 2.8 + block
