"""The error of a stage without equilibrium: how sure it is, how the ground moves, what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.errors import CollapseError
from geoident.fem.location import format_point
from geoident.forward.analysis.bands import ShearBand
from geoident.forward.analysis.collapse import CarriedPart
from geoident.forward.analysis.equilibrium import MOST_STEPS
from geoident.forward.analysis.stage import LastEquilibrium, StageTask
from geoident.forward.analysis.stage_equations import NoEquilibrium
from geoident.forward.analysis.systems import StageSystem
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.members import StructureMembers
from geoident.forward.structures.strain_points import MemberPoints
from geoident.model.arrays import Floats
from geoident.model.mesh import motions_of_nodes
from geoident.model.results.yielded import Mechanism

_HINGES = 6
"""Members that are named as hinges at most."""

_SLIPS = 0.1
"""Part of the largest velocity of a mechanism from which on the jump of an interface counts."""

_STRONG = 0.5
"""Part of the largest rate of shear from which on a mechanism shears strongly."""


def collapse_error(
    on_mesh: CaseOnMesh,
    task: StageTask,
    failure: NoEquilibrium,
    *,
    associated: bool,
    carried: CarriedPart | None = None,
    residual: float = np.nan,
    band: ShearBand | None = None,
    members: MemberPoints | None = None,
) -> CollapseError:
    """The error of a stage without equilibrium.

    Args:
        on_mesh: the case on its mesh.
        task: the stage.
        failure: how it fails.
        associated: whether all flow is associated.
        carried: the part of the change of load that is carried, where that is known.
        residual: part of the change of load that stress beyond the yield surface carried where the
            search ended with flow that is not associated; NaN where not known.
        band: the mode that has lost its stability where diffuse flow ended, or None.
        members: those of structures that yield, or None.
    """
    mechanism = failure.mechanism
    what = "the ground"
    if members is not None:
        ground = any(on_mesh.case.materials[m].yields for m in task.state.materials.values())
        names = ", ".join(f"{part.what} '{part.name}'" for part in members.parts)
        what = f"the ground with {names}" if ground else names
    if failure.proven:
        msg = f"at {task.moment} {what} cannot carry the loads: plastic collapse"
        hint = "Raise the strengths (their start values or bounds), or see whether the stage "
        hint += "lacks support or loads more than is meant."
    elif associated:
        msg = f"at {task.moment} not converged: no equilibrium was found in "
        msg += f"{MOST_STEPS} Newton steps"
        hint = "Divide the change of load among several stages, or raise the strengths: the ground "
        hint += "is near its limit, or beyond it."
    else:
        msg = f"at {task.moment} not converged: no equilibrium was found"
        if np.isfinite(residual):
            msg += f", residual {100 * residual:.2g} % of the change of load, carried by stress "
            msg += "beyond the yield surface"
        if band is not None:
            mechanism = band.mode
            msg += ", and a band has lost its stability, with half of its strain in "
            msg += f"{band.points} of the {band.yielding} strain points that yield"
        hint = "It may mean that the stage is beyond its limit load, or that shear goes into bands "
        hint += "as wide as the elements, as with a dilation far below the friction. See whether "
        hint += "support that acts in this stage, a larger dilation, or larger elements where it "
        hint += "shears carry it; if not, the ground lacks strength."

    fraction, reached = np.nan, None
    if carried is not None:
        fraction = carried.fraction
        verb = "is carried" if failure.proven else "was brought to equilibrium"
        msg += f"; {100 * fraction:.3g} % of the change of load of this stage {verb}"
        if (end := carried.end) is not None:
            points = on_mesh.discretization.points
            reached = LastEquilibrium(
                end.du[: points.n_dofs],
                end.stress[:, : points.n_points],
                end.yielded()[: points.n_points],
            )
    motion = None
    if mechanism is not None:
        if members is not None:
            msg += _describe_hinges(members, mechanism)
        mechanism = mechanism[: on_mesh.discretization.points.n_dofs]
        if members is None or ground:
            msg += describe_mechanism(on_mesh, task.system, mechanism)
        mechanism = mechanism / (np.abs(mechanism).max() or 1.0)
        motion = mechanism_on_mesh(on_mesh, task, mechanism, fraction)
    return CollapseError(
        msg,
        hint,
        stage=task.state.name,
        fraction=fraction,
        mechanism=mechanism,
        motion=motion,
        reached=reached,
        proven=failure.proven,
    )


def _describe_hinges(members: MemberPoints, velocities: Floats) -> str:
    """Where structures flow in a mechanism: at the members that turn or stretch most.

    Args:
        members: those that yield.
        velocities: (n_dofs + n_turns,).
    """
    u, turns = np.split(velocities, [members.motion.shape[1]])
    axial, *bent = members.strain(u, turns)[:3] * members.weight
    rate = np.maximum(np.abs(axial), np.hypot(*bent))
    text = ""
    for part in members.parts:
        own = rate[part.points]
        if own.max() <= _STRONG * rate.max():
            continue
        most = np.argsort(own)[::-1][:_HINGES]
        places = part.ends[most[own[most] > _STRONG * own.max()]].mean(axis=1).round(3)
        where = ", ".join(dict.fromkeys(format_point(place) for place in places))
        text += f"; {part.what} '{part.name}' yields near {where}"
    return text


def describe_slips(joints: Sequence[StructureMembers], jumps: Floats) -> str:
    """Which interfaces slip or open in a mechanism, and where, for a message; empty for none.

    Args:
        joints: parts of interfaces that stand.
        jumps: (n_rows,) strains of all structures in the mechanism, whose largest velocity is one.
    """
    text = ""
    for part in joints:
        assert part.joint is not None
        at = part.joint.points.position
        size = np.linalg.norm(jumps[part.rows].reshape(-1, len(at)), axis=0)
        where = at[size > _STRONG * size.max()].round(3)
        if size.max() > _SLIPS:
            ends = (format_point(where.min(axis=0)), format_point(where.max(axis=0)))
            text += f"; the interface '{part.name}' slips or opens, most between {ends[0]} and "
            text += ends[1]
    return text


def describe_mechanism(on_mesh: CaseOnMesh, system: StageSystem, u: Floats) -> str:
    """Where a mechanism shears most, and how far it reaches, for a message.

    Args:
        on_mesh: the case on its mesh.
        system: the equations of the stage.
        u: (n_dofs,) velocities.
    """
    points, mesh, sequence = on_mesh.discretization.points, on_mesh.mesh, on_mesh.sequence
    rate = _shear_rate(on_mesh, system, u)
    most = int(np.argmax(rate))
    if not rate[most] > 0.0:
        node = int(np.argmax(np.linalg.norm(u.reshape(-1, mesh.dim), axis=1)))
        return f" near {format_point(mesh.points[node])}"
    group = sequence.groups[sequence.group_of[points.element[most]]]
    position = points.position.round(3)
    where = position[rate > _STRONG * rate[most]]
    text = f"; it shears most in group '{group}' near {format_point(position[most])}"
    ends = (format_point(where.min(axis=0)), format_point(where.max(axis=0)))
    return f"{text}, and strongly between {ends[0]} and {ends[1]}"


def mechanism_on_mesh(
    on_mesh: CaseOnMesh,
    task: StageTask,
    u: Floats,
    fraction: float,
    joints: Sequence[StructureMembers] = (),
    jumps: Floats | None = None,
) -> Mechanism:
    """A mechanism as it is drawn: its velocities, and the shear rate of each element.

    An interface that slips counts as a rate of shear of the elements on its first side: else what
    elastic rock beside it strains would look like shear.

    Args:
        on_mesh: the case on its mesh.
        task: the stage.
        u: (n_dofs,) velocities.
        fraction: part of the change of load that is carried; NaN where not known.
        joints: parts of interfaces that stand.
        jumps: (n_rows,) strains of all structures; None for no joints.
    """
    mesh = on_mesh.mesh
    shear = np.zeros(mesh.n_elements)
    rate = _shear_rate(on_mesh, task.system, u)
    np.maximum.at(shear, on_mesh.discretization.points.element, rate)
    size = np.concatenate(
        [np.ptp(mesh.points[block.nodes], axis=1).max(axis=1) for block in mesh.blocks]
    )
    for part in joints:
        assert part.joint is not None
        assert jumps is not None
        points = part.joint.points
        jump = np.linalg.norm(jumps[part.rows].reshape(-1, len(points.position)), axis=0)
        row, place = points.mean.nonzero()
        beside = points.beside[place]
        np.maximum.at(shear, beside, jump[row] / size[beside])
    return Mechanism(
        task.state.name,
        task.number,
        fraction,
        mesh,
        on_mesh.sequence.present(task.number),
        motions_of_nodes(mesh, u),
        shear / (shear.max(initial=0.0) or 1.0),
    )


def _shear_rate(on_mesh: CaseOnMesh, system: StageSystem, u: Floats) -> Floats:
    """(m,) norm of the deviatoric strain of u (n_dofs,), where the stage has ground.

    Shear components are engineering strains.
    """
    strain = on_mesh.discretization.points.strain(u)
    normal, shear = strain[:3], strain[3:]
    deviator = normal - normal.mean(axis=0)
    norm = np.sqrt((deviator**2).sum(axis=0) + 0.5 * (shear**2).sum(axis=0))
    return np.where(system.volume > 0.0, norm, 0.0)
