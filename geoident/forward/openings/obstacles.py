"""Why an opening has no closed form: by its ground and in-situ stress, or by what a stage does."""

from __future__ import annotations

from geoident.forward.openings.site import OpeningSite
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.model.actions import Pressure
from geoident.model.case import Analysis, Case
from geoident.model.ground import Isotropic
from geoident.model.in_situ import GeostaticStress
from geoident.model.structures import Beam, OpeningSupport, Structure
from geoident.model.yielding import HoekBrown, MohrCoulomb

NO_SECTION = "its formulas are those of plane strain"


def unsuitable(case: Case, material: str, *, has_mesh: bool) -> str | None:
    """Why a case has no closed form, a clause, or None if it has one.

    Args:
        case: the case.
        material: name of the ground around the opening.
        has_mesh: whether surfaces may be groups of faces.
    """
    ground, in_situ = case.materials[material], case.in_situ
    if case.analysis is not Analysis.PLANE_STRAIN:
        return NO_SECTION
    if case.in_steps is not None:
        return case.in_steps
    if not isinstance(ground.elastic, Isotropic):
        return f"'{material}' is not isotropic"
    if ground.soil is not None:
        return f"'{material}' is a hardening soil"
    if len(ground.yields) > 1 or not all(
        isinstance(surface, MohrCoulomb | HoekBrown) for surface in ground.yields
    ):
        return f"'{material}' has other yield limits than one of Mohr-Coulomb or Hoek-Brown"
    if any(isinstance(s, HoekBrown) and s.dilation is None for s in ground.yields):
        return f"'{material}' flows along the normals of Hoek-Brown; with 'dilation' it has one"
    if ground.fields or ground.growths:
        return f"'{material}' varies from place to place"
    if case.in_situ_of:
        return "groups have in-situ stresses of their own"
    if has_mesh:
        return None
    if isinstance(in_situ, GeostaticStress):
        return "the geostatic stress is the weight of the layers of a mesh"
    if isinstance(getattr(in_situ, "surface", None), str):
        return "the depth is counted from a group of faces, which needs a mesh"
    return None


def stage_obstacles(on_mesh: CaseOnMesh, site: OpeningSite) -> list[str | None]:
    """Why each state has no closed form, a clause, or None if it has one.

    What happens at a state stands against those that build on it, too.

    Args:
        on_mesh: the case.
        site: the opening.
    """
    states = on_mesh.sequence.states
    reasons: list[str | None] = [_obstacle(on_mesh, site, states[0])]
    for state in states[1:]:
        reasons.append(reasons[0] or reasons[state.base] or _obstacle(on_mesh, site, state))
    return reasons


def _obstacle(on_mesh: CaseOnMesh, site: OpeningSite, state: ConstructionState) -> str | None:
    """Why what happens at a state has no closed form."""
    sequence = on_mesh.sequence
    groups, virgin = sequence.groups, sequence.states[0]
    closed = site.groups & state.materials.keys()
    if closed and closed != site.groups:
        return f"at stage '{state.name}' only a part of the opening is excavated"
    if not closed and len({state.release.get(g) for g in site.groups}) > 1:
        return f"at stage '{state.name}' parts of the opening are released differently"
    if state.placed:
        return f"stage '{state.name}' installs '{groups[min(state.placed)]}'"
    for g in sorted((virgin.materials.keys() | state.materials.keys()) - site.groups):
        if state.materials.get(g) != virgin.materials.get(g):
            return f"stage '{state.name}' changes '{groups[g]}', which is not part of the opening"
    for name, support in state.supports.items():
        if support.moves:
            return f"the support '{name}' is moved by what is given"
    if state.held != virgin.held:
        return f"stage '{state.name}' changes what is held"
    for name in sorted(state.structures):
        if not _supports_wall(on_mesh.case.structures[name], site):
            return f"'{name}' supports the ground at stage '{state.name}'"
        if closed:
            return f"'{name}' is built before the opening is excavated"
    if state.temperature:
        return f"the temperature of '{groups[min(state.temperature)]}' changes"
    if state.water is not None:
        return "there is water in the pores"
    for name, load in state.loads.items():
        if not isinstance(load, Pressure) or not (site.walls is None or load.group in site.walls):
            return f"the load '{name}' is not a pressure on the wall of the opening"
        if closed:
            return f"the load '{name}' acts before the opening is excavated"
    return None


def _supports_wall(structure: Structure, site: OpeningSite) -> bool:
    """Whether a structure presses on the whole wall all round, as a ring does."""
    if isinstance(structure, Beam):
        round_wall = site.walls is None or structure.group in site.walls
        return round_wall and not structure.hinges and not structure.has_weight
    return isinstance(structure, OpeningSupport)
