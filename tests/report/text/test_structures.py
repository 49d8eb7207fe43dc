"""Forces in linings and bolts, kN for people and N for programs, against numbers by hand."""

from types import SimpleNamespace

import numpy as np

from geoident.model.results.result import MemberForces, SupportReactions
from geoident.model.results.sections import section_uses
from geoident.model.results.shells import ShellForces
from geoident.report.text.structures import (
    force_table,
    reaction_table,
    reaction_tables_by_stage,
    shell_table,
    strength_sentence,
    strength_table,
    structures_list,
)
from geoident.workflow.estimating.predictions import strength_findings

NAN = np.nan


def forces():
    """A lining of two pieces that stands from the second stage, and a bolt from the first."""
    return MemberForces(
        structures=("wall", "wall", "nail"),
        numbers=np.array([1, 2, 1]),
        stages=("first", "second"),
        ends=np.arange(12.0).reshape(3, 2, 2),
        axial=1e3 * np.array([[NAN, -120.0], [NAN, -80.5], [15.0, 20.0]]),
        moment=1e3
        * np.array([[[NAN, 2.0], [NAN, -7.25]], [[NAN, -7.25], [NAN, 0.0]], [[NAN] * 2] * 2]),
        shear=1e3 * np.array([[NAN, -9.25], [NAN, 7.25], [NAN, NAN]]),
        per_metre=np.array([True, True, False]),
        hoop=np.full((3, 2), NAN),
        prestress=np.full((3, 2), NAN),
    )


def test_extremes_of_each_structure_at_each_stage_at_which_it_stands_are_shown():
    assert [list(row) for row in force_table(forces()).rows] == [
        ["wall", "second", "-120", "-80.5", "7.25", "9.25"],
        ["nail", "first", "15", "15", "-", "-"],
        ["nail", "second", "20", "20", "-", "-"],
    ]
    header = ("structure", "stage", "N from", "N to", "|M| up to", "|Q| up to")
    assert force_table(forces()).header == header
    assert force_table(None).text == ""


def test_extremes_over_the_faces_of_each_shell_are_shown():
    """Two faces of a vault and a slab of one, which stands from the second stage; no rounding."""
    normal = 1e3 * np.array([[[1.0, 2], [-3, -4], [0.5, -6]], [[-1, 3], [-5, 7], [0, 1e-14]],
                             [[NAN, 1e-14], [NAN, -2], [NAN, 0]]])  # fmt: skip
    shells = ShellForces(
        structures=("vault", "vault", "slab"),
        numbers=np.array([1, 2, 1]),
        stages=("first", "second"),
        centres=np.zeros((3, 3)),
        corners=np.zeros((3, 4, 3)),
        axes=np.broadcast_to(np.eye(3), (3, 3, 3)),
        normal=normal,
        moment=normal * [[[1.0], [10.0], [-1.0]]],
    )
    assert [list(row) for row in shell_table(shells).rows] == [
        ["vault", "first", "-1", "1", "-5", "-3", "0.5", "1", "50", "0.5"],
        ["vault", "second", "2", "3", "-4", "7", "6", "3", "70", "6"],
        ["slab", "second", "0", "0", "-2", "-2", "0", "0", "20", "0"],
    ]
    assert shell_table(None).text == ""


def test_where_the_strength_of_shells_is_used_most_is_shown():
    """Two faces of a vault: what is used along both axes and in the direction of 45 degrees."""
    used = np.array([[[0.2], [np.inf], [np.inf]], [[0.4], [0.1], [0.5]]])
    shells = ShellForces(
        structures=("vault", "vault"),
        numbers=np.array([1, 2]),
        stages=("built",),
        centres=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        corners=np.zeros((2, 4, 3)),
        axes=np.broadcast_to(np.eye(3), (2, 3, 3)),
        normal=1e3 * np.array([[[-1.0], [2.0], [0.0]], [[-8.0], [-4.0], [3.0]]]),
        moment=1e3 * np.array([[[5.0], [6.0], [0.0]], [[1.0], [3.0], [-2.0]]]),
        utilisation=used,
        used_angle=np.full((2, 1), np.pi / 4),
    )
    assert [list(row) for row in strength_table(section_uses(None, shells)).rows] == [
        ["vault along axis 1", "built", "40 %", "-8", "1", "4, 5, 6"],
        ["vault along axis 2", "built", "no capacity", "2", "6", "1, 2, 3"],
        ["vault in the worst direction", "built", "no capacity", "0.5", "5.5", "1, 2, 3"],
    ]
    assert strength_sentence(section_uses(None, shells)) == ""  # a finding says it
    (finding,) = strength_findings(SimpleNamespace(members=None, shells=shells))
    assert finding.sentence == (
        "The strength of vault is exceeded: N and M need more than any part along axis 2 (stage "
        "built). The analysis takes it as elastic."
    )
    used[0, 1:] = 0.3
    assert strength_sentence(section_uses(None, shells)) == (
        "N and M use at most 50 % of the strength of the linings (vault in the worst direction, "
        "built)."
    )
    assert strength_table(section_uses(None, None)).rows == []


def test_programs_get_every_piece():
    found = structures_list(forces())
    assert [(m["structure"], m["number"], m["stage"]) for m in found] == [
        ("wall", 1, "second"), ("wall", 2, "second"), ("nail", 1, "first"), ("nail", 1, "second"),
    ]  # fmt: skip
    assert (found[0]["N"], found[0]["M"], found[0]["Q"]) == (-120e3, [2e3, -7250.0], -9250.0)
    assert (found[3]["N"], found[3]["M"], found[3]["Q"]) == (20e3, None, None)
    assert [m["per_metre"] for m in found] == [True, True, False, False]
    assert found[1]["ends"] == [[4.0, 5.0], [6.0, 7.0]]
    assert structures_list(None) == []


def test_rounding_of_large_forces_is_no_reaction():
    """A support on which nothing acts had -4.6e-12 kN where another has 10 MN."""
    force = np.array([[[NAN, -4.6e-9], [NAN, 1e7]], [[2.5, NAN], [-3e3, NAN]]])
    rows = reaction_table(SupportReactions(("foot", "side"), ("push", "load"), force)).rows
    assert [list(row) for row in rows] == [
        ["foot", "push", "-", "0"], ["foot", "load", "-", "10000"],
        ["side", "push", "0.0025", "-"], ["side", "load", "-3", "-"],
    ]  # fmt: skip
    (table,) = reaction_tables_by_stage(SupportReactions(("foot", "side"), ("push", "load"), force))
    assert table.header == ("stage", "foot R_y", "side R_x")
    assert [list(row) for row in table.rows] == [["push", "0", "0.0025"], ["load", "10000", "-3"]]
    nothing = SupportReactions(("foot",), ("push",), np.full((1, 1, 2), NAN))
    assert reaction_table(nothing).rows == []
    assert reaction_tables_by_stage(nothing) == []


def test_rounding_of_large_forces_is_no_force_in_a_wall():
    members = forces()
    members.axial[0, 1] = -1.8e-10
    members.axial[1, 1] = 0.0
    wall = force_table(members, per_metre=True).rows
    assert [list(row) for row in wall] == [["wall", "second", "0", "0", "7.25", "9.25"]]
    assert [row[0] for row in force_table(members, per_metre=False).rows] == ["nail", "nail"]
