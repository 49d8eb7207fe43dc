"""Takes the columns of a reduced model from a march while it runs, and adds further ones.

While the factorization of a stage is there, further columns cost a solution each. Where the moduli
depend on h, and the loads do not, the second derivative of the equations of a state by h and k is

    C^T V ( E C u_hk + E_h C u_k + E_k C u_h + E_hk C u ) = 0      (sums over segments understood)

so with the first derivatives, which are there, u_hk follows. The part E_hk, zero where moduli are
linear in h, is left out: what is in the bracket is a stress in equilibrium with no load all the
same, and the space that these columns add is what counts. With them the model of one march is right
to second order in the moduli, whatever the loads. A parameter by which all moduli grow alike needs
none: it divides the displacements by a number.

Where one parameter alone moves the moduli otherwise, more of them cost little,

    C^T V ( E C v_m + (E_h - b E) C v_m-1 ) = 0 ,    v_0 the displacements by each of the loads ,

which is the space of conjugate gradients for other values of h, preconditioned by the factor that
is there (Saad, Iterative methods for sparse linear systems, 2003, 6.7). Every m takes a digit or so
from the error of the model where the search ends: that saves it another factorization of every
stage. The shift b changes nothing in that space, and keeps columns from growing and from being
alike: it is the middle of the eigenvalues of E_h against E in the ground that there is most of.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.gauges.observation import Observation
from geoident.forward.march.march import Run
from geoident.forward.march.stage import StageEnd
from geoident.forward.reduced.affine_march import AffineMarch
from geoident.forward.reduced.snapshots import (
    Further,
    Snapshot,
    settling_strain,
    stress_turns,
)
from geoident.model.arrays import Floats

_NOISE = 1e-9
"""Stress of settling, relative to the virgin one, that is rounding."""

MOST_SECOND = 12
"""Second derivatives that are taken at most."""

MOST_FURTHER = 24
"""Further columns of a march at most, where one parameter alone moves the moduli."""

ORDERS = 8
"""How often the moduli act on a load at most: what more would add is near to rounding."""

_ALIKE = 1e-9
"""Moduli that grow alike do so to this part."""


class Recorder:
    """Records one march with derivatives.

    Args:
        affine: the march with the form of its moduli and loads.
        observation: the gauges.
        p: (n,) parameters of the march.
        further: how many columns are added at most.
    """

    def __init__(
        self, affine: AffineMarch, observation: Observation, p: Floats, *, further: int
    ) -> None:
        self._march, self._observation, self._zones = affine.march, observation, affine.zones
        self._spans, self._loads = affine.form.spans, affine.form.loads
        self._points = affine.points
        self._scale = np.concatenate([[1.0], self._loads.scale])
        at = affine.form.at(p[None])
        self._psi = np.hstack([at.loads[0][:, None], at.load_slopes[0]])
        self._moduli = {name: c[0] for name, c in at.moduli.items()}
        self._slopes = {name: dc[0] for name, dc in at.slopes.items()}
        self._further = self.further_columns(further) if further else []
        none = np.zeros((len(self._psi), len(self._further)))
        sized = {name: slope * self._loads.scale for name, slope in self._slopes.items()}
        turns = stress_turns(self._moduli, sized, self._further)
        self.snapshot = Snapshot(p.copy(), np.hstack([self._psi * self._scale, none]), turns)

    def add(self, end: StageEnd, run: Run) -> None:
        """Record a state.

        Args:
            end: the state.
            run: the march, at this state.
        """
        kept = self.snapshot
        if end.state == 0:
            if self._loads.settles:
                virgin = self._points.joined(end.stress, end.members)
                kept.settled = self._settled(virgin) * self._scale
            kept.motion.append(np.zeros((0, kept.columns)))
            kept.observed.append(np.zeros((len(self._observation.channels), kept.columns)))
            return
        u = end.u * self._scale
        if self._further:
            u = self._with_further(end.state, u, run)
        kept.motion.append(u)
        kept.observed.append(self._seen(u))

    def further_columns(self, most: int) -> list[Further]:
        """Of what further columns are made, each of columns before it.

        None where the virgin ground settles: its motion is not the march's.

        Args:
            most: how many at most.
        """
        if self._loads.settles:
            return []
        n = len(self._loads.scale)
        moves = [any(slope[:, h].any() for slope in self._slopes.values()) for h in range(n)]
        free = ~np.any(self._loads.exponents, axis=0)
        first = [h for h in range(n) if moves[h] and free[h] and not self._grow_alike(h)]
        loads = self._loading([k for k in range(n) if not moves[k]])
        if len(first) == 1 and loads and most > MOST_SECOND:
            return self._chains(first[0], loads, most)
        pairs = [(h, k) for h in first for k in range(n) if k not in first or k >= h]
        some = pairs[: min(most, MOST_SECOND)]
        return [((h, 1 + k, 0.0), (k, 1 + h, 0.0)) for h, k in some]

    def _grow_alike(self, h: int) -> bool:
        """Whether all moduli grow in proportion to themselves with a parameter."""
        c = np.concatenate(list(self._moduli.values()))
        slope = np.concatenate([slope[:, h] for slope in self._slopes.values()])
        growth = float(c @ slope) / float(c @ c)
        left = np.abs(slope - growth * c).max()
        return bool(left <= _ALIKE * np.abs(growth * c).max())

    def _loading(self, free: Sequence[int]) -> list[int]:
        """Columns of parameters that move loads alone, if all loads are sums of theirs.

        Args:
            free: parameters that move no moduli.
        """
        columns = [1 + k for k in free if self._psi[:, 1 + k].any()]
        psi = self._psi * self._scale
        size = np.abs(psi).max(axis=1, initial=0.0)
        psi = psi[size > 0.0] / size[size > 0.0, None]
        chosen = psi[:, columns]
        rank = np.linalg.matrix_rank(chosen, tol=_ALIKE) if chosen.size else 0
        return columns if rank == len(psi) == len(columns) else []

    def _chains(self, h: int, loads: Sequence[int], most: int) -> list[Further]:
        """The columns v_1, v_2, ... by one parameter, of every load.

        Args:
            h: the parameter.
            loads: columns of the loads.
            most: how many at most.
        """
        found: list[Further] = []
        before, shift = list(loads), self._middle(h)
        while len(found) < ORDERS * len(loads) and len(found) + len(loads) <= most:
            start = len(self._scale) + len(found)
            found += [((h, column, shift),) for column in before]
            before = list(range(start, start + len(loads)))
        return found

    def _middle(self, h: int) -> float:
        """The middle of the eigenvalues of E_h against E, in the ground that there is most of."""
        volume: dict[str, float] = {}
        for zone in self._zones[-1]:
            own = float(self._points.volume[zone.points].sum())
            volume[zone.material] = volume.get(zone.material, 0.0) + own
        most = max(volume, key=lambda name: volume[name])
        slope = self._slope(most, h)
        if slope is None:
            return 0.0
        found = np.linalg.eigvals(np.linalg.solve(self._matrix(most), slope)).real
        return 0.5 * float(found.min() + found.max())

    def _with_further(self, number: int, u: Floats, run: Run) -> Floats:
        """Displacements (n_dofs, M) of all columns of a state; those that need others after them.

        Args:
            number: of the state.
            u: (n_dofs, 1 + n) of the state and its scaled derivatives.
            run: the march there.
        """
        factor = run.factors.find(self._march.sequence.states[number])
        system = self._march.systems[number]
        known, last = u.shape[1], len(self._scale) + len(self._further)
        while known < last:
            ready = self._further[known - len(self._scale) :]
            count = next(
                (k for k, parts in enumerate(ready) if any(c >= known for _, c, _ in parts)),
                len(ready),
            )
            found = np.zeros((len(u), count))
            if factor is not None:  # else nothing can move
                strains = self._known(number, u, slice(known, known + count))
                forces = self._points.forces(strains, system)
                dofs = system.pattern.dofs
                found[dofs] = -factor.solve(forces[dofs])
            u, known = np.hstack([u, found]), known + count
        return u

    def _known(self, number: int, u: Floats, which: slice) -> Floats:
        """What is in the bracket before a state's own displacements are (s, n_points, count).

        Args:
            number: of the state.
            u: (n_dofs, k) its columns so far.
            which: the columns that are to be found.
        """
        first = len(self._scale)
        parts_of = self._further[which.start - first : which.stop - first]
        needed = sorted({column for parts in parts_of for _, column, _ in parts})
        at = {column: place for place, column in enumerate(needed)}
        own = self._points.strain(u[:, needed])
        found = np.zeros((*own.shape[:2], len(parts_of)))
        for zone in self._zones[number]:
            mine = zone.points
            for state, material, sign in zone.parts:
                if state == 0:
                    continue
                if state == number:
                    eps = own[:, mine]
                else:
                    motion = self.snapshot.motion[state]
                    eps = self._points.strain(motion[:, needed], mine)
                    found[:, mine] += np.tensordot(
                        sign * self._matrix(material),
                        self._points.strain(motion[:, which], mine),
                        axes=1,
                    )
                for place, parts in enumerate(parts_of):
                    for one, column, shift in parts:
                        slope = self._slope(material, one, shift)
                        if slope is not None:
                            found[:, mine, place] += (sign * slope) @ eps[..., at[column]]
        return found

    def _matrix(self, material: str) -> Floats:
        """E (s, s)."""
        return self._spans[material].matrix(self._moduli[material])

    def _slope(self, material: str, h: int, shift: float = 0.0) -> Floats | None:
        """E_h - b E (s, s), h in its size; None where it is zero.

        Args:
            material: whose moduli.
            h: the parameter.
            shift: b.
        """
        slope = self._slopes[material][:, h] * self._scale[1 + h]
        slope = slope - shift * self._moduli[material]
        return self._spans[material].matrix(slope) if slope.any() else None

    def _seen(self, u: Floats) -> Floats:
        """What channels that read motions see of displacements (n_dofs, k), (n_channels, k)."""
        table = np.full((len(self._observation.channels), u.shape[1]), np.nan)
        for rows, observable in self._observation.parts:
            if observable.rows is not None:
                table[rows] = observable.rows @ u
        return table

    def _settled(self, virgin: Floats) -> Floats:
        """Strain (s, n_points, 1 + n) of the motion that balanced the virgin stress.

        Args:
            virgin: (s, n_points, 1 + n) at the end of the virgin state.
        """
        found = np.zeros_like(virgin)
        given, size = self._loads.stress @ self._psi, np.zeros(len(self._scale))
        for zone in self._zones[0]:
            span, mine = self._spans[zone.material], zone.points
            slopes = np.tensordot(self._slopes[zone.material], span.basis, axes=(0, 0))
            found[:, mine] = settling_strain(
                virgin[:, mine],
                given[:, mine],
                span.matrix(self._moduli[zone.material]),
                np.moveaxis(slopes, 0, -1),
            )
            stress = np.tensordot(span.matrix(self._moduli[zone.material]), found[:, mine], axes=1)
            size = np.maximum(size, np.abs(stress).max(axis=(0, 1), initial=0.0) * self._scale)
        found[..., size <= _NOISE * np.abs(virgin[..., 0]).max()] = 0.0
        return found
