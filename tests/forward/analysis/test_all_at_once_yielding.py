"""One small case in which all that an analysis of yielding ground knows acts together.

Its states are in equilibrium and admissible by sums of their own; its derivatives are differences;
what it reports of planes is counted anew.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.all_at_once import assert_slopes_in_sizes, compatibility, unbounded
from support.cases import displacement, model
from support.force_gauges import gauge
from support.meshes import box, regroup
from support.yielding import given, mohr, rock

from geoident.forward.analysis.analysis import RunOptions
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts

P = {
    "E": 5e7, "c": 2.5e4, "phi": 0.5, "k": 9e4, "h": 2e7, "sv": 1e5, "alpha": 2e-5, "move": 3e-3,
    "EA": 2e7,
}  # fmt: skip
HERE = np.array(list(P.values()))
NORMALS = np.array([[0.8, -0.6, 0, 0, 0, 0], [-0.7, 0.7, 0.1, 0, 0, 0], [0, 0, 0, 1.0, 0, 0],
                    [0, 0, 0, -1.0, 0, 0], [0.3, -1.0, 0.2, 0.3, 0, 0]])  # fmt: skip
STAGES = ("dig", "press", "move", "aside")


@pytest.fixture(scope="module")
def staged():
    """Hardening clay over sand with a cut-off over elastic ground, dug, loaded, moved."""
    mesh = regroup(
        box("quad4", (5, 5), size=(5.0, 5.0), distortion=0.1),
        dug=lambda c: (c[:, 0] < 1) & (abs(c[:, 1] - 3.5) < 0.4),
        clay=lambda c: c[:, 1] > 3,
        base=lambda c: c[:, 1] < 1,
    )
    clay = given(NORMALS, [Scalar(1.0, "k"), 8e4, Scalar(0.4, "k"), 4e4, Scalar(1.1, "k")],
                 Scalar(1.0, "h"))  # fmt: skip
    sand = mohr(Scalar(1.0, "c"), Scalar(1.0, "phi"), tension=Scalar(0.8, "c"))
    warm = {"clay": Scalar(15.0), "rock": Scalar(5.0)}
    return model(
        mesh,
        parameters=unbounded(P),
        materials={
            "clay": rock(Scalar(1.0, "E"), 0.3, clay, name="clay", expansion=Scalar(1.0, "alpha")),
            "sand": rock(Scalar(2.0, "E"), 0.25, sand, name="sand", expansion=1e-5),
            "base": rock(Scalar(9.0, "E"), 0.2, name="base"),
        },
        groups={"dug": "clay", "clay": "clay", "rock": "sand", "base": "base"},
        supports=(Support("x0", (0,)), Support("y0", (1,)), Support("x1", (0,))),
        in_situ=HeimStress(vertical=Scalar(1.0, "sv"), K0=Scalar(0.6)),
        structures={
            "plate": Beam("y1", EA=Scalar(1.0, "EA"), EI=Scalar(2e5)),
            "bolts": Bolts((((1.5, 3.5), (4.5, 2.2)),), Scalar(1.0), EA=Scalar(0.5, "EA")),
        },
        stages=(
            Stage("dig", excavate=("dug",), build=("bolts",)),
            Stage("press", build=("plate",), temperature=warm, loads={
                "q": Traction("y1", (Scalar(0.0), Scalar(-0.7, "sv")))}),
            Stage("move", dismantle=("bolts",),
                  supports={"x1": Support("x1", (0,), motions=((0, Scalar(-1.0, "move")),))}),
            Stage("aside", base="dig", loads={
                "q": Traction("y1", (Scalar(0.3, "sv"), Scalar(0.0)))}),
        ),
        channels=(
            displacement("top", (2.0, 5.0), (0.6, 0.8)),
            displacement("side", (1.0, 4.0), (1.0, 0.0), zero="dig"),
            gauge("stress", "xx", (2.5, 3.5), "xx", dimension="pressure"),
            gauge("stress", "yy", (3.5, 2.5), "yy", dimension="pressure"),
            gauge("load-cell", "bolt", (1.5, 3.5), "N", structure="bolts", dimension="force"),
        ),
    )  # fmt: skip


def copies(staged, p=HERE, **options):
    run = staged.at(p, RunOptions(**options))
    states = [(e.u.copy(), e.stress.copy(), e.members.copy(), e.yielded.copy(), e.forces.copy())
              for e in run.states()]  # fmt: skip
    return run, states


def test_states_are_in_equilibrium_and_admissible(staged):
    run, states = copies(staged)
    points, structures = staged.discretization.points, staged.analysis.systems.structures
    C = compatibility(staged)
    group = np.array(staged.sequence.groups)[staged.sequence.group_of[points.element]]
    planes = run.findings.plastic.planes.activity()
    units = NORMALS[:, :4] / np.linalg.norm(NORMALS, axis=1)[:, None]
    highest = np.full(5, -np.inf)
    for n, (_, stress, members, yielded, forces) in enumerate(states):
        system, sigma = staged.analysis.systems[n], stress[..., 0]
        inner = np.einsum("smd,sm,m->d", C, sigma, system.volume)
        inner = inner + structures.nodal_forces(members[:, :1])[:, 0]
        rest = (forces[:, 0] - inner)[system.dofs]
        assert np.abs(rest).max() < 1e-7 * np.abs(inner).max()
        assert not sigma[:, ~system.present].any()
        sand = system.present & (group == "rock")
        tensor = np.zeros((sand.sum(), 3, 3))
        for c, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1))):
            tensor[:, i, j] = tensor[:, j, i] = sigma[c, sand]
        low, _, high = np.linalg.eigvalsh(tensor).T
        S = np.sin(P["phi"])
        excess = (1 + S) * high - (1 - S) * low - 2 * P["c"] * np.cos(P["phi"])
        assert excess.max() < 0.01
        assert (high - 0.8 * P["c"]).max() < 0.01
        assert yielded[sand].sum() <= np.sum((excess > -0.01) | (high > 0.8 * P["c"] - 0.01))
        clay = system.present & np.isin(group, ["clay", "dug"])
        reached = units @ sigma[:, clay]
        highest = np.maximum(highest, reached.max(axis=1, initial=-np.inf))
        if n:
            assert 5 < yielded.sum() < len(yielded)
            assert not yielded[group == "base"].any()
    assert planes.planes[:2] == ("clay: p0", "clay: p1")
    assert planes.planes[5:] == ("sand: shear", "sand: tension")
    assert planes.stages == STAGES
    np.testing.assert_allclose(planes.distances[:5], [9e4, 8e4, 3.6e4, 4e4, 9.9e4])
    # a plane that was never reached moves with no multiplier: its largest product is that of stress
    never = planes.points[:5].sum(axis=1) == 0
    np.testing.assert_allclose(planes.reached[:5][never], highest[never], rtol=1e-9)
    assert (planes.points.sum(axis=0) > 0).all()
    assert never.sum() < 5


def test_derivatives_are_differences(staged):
    pairs = [
        *(("top", s) for s in STAGES), *(("side", s) for s in STAGES[1:]),
        *(("xx", s) for s in STAGES), *(("yy", s) for s in STAGES),
        *(("bolt", s) for s in ("dig", "press", "aside")),
    ]  # fmt: skip
    response = staged.response(pairs)
    _, jacobian = response.evaluate(HERE)
    assert_slopes_in_sizes(response.readings, P, jacobian, pairs, step=1e-5, rtol=1e-4)


def test_states_without_derivatives_are_the_same(staged):
    _, states = copies(staged)
    _, plain = copies(staged, derivatives=False)
    for found, wanted in zip(plain, states, strict=True):
        for one, other in zip(found[:3], wanted[:3], strict=True):
            assert one.shape[-1] == 1
            size = np.abs(other[..., 0]).max(initial=0.0)
            np.testing.assert_allclose(one[..., 0], other[..., 0], rtol=0.0, atol=1e-7 * size)
        np.testing.assert_array_equal(found[3], wanted[3])
