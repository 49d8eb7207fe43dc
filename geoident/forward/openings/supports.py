"""Supports of a circular opening: their lines, and the equilibrium with the ground (theory 4.6).

Pressures are positive on the wall, motions u of the wall inwards. A support of stiffness k that was
built when the wall had moved by u_0 presses by

    p_s = k (u - u_0) ,     0 <= p_s <= p_max ,

elastic, then perfectly plastic; it does not pull. Where k or p_max grow with its age, this holds
for the increments of a stage:  p_s = min(p_s' + k (u - u'), p_max)  with those of the stage before.

- *Ring* (Lame; E. Hoek & E. T. Brown, Underground excavations in rock, 1980), R its outer and
  b = R - t its inner radius:  k = E (R^2 - b^2) / ((1 + nu) R ((1 - 2 nu) R^2 + b^2)) ,
  p_max = strength (1 - b^2 / R^2) / 2, at which the hoop stress inside is the strength.
- *Ribs* of section A at a spacing S:  k = E A / (S R^2) ,  p_max = strength A / (S R).
- *Bolts* that are held at head and end (Hoek & Brown), d thick, of length l, a force F and a
  stiffness of the head K_h each:  1 / k = s_c s_l (4 l / (pi d^2 E) + 1 / K_h) ,
  p_max = F / (s_c s_l).

Shotcrete that hardens has parts 1 - exp(-t / T) of its stiffness and strength at the age t
(P. P. Oreste, A procedure for determining the reaction curve of shotcrete lining considering
transient conditions, Rock Mech. Rock Eng. 36, 2003). A stage is then divided into steps.

Several supports share the motion since each was built (C. Carranza-Torres & C. Fairhurst,
Application of the convergence-confinement method of tunnel design to rock masses that satisfy the
Hoek-Brown failure criterion, Tunn. Undergr. Space Technol. 15, 2000). With the pressure p_e that
the face still holds, and loads on the wall, the pressure inside solves

    p = p_e + sum of p_s(u(p)) .

u falls with p, so there is one root, between the pressure p' at the beginning of the stage and
p_e + sum of p_s'. Newton's method within that bracket finds it; where the ground has no equilibrium
the bracket is halved, since a support may hold ground that would not stand by itself. Derivatives
are those of an implicit function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.forward.openings.closed_forms import BeyondClosedForm, GroundState
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.members import rigidities
from geoident.model.actions import FaceDistance
from geoident.model.case import Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Values
from geoident.model.structures import Beam, BoltPattern, Ribs, Ring, Structure, SupportLine

PRESSURE = "pressure in the opening"
"""Name of p among those to differentiate by, the last one; no parameter has it, with its blanks."""

_EXACT = 1e-12
"""Step of the pressure, in parts of the bracket, or of p, after which it is solved to rounding."""

_MOST_STEPS = 200


@dataclass(frozen=True)
class Support:
    """A support during a stage.

    Args:
        name: of the structure.
        stiffness: k, Pa/m.
        capacity: p_max, Pa; None: no limit.
        carried: p_s at the beginning of the stage, Pa.
    """

    name: str
    stiffness: Dual
    capacity: Dual | None
    carried: Dual

    def pressure(self, moved: Dual) -> Dual:
        """p_s, Pa, when the wall has moved inwards by so much in the stage, m."""
        pressure = (self.carried + self.stiffness * moved).positive_part()
        if self.capacity is not None and pressure.value >= self.capacity.value:
            return self.capacity
        return pressure


def support_line(
    structure: Structure, radius: float, point: ParameterPoint
) -> tuple[Dual, Dual | None]:
    """Stiffness k, Pa/m, and capacity p_max, Pa, of what it is when it is old; None: no limit.

    Args:
        structure: of the kinds of openings, or a beam around the wall.
        radius: of the opening, m.
        point: the parameters.
    """
    number, limit = point.number, None
    if isinstance(structure, Ring):
        E, nu, inner = (
            number(structure.E),
            number(structure.nu),
            radius - number(structure.thickness),
        )
        hollow = inner * inner / radius**2
        stiffness = E * (1.0 - hollow) / (radius * (1.0 + nu) * (1.0 - 2.0 * nu + hollow))
        if structure.strength is not None:
            limit = number(structure.strength) * (1.0 - hollow) * 0.5
    elif isinstance(structure, Ribs):
        smeared = number(structure.area) / number(structure.spacing)
        stiffness = number(structure.E) * smeared / radius**2
        if structure.strength is not None:
            limit = number(structure.strength) * smeared / radius
    elif isinstance(structure, BoltPattern):
        d, spacing = number(structure.diameter), number(structure.spacing)
        each = spacing * (spacing if structure.rows is None else number(structure.rows))
        flexible = 4.0 / np.pi * number(structure.length) / (d * d * number(structure.E))
        if structure.head_stiffness is not None:
            flexible = flexible + 1.0 / number(structure.head_stiffness)
        stiffness = 1.0 / (each * flexible)
        if structure.capacity is not None:
            limit = number(structure.capacity) / each
    elif isinstance(structure, SupportLine):
        stiffness = number(structure.stiffness)
        limit = None if structure.capacity is None else number(structure.capacity)
    else:
        assert isinstance(structure, Beam)
        stiffness = rigidities(structure, point)[0] / radius**2
    return stiffness, limit


def equilibrium(
    ground: Callable[[Dual], GroundState],
    before: tuple[Dual, Dual],
    outside: Dual,
    supports: Sequence[Support],
) -> tuple[GroundState, dict[str, Dual]]:
    """The ground and what presses on its wall at the end of a stage.

    Args:
        ground: at a pressure inside, Pa.
        before: pressure inside, Pa, and motion of the wall inwards, m, at its beginning.
        outside: p_e, what presses on the wall beside the supports, Pa.
        supports: during the stage. All numbers have the derivative by `PRESSURE` last.

    Returns:
        The ground, and the pressure of each support by name, Pa.

    Raises:
        BeyondClosedForm: the ground has no equilibrium, or none in closed form.
    """
    start, moved_before = before
    other = outside + _sum(outside, [support.carried for support in supports])
    low, high = sorted((float(start.value), float(other.value)))
    pressure = float(other.value)
    for _ in range(_MOST_STEPS):
        inside = Dual.constant(pressure, outside.n)
        inside.columns[-1] = 1.0
        try:
            moved = ground(inside).wall_inwards - moved_before
        except BeyondClosedForm:
            # the weaker side of the bracket: with more pressure the ground may stand
            if high - pressure <= _EXACT * max(abs(high), abs(low)):
                raise
            low, after = pressure, 0.5 * (pressure + high)
        else:
            pressures = [support.pressure(moved) for support in supports]
            off = inside - outside - _sum(outside, pressures)
            excess, rise = float(off.value), float(off.columns[-1])
            low, high = (low, pressure) if excess > 0.0 else (pressure, high)
            after = pressure - excess / rise
            if abs(after - pressure) <= _EXACT * max(abs(high), abs(low)) or high <= low:
                break
            after = after if low <= after <= high else 0.5 * (low + high)
        pressure = after
    by_parameters = np.append(-off.columns[1:-1] / rise, 0.0)
    state = ground(Dual(np.concatenate([[pressure], by_parameters])))
    moved = state.wall_inwards - moved_before
    return state, {support.name: support.pressure(moved) for support in supports}


def too_thick(case: Case, radius: float, values: Values) -> str | None:
    """Which ring fills its opening at parameter values, or None."""
    for name, ring in case.structures.items():
        if isinstance(ring, Ring) and (thickness := ring.thickness.value(values)) >= radius:
            return (
                f"of the structure '{name}' thickness is {thickness:.6g} m, it must be less than "
                f"the radius of the opening, {radius:.6g} m"
            )
    return None


def hardening_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Rings whose age is not known at a stage at which they stand."""
    case, states, faults = on_mesh.case, on_mesh.sequence.states, []
    for name, ring in case.structures.items():
        if not isinstance(ring, Ring):
            continue
        standing = [n for n, state in enumerate(states) if name in state.structures]
        needed = sorted({*standing, *(states[n].base for n in standing)})
        by_distance = [
            any(isinstance(r, FaceDistance) for r in states[n].release.values()) for n in needed
        ]
        key, what, lacking = "hardening_time", "date", list[str]()
        if ring.hardening_time is not None:
            lacking = [states[n].name for n in needed if states[n].name not in case.times]
            hint = f"Add 'dates: {{{lacking[0]}: 2024-03-01}}'" if lacking else ""
        elif ring.hardening_distance is not None:
            key, what = "hardening_distance", "distance to the face"
            pairs = zip(needed, by_distance, strict=True)
            lacking = [states[n].name for n, known in pairs if not known]
            hint = f"Add 'distance: 2.5 m' to stage '{lacking[0]}'" if lacking else ""
        if lacking:
            message = f"the age of '{name}' is not known: stage '{lacking[0]}' has no {what}"
            place = ("structures", name, key)
            hint += ", or leave out the hardening and give the E of the young concrete."
            faults.append(case.source.fault(place, "no-age", message, hint))
    return faults


def _sum(like: Dual, parts: Sequence[Dual]) -> Dual:
    total = Dual.constant(0.0, like.n)
    for part in parts:
        total = total + part
    return total
