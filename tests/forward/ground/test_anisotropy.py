"""Anisotropic ground in the analysis: turning everything turns the answer; exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.anisotropy import (
    ATTITUDE,
    LOVE,
    ORTHOTROPIC,
    STRATA,
    attitude,
    every_symmetry,
    general,
    in_plane,
    random_definite,
    random_rotation,
    scalars,
    ties,
    turn_matrix,
    turn_tensor,
)
from support.cases import displacement, make_case, model, moduli_at, rollers
from support.derivatives import assert_slopes
from support.meshes import box, regroup

from geoident.forward.affine import first_obstacle, stiffness_part
from geoident.forward.ground.checks import section_faults
from geoident.forward.ground.elasticity import inadmissible
from geoident.model.case import Analysis, Material, Stage, Support
from geoident.model.ground import (
    Anisotropic,
    Attitude,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    elastic_scalars,
)
from geoident.model.in_situ import ConstantStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

STRESS = np.array([-9e6, -6e6, -7e6, 1.2e6, 0.8e6, -0.5e6])
PLANE_STRESS = STRESS * [1, 1, 1, 1, 0, 0]


def excavated(mesh: Mesh, elastic, stress):
    """Displacements and stresses after opening the middle of a block whose outside is held."""
    dim = mesh.dim
    staged = model(
        mesh,
        materials={"rock": Material("rock", elastic)},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("outer", tuple(range(dim))),),
        in_situ=ConstantStress(tuple(Scalar(float(s)) for s in stress)),
        stages=(Stage("open", excavate=("core",)),),
    )
    fields = staged.survey(np.empty(0), fields=True).fields
    return fields.displacement[-1], fields.stress[-1]


def block(kind: str) -> Mesh:
    dim = 3 if kind in {"tet4", "hex8", "tet10"} else 2
    mesh = box(kind, (4,) * dim, distortion=0.15)
    return regroup(mesh, core=lambda c: np.all(np.abs(c - 0.5) < 0.3, axis=1))


@pytest.mark.parametrize("kind", ["tet4", "hex8", "tri6", "quad4"])
@pytest.mark.parametrize("symmetry", every_symmetry(np.eye(3)))
def test_turning_mesh_material_and_stress_turns_the_answer(kind, symmetry):
    mesh = block(kind)
    rng = np.random.default_rng(11)
    solid = mesh.dim == 3
    # A section keeps the plane of symmetry that every one of these materials has there.
    R0, stress = (random_rotation(rng), STRESS) if solid else (in_plane(0.4), PLANE_STRESS)
    rotations = [random_rotation(rng) if solid else in_plane(a) for a in rng.uniform(0, 6, 2)]
    u, sigma = excavated(mesh, _in_section(every_symmetry(R0)[symmetry], solid), stress)
    for R in rotations:
        turned = replace(mesh, points=mesh.points @ R[: mesh.dim, : mesh.dim].T)
        material = _in_section(every_symmetry(R @ R0)[symmetry], solid, R @ R0)
        v, tau = excavated(turned, material, turn_tensor(stress, R))
        expected = u @ R[: mesh.dim, : mesh.dim].T
        np.testing.assert_allclose(v, expected, atol=1e-11 * np.abs(u).max())
        there = np.isfinite(sigma[:, 0])
        full = np.zeros((there.sum(), 6))
        full[:, : sigma.shape[1]] = sigma[there]
        np.testing.assert_allclose(
            tau[there], turn_tensor(full, R)[:, : sigma.shape[1]], atol=1e-11 * 9e6
        )


def _in_section(elastic, solid: bool, R: np.ndarray | None = None):
    """General entries without coupling to shear out of the plane, turned in it."""
    if solid or not isinstance(elastic, Anisotropic):
        return elastic
    E = random_definite(np.random.default_rng(3))
    E[:4, 4:] = E[4:, :4] = 0.0
    return general(turn_matrix(E, in_plane(0.4) if R is None else R))


@pytest.mark.parametrize("kind", ["tet10", "quad4"])
def test_entries_filled_with_isotropic_numbers_give_the_isotropic_answer(kind):
    mesh = block(kind)
    iso = Isotropic(E=Scalar(10e9), nu=Scalar(0.27))
    stress = STRESS if mesh.dim == 3 else PLANE_STRESS
    same = general(moduli_at(Material("rock", iso), {}, 6))
    u, sigma = excavated(mesh, iso, stress)
    v, tau = excavated(mesh, same, stress)
    np.testing.assert_allclose(v, u, atol=1e-12 * np.abs(u).max())
    np.testing.assert_allclose(tau, sigma, atol=1e-12 * np.nanmax(np.abs(sigma)))


# Derivatives -------------------------------------------------------------------------------------

_E = random_definite(np.random.default_rng(5))
ENTRIES = {f"c{i + 1}{j + 1}": float(_E[i, j]) for i in range(6) for j in range(i, 6)}
STARTS = {**STRATA, **LOVE, **ORTHOTROPIC, **ATTITUDE, **ENTRIES}
ANGLES = Attitude(**ties(ATTITUDE))
PLANE_ENTRIES = {n: v for n, v in ENTRIES.items() if int(n[2]) < 5}
SOLID_KINDS = {
    "strata": TransverselyIsotropic(**ties(STRATA), frame=ANGLES),
    "love": LoveModuli(**ties(LOVE), frame=ANGLES),
    "orthotropic": Orthotropic(**ties(ORTHOTROPIC), frame=ANGLES),
    "anisotropic": Anisotropic(ties(ENTRIES)),
    # One modulus and one angle behind several numbers; the fill shares the modulus.
    "tied": TransverselyIsotropic(
        E_p=Scalar(1.0, "E_p"),
        nu_p=Scalar(0.2),
        E_n=Scalar(0.4, "E_p"),
        nu_np=Scalar(0.15),
        G_np=Scalar(0.2, "E_p"),
        frame=Attitude(Scalar(1.0, "dip"), Scalar(2.5, "dip")),
    ),
}
IN_PLANE = Attitude(Scalar(1.0, "dip"), Scalar(np.pi / 2))
PLANE_KINDS = {
    "strata": TransverselyIsotropic(**ties(STRATA), frame=IN_PLANE),
    "love": LoveModuli(**ties(LOVE), frame=IN_PLANE),
    "orthotropic": Orthotropic(**ties(ORTHOTROPIC), frame=IN_PLANE),
    "anisotropic": Anisotropic(ties(PLANE_ENTRIES)),
}
NO_EFFECT = {
    ("strata", 3): {"rotation"},  # about the axis of symmetry
    ("love", 3): {"rotation"},
    # Nothing strains along z, and nothing shears against it.
    ("love", 2): {"N"},
    ("anisotropic", 2): {"c13", "c23", "c33", "c34"},
    ("orthotropic", 2): {"G_12", "G_23"},
}


def staged_in(elastic, dim: int):
    """Two stages: an opening, and its fill; gauges near a corner of the block."""
    mesh = block("hex8" if dim == 3 else "tri6")
    mesh = regroup(
        mesh,
        upper=lambda c: np.all(np.abs(c - 0.5) < 0.3, axis=1) & (c[:, -1] > 0.5),
        lower=lambda c: np.all(np.abs(c - 0.5) < 0.3, axis=1),
    )
    names = sorted({s.parameter for s in elastic_scalars(elastic).values() if s.parameter})
    rng = np.random.default_rng(2)
    fill = Scalar(0.25, "E_p") if "E_p" in names else Scalar(5e9)
    channels = tuple(
        displacement(f"c{k}", tuple(rng.uniform(0.0, 0.2, dim)), tuple(rng.normal(size=dim)))
        for k in range(4)
    )
    return model(
        mesh,
        parameters=tuple(
            Parameter(
                n, STARTS[n], -np.inf, np.inf, dimension="angle" if n in ATTITUDE else "pressure"
            )
            for n in names
        ),
        materials={
            "rock": Material("rock", elastic),
            "fill": Material("fill", Isotropic(E=fill, nu=Scalar(0.2))),
        },
        groups=dict.fromkeys(("rock", "upper", "lower"), "rock"),
        supports=rollers(dim),
        in_situ=ConstantStress(
            tuple(Scalar(float(s)) for s in (STRESS if dim == 3 else PLANE_STRESS))
        ),
        stages=(
            Stage("s1", excavate=("upper",)),
            Stage("s2", excavate=("lower",), install={"upper": "fill"}),
        ),
        channels=channels,
    )


@pytest.mark.parametrize(
    ("name", "dim"), [*((n, 3) for n in SOLID_KINDS), *((n, 2) for n in PLANE_KINDS)]
)
def test_jacobian_agrees_with_richardson_differences(name, dim):
    staged = staged_in((SOLID_KINDS if dim == 3 else PLANE_KINDS)[name], dim)
    response = staged.response([(f"c{k}", s) for k in range(4) for s in ("s1", "s2")])
    p = np.array([STARTS[n] for n in staged.names])
    _, jacobian = response.evaluate(p)
    scale_of_all = np.abs(jacobian * p).max()
    scale = np.abs(jacobian * p).max(axis=0)
    idle = np.isin(staged.names, list(NO_EFFECT.get((name, dim), ())))
    assert np.all(scale[idle] < 1e-10 * scale_of_all)
    assert np.all(scale[~idle] > 1e-6 * scale_of_all), "a parameter acts on nothing here"

    def readings(some):
        """With the parameters that act."""
        full = p.copy()
        full[~idle] = some
        return response.readings(full)

    names = [n for n, out in zip(staged.names, idle, strict=True) if not out]
    assert_slopes(readings, p[~idle], jacobian[:, ~idle], names, step=2e-3)


# What may be a parameter of what -------------------------------------------------------------


def law_at(elastic, p: dict[str, float]) -> np.ndarray:
    return moduli_at(Material("rock", elastic), p, 6)


PROPORTIONAL = {
    "E_p": Scalar(2.0, "E"), "nu_p": Scalar(0.2), "E_n": Scalar(1.0, "E"),
    "nu_np": Scalar(0.15), "G_np": Scalar(0.4, "E"),
}  # fmt: skip
AFFINE = {
    "love": LoveModuli(**ties(LOVE), frame=attitude(0.5, 1.1)),
    "entries": Anisotropic(ties(ENTRIES)),
    "proportional": TransverselyIsotropic(**PROPORTIONAL, frame=attitude(0.5, 1.1)),
    "shear only": TransverselyIsotropic(
        **{**scalars(STRATA), "G_np": Scalar(1.0, "G_np")}, frame=attitude(0.5)
    ),
    "shear beside": TransverselyIsotropic(
        **{**PROPORTIONAL, "G_np": Scalar(1.0, "G_np")}, frame=attitude(0.5)
    ),
    "bulk": Isotropic(K=Scalar(1.0, "E_1"), G=Scalar(1.0, "G_12")),
}
_RATIOS = {n: v for n, v in ORTHOTROPIC.items() if n.startswith("nu")}
NOT_AFFINE = {
    "dip": LoveModuli(**scalars(LOVE), frame=Attitude(Scalar(1.0, "dip"), Scalar(0.3))),
    "nu_np": TransverselyIsotropic(
        **{**scalars(STRATA), "nu_np": Scalar(1.0, "nu_np")}, frame=attitude(0.5)
    ),
    "E_n": TransverselyIsotropic(
        **{**scalars(STRATA), "E_n": Scalar(1.0, "E_n")}, frame=attitude(0.5)
    ),
    "E_1": Orthotropic(**{**ties(ORTHOTROPIC), **scalars(_RATIOS)}, frame=attitude(0.5)),
}  # fmt: skip


def _bend(elastic) -> float:
    """How far the law at a midpoint is from the mean of the laws at the ends."""
    names = {s.parameter for s in elastic_scalars(elastic).values() if s.parameter}
    starts = {**STARTS, "E": 10e9}
    one = {n: starts[n] for n in names}
    two = {n: v * (1.1 + 0.02 * k) for k, (n, v) in enumerate(sorted(one.items()))}
    middle = {n: (one[n] + two[n]) / 2 for n in names}
    mean = (law_at(elastic, one) + law_at(elastic, two)) / 2
    return np.abs(law_at(elastic, middle) - mean).max() / np.abs(mean).max()


def obstacle_of(elastic) -> str | None:
    """Why the stiffness is not affine in the parameters to which its numbers are tied."""
    starts = {**STARTS, "E": 10e9}
    names = dict.fromkeys(s.parameter for s in elastic_scalars(elastic).values() if s.parameter)
    parameters = tuple(Parameter(n, starts[n], starts[n] * 0.8, starts[n] * 1.2) for n in names)
    material = Material("rock", elastic)
    return first_obstacle([stiffness_part(material, section=False)], parameters)


@pytest.mark.parametrize("name", AFFINE)
def test_condensation_is_offered_where_the_moduli_are_affine(name):
    elastic = AFFINE[name]
    assert obstacle_of(elastic) is None
    assert _bend(elastic) < 1e-13


@pytest.mark.parametrize("name", NOT_AFFINE)
def test_condensation_is_refused_where_they_are_not(name):
    elastic = NOT_AFFINE[name]
    sentence = obstacle_of(elastic)
    assert sentence is not None
    assert sentence.startswith(f"{name} of rock enters the stiffness nonlinearly")
    assert _bend(elastic) > 1e-6


def test_inadmissible_names_the_bound():
    rock = Material("rock", TransverselyIsotropic(**ties(STRATA), frame=attitude(0.5)))
    assert inadmissible(rock, STRATA) is None
    sentence = inadmissible(rock, {**STRATA, "nu_np": 0.9})
    assert sentence == (
        "nu_np of rock is 0.9, with E_n/E_p = 0.4 and nu_p = 0.22 "
        "it must be between -0.395 and 0.395"
    )


# Sections ----------------------------------------------------------------------------------------


def faults_of(elastic, analysis=Analysis.PLANE_STRAIN, parameters=()):
    case = make_case(
        block("quad4"),
        materials={"rock": Material("rock", elastic)},
        analysis=analysis,
        parameters=parameters,
    )
    return [fault.message for fault in section_faults(case)]


@pytest.mark.parametrize("direction", [90, 270, 90.5, 0, 40])
def test_strata_oblique_to_a_section_are_refused(direction):
    rock = TransverselyIsotropic(**scalars(STRATA), frame=attitude(0.5, np.radians(direction)))
    found = faults_of(rock)
    if direction in {90, 270}:
        assert found == []
    else:
        assert len(found) == 1
        assert "out of the plane" in found[0]


def test_upright_strata_oblique_to_a_section_are_refused_though_they_shear_alike():
    """With G_np that of the strata they couple with the shear in plan alone."""
    alike = {**STRATA, "G_np": STRATA["E_p"] / (2 * (1 + STRATA["nu_p"]))}
    upright = TransverselyIsotropic(**scalars(alike), frame=attitude(np.pi / 2, np.radians(40)))
    assert len(faults_of(upright)) == 1


def test_strata_parallel_to_the_section_or_flat_are_accepted_whatever_their_direction():
    upright = TransverselyIsotropic(**scalars(STRATA), frame=attitude(np.pi / 2, 0.0))
    flat = TransverselyIsotropic(**scalars(STRATA), frame=attitude(0.0, 0.3))
    assert faults_of(upright) == faults_of(flat) == []


def test_an_angle_that_may_turn_the_strike_is_refused():
    free = Attitude(Scalar(0.5), Scalar(1.0, "dip_direction"))
    rock = TransverselyIsotropic(**scalars(STRATA), frame=free)
    parameter = Parameter("dip_direction", np.pi / 2, 0.0, 3.0, dimension="angle")
    assert len(faults_of(rock, parameters=(parameter,))) == 1


def test_entries_that_couple_with_shear_out_of_the_plane_are_refused():
    start = tuple(Parameter(n, v, 0.0, 1e12) for n, v in {**PLANE_ENTRIES, "c26": 0.0}.items())
    assert faults_of(Anisotropic(ties(PLANE_ENTRIES)), parameters=start) == []
    free = Anisotropic(ties({**PLANE_ENTRIES, "c26": 0.0}))
    assert "c26" in faults_of(free, parameters=start)[0]
    for entry in ("c15", "c16", "c25", "c26", "c45", "c46"):
        (message,) = faults_of(Anisotropic(scalars({**PLANE_ENTRIES, entry: 1e9})))
        assert message.startswith(f"{entry} of 'rock' couples")
    assert faults_of(Anisotropic(scalars({**PLANE_ENTRIES, "c35": 1e9}))) == []  # eps_zz = 0


def test_strata_that_dip_are_refused_around_an_axis():
    flat = TransverselyIsotropic(**scalars(STRATA), frame=attitude(0.0))
    inclined = TransverselyIsotropic(**scalars(STRATA), frame=attitude(0.3))
    assert faults_of(flat, Analysis.AXISYMMETRIC) == []
    assert "all around the axis" in faults_of(inclined, Analysis.AXISYMMETRIC)[0]


def test_materials_of_which_parameters_are_missing_are_passed_over():
    """In a case that is faulty otherwise, too; in space nothing has to stay in a plane."""
    oblique = TransverselyIsotropic(**ties(STRATA), frame=attitude(0.5, np.radians(40)))
    some = tuple(Parameter(n, v, 0.0, 1e12) for n, v in list(STRATA.items())[:-1])
    whole = tuple(Parameter(n, v, 0.0, 1e12) for n, v in STRATA.items())
    assert faults_of(oblique, parameters=some) == []
    assert len(faults_of(oblique, parameters=whole)) == 1
    assert faults_of(oblique, Analysis.SOLID, parameters=whole) == []
