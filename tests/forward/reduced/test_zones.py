"""Histories of the ground: of which motions the stress of a zone is made."""

from __future__ import annotations

import numpy as np
import pytest
from support.reduced import braced, plane, spread

from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.reduced.points import AnalysisPoints
from geoident.forward.reduced.zones import (
    Segment,
    StressHistory,
    Zone,
    member_zones,
    rigidity_name,
    zones_of,
)


def test_a_history_goes_on_or_turns_to_another_material():
    virgin = StressHistory("rock", (), given=True)
    one = virgin.went_on("rock", 0, 2)
    assert one == StressHistory("rock", (Segment("rock", None, 2),), given=True)
    assert one.went_on("rock", 2, 5).segments == (Segment("rock", None, 5),)
    turned = one.went_on("clay", 2, 5)
    assert turned.segments == (Segment("rock", None, 2), Segment("clay", 2, 5))
    assert turned.went_on("clay", 5, 7).segments == (
        Segment("rock", None, 2), Segment("clay", 2, 7),
    )  # fmt: skip
    back = turned.went_on("rock", 5, 7)
    assert back.segments[-1] == Segment("rock", 5, 7)
    assert back.given


def test_the_parts_of_a_zone_are_ends_of_its_segments_less_their_starts():
    history = StressHistory("marl", (Segment("rock", None, 2), Segment("clay", 3, 5)))
    zone = Zone(np.array([1, 4]), "clay", "rock", history)
    assert zone.parts == [
        (0, "marl", 1.0), (2, "rock", 1.0), (5, "clay", 1.0), (3, "clay", -1.0),
    ]  # fmt: skip
    later = StressHistory(None, (Segment("clay", 3, 5),))
    assert Zone(np.array([1]), "clay", "clay", later).parts == [
        (5, "clay", 1.0), (3, "clay", -1.0),
    ]  # fmt: skip


def test_zones_of_the_stages_of_a_lined_heading():
    """Heading, lining placed, a load case on the side, bench with the lining hardened."""
    staged = plane()
    zones = zones_of(staged.on_mesh)
    groups = staged.on_mesh.sequence.groups
    points_of = {groups[g]: index for g, index in staged.discretization.points_of.items()}
    n_points = staged.discretization.points.n_points

    def points(*names):
        chosen = np.zeros(n_points, dtype=bool)
        for name in names:
            chosen[points_of[name]] = True
        return np.flatnonzero(chosen).tolist()

    def said(state):
        return {tuple(z.points.tolist()): (z.material, z.before, z.history) for z in zones[state]}

    def rock(*segments):
        return ("rock", "rock", StressHistory("rock", segments, given=True))

    assert len(zones) == 5
    everything = points("rock", "heading", "bench", "lining")
    assert said(0) == {tuple(everything): rock()}
    stays = tuple(points("rock", "bench"))
    assert said(1) == {stays: rock(Segment("rock", None, 1))}
    lining = tuple(points("lining"))
    young = StressHistory(None, (Segment("young", 1, 2),))
    assert said(2) == {
        stays: rock(Segment("rock", None, 2)),
        lining: ("young", "young", young),
    }
    aside = StressHistory(None, (Segment("young", 1, 3),))
    assert said(3) == {
        stays: rock(Segment("rock", None, 3)),
        lining: ("young", "young", aside),
    }
    harder = StressHistory(None, (Segment("young", 1, 2), Segment("shotcrete", 2, 4)))
    assert said(4) == {
        tuple(points("rock")): rock(Segment("rock", None, 4)),
        lining: ("shotcrete", "young", harder),
    }


def test_zones_of_members_begin_when_they_are_built_or_released_by_the_jack():
    staged = braced()
    analysis = staged.analysis
    points = AnalysisPoints(analysis.systems)
    zones = member_zones(analysis, points)
    parts = {part.name: part for part in analysis.systems.structures.parts}
    assert [len(of) for of in zones] == [0, 3, 3, 4, 3]

    def said(state):
        found = {}
        for zone in zones[state]:
            assert zone.material == zone.before
            found[zone.material] = zone.points.tolist(), zone.history
        return found

    def rows(name, bending):
        part = parts[name]
        mine = np.flatnonzero(part.members.bending == bending)
        return (points.n_ground + part.rows.start + mine).tolist()

    def since(name, bending, start, end, *, given=False):
        segment = Segment(rigidity_name(name, bending), start, end)
        return rows(name, bending), StressHistory(None, (segment,), given)

    assert rigidity_name("plate", True) == "EI of plate"
    for state in (1, 2, 3):
        found = said(state)
        assert found["EA of plate"] == since("plate", False, None, state)
        assert found["EI of plate"] == since("plate", True, None, state)
        assert found["EA of bolts"] == since("bolts", False, None, state)
    assert said(3)["EA of struts"] == since("struts", False, 2, 3, given=True)
    assert said(4)["EA of struts"] == since("struts", False, 2, 4, given=True)
    assert "EA of bolts" not in said(4)


def test_points_of_ground_and_members_are_strained_and_bear_alike():
    """Strains of both, the virtual work of both, and what a stage clears."""
    staged = braced()
    analysis = staged.analysis
    points, structures = AnalysisPoints(analysis.systems), analysis.systems.structures
    ground = analysis.systems.discretization.points
    random = np.random.default_rng(2)
    u, v = random.standard_normal((2, analysis.systems.discretization.n_dofs, 3))
    assert points.n_points == ground.n_points + structures.n_rows
    whole = points.strain(u)
    np.testing.assert_array_equal(whole[:, : points.n_ground], ground.strain(u))
    np.testing.assert_array_equal(whole[0, points.n_ground :], structures.strain(u))
    assert not whole[1:, points.n_ground :].any()
    some = np.array([3, 4, 9])
    np.testing.assert_allclose(points.strain(u, some), whole[:, some], rtol=1e-13)
    beams = points.n_ground + np.array([0, 2, structures.n_rows - 1])
    np.testing.assert_allclose(points.strain(u, beams), whole[:, beams], rtol=1e-13)
    first = np.array([points.n_ground])
    np.testing.assert_allclose(points.strain(u, first), whole[:, first], rtol=1e-13)
    assert points.strain(u, np.array([], dtype=np.int64)).shape == (points.n_strain, 0, 3)
    state, system = analysis.sequence.states[2], analysis.systems[2]
    stress = random.standard_normal(whole.shape)
    cleared = stress.copy()
    points.clear(cleared, state, system)
    present, stiff = system.present, structures.stiff(state)
    np.testing.assert_array_equal(
        np.any(cleared != 0.0, axis=(0, 2)), np.concatenate([present, stiff])
    )
    alive = np.concatenate([present, stiff])
    np.testing.assert_array_equal(cleared[:, alive], stress[:, alive])
    work = np.einsum("ik,ij->kj", v, points.forces(cleared, system))
    exact = np.einsum("sqk,q,sqj->kj", points.strain(v), points.volume, cleared)
    np.testing.assert_allclose(work, exact, atol=1e-10 * np.abs(exact).max())
    begun = stress.copy()
    points.clear_begun(begun, state)
    placed = np.zeros(points.n_ground, dtype=bool)
    for group in state.placed:
        placed[analysis.systems.discretization.points_of[group]] = True
    gone = np.concatenate([placed, structures.begins_anew(state)])
    assert placed.any()
    assert structures.begins_anew(state).any()
    np.testing.assert_array_equal(np.any(begun == 0.0, axis=(0, 2)), gone)
    np.testing.assert_array_equal(begun[:, ~gone], stress[:, ~gone])


@pytest.mark.parametrize("build", [plane, braced])
def test_stresses_of_a_march_are_the_sums_of_its_zones(build):
    """sigma_0 and E C u of every part, at any parameters."""
    staged = build()
    p = spread(staged, 1, seed=11)[0]
    analysis = staged.analysis
    points = AnalysisPoints(analysis.systems)
    every = [
        (*ground, *members)
        for ground, members in zip(zones_of(staged.on_mesh), member_zones(analysis, points),
                                   strict=True)
    ]  # fmt: skip
    run = staged.at(p, RunOptions(derivatives=False))
    motion, stresses = {}, {}
    for end in run.states():
        motion[end.state] = end.u.copy()
        stresses[end.state] = points.joined(end.stress[...].copy(), end.members.copy())
    point = run.point
    in_situ = analysis.in_situ.columns(point)[..., :1]
    structures = analysis.systems.structures
    given = sum(structures.given(state, point)[:, :1] for state in analysis.sequence.states)
    start = points.joined(in_situ, given + np.zeros((structures.n_rows, 1)))
    for number in range(1, len(analysis.sequence.states)):
        state = analysis.sequence.states[number]
        moduli = structures.moduli(state, point)[:, 0] if structures.n_rows else np.zeros(0)
        for zone in every[number]:
            mine = zone.points
            found = (
                start[:, mine] if zone.history.given else np.zeros((points.n_strain, len(mine), 1))
            )
            for other, material, sign in zone.parts:
                if other == 0:
                    continue
                strain = points.strain(motion[other], mine)
                if material in analysis.case.materials:
                    elastic = analysis.case.materials[material].elastic
                    E = elastic_matrix(elastic, point, section=True).columns[:4, :4, 0]
                    found = found + sign * np.einsum("ij,jqk->iqk", E, strain)
                else:
                    found = found + sign * moduli[mine - points.n_ground, None] * strain
            exact = stresses[number][:, mine]
            np.testing.assert_allclose(found, exact, rtol=1e-7, atol=1e-9 * np.abs(start).max())
