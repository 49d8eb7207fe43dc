"""Takes the columns of a reduced model from a march while it runs, and adds second derivatives.

While the factorization of a stage is there, further columns cost a solution each. Where the moduli
depend on h, and the loads do not, the second derivative of the equations of a state by h and k is

    C^T V ( E C u_hk + E_h C u_k + E_k C u_h + E_hk C u ) = 0      (sums over segments understood)

so with the first derivatives, which are there, u_hk follows. The part E_hk, zero where moduli are
linear in h, is left out: what is in the bracket is a stress in equilibrium with no load all the
same, and the space that these columns add is what counts. With them the model of one march is right
to second order in the moduli, whatever the loads.
"""

from __future__ import annotations

import numpy as np

from geoident.forward.gauges.observation import Observation
from geoident.forward.march.lasting import solve_still
from geoident.forward.march.march import Run
from geoident.forward.march.stage import StageEnd
from geoident.forward.reduced.affine_march import AffineMarch
from geoident.forward.reduced.snapshots import Snapshot, settling_strain, stress_turns
from geoident.model.arrays import Floats

_NOISE = 1e-9
"""Stress of settling, relative to the virgin one, that is rounding."""

MOST_SECOND = 12
"""Second derivatives that are taken at most."""


class Recorder:
    """Records one march with derivatives.

    Args:
        affine: the march with the form of its moduli and loads.
        observation: the gauges.
        p: (n,) parameters of the march.
        second: whether second derivatives are added.
    """

    def __init__(
        self, affine: AffineMarch, observation: Observation, p: Floats, *, second: bool
    ) -> None:
        self._march, self._observation, self._zones = affine.march, observation, affine.zones
        self._spans, self._loads = affine.form.spans, affine.form.loads
        self._points = affine.points
        self._scale = np.concatenate([[1.0], self._loads.scale])
        at = affine.form.at(p[None])
        self._psi = np.hstack([at.loads[0][:, None], at.load_slopes[0]])
        self._moduli = {name: c[0] for name, c in at.moduli.items()}
        self._slopes = {name: dc[0] for name, dc in at.slopes.items()}
        self._pairs = self.second_pairs()[:MOST_SECOND] if second else []
        none = np.zeros((len(self._psi), len(self._pairs)))
        sized = {name: slope * self._loads.scale for name, slope in self._slopes.items()}
        turns = stress_turns(self._moduli, sized, self._pairs)
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
        if self._pairs:
            u = np.hstack([u, self._second(end.state, u, run)])
        kept.motion.append(u)
        kept.observed.append(self._seen(u))

    def second_pairs(self) -> list[tuple[int, int]]:
        """Pairs of parameters whose second derivatives are wanted: h moves moduli and no load.

        None where the virgin ground settles: its motion is not the march's.
        """
        if self._loads.settles:
            return []
        n = len(self._loads.scale)
        moves = [any(slope[:, h].any() for slope in self._slopes.values()) for h in range(n)]
        free = ~np.any(self._loads.exponents, axis=0)
        first = [h for h in range(n) if moves[h] and free[h]]
        return [(h, k) for h in first for k in range(n) if k not in first or k >= h]

    def _second(self, number: int, u: Floats, run: Run) -> Floats:
        """Displacements (n_dofs, pairs) of the second derivatives in a state.

        Args:
            number: of the state.
            u: (n_dofs, 1 + n) of the state and its scaled derivatives.
            run: the march there.
        """
        found = np.zeros((len(u), len(self._pairs)))
        factor = run.factors.find(self._march.sequence.states[number])
        if factor is None:  # nothing can move
            return found
        system = self._march.systems[number]
        dofs = system.pattern.dofs
        forces = self._points.forces(self._known(number, u), system)
        found[dofs] = -solve_still(factor, forces[dofs])
        return found

    def _known(self, number: int, u: Floats) -> Floats:
        """What is in the bracket before the state's own u_hk is known (s, n_points, pairs)."""
        count, columns = len(self._pairs), len(self._scale)
        own = self._points.strain(u)
        found = np.zeros((*own.shape[:2], count))
        for zone in self._zones[number]:
            mine = zone.points
            for state, material, sign in zone.parts:
                if state == 0:
                    continue
                if state == number:
                    eps = own[:, mine]
                else:
                    eps = self._points.strain(self.snapshot.motion[state], mine)
                    found[:, mine] += np.tensordot(
                        sign * self._matrix(material), eps[..., columns:], axes=1
                    )
                for place, (h, k) in enumerate(self._pairs):
                    for one, other in ((h, k), (k, h)):
                        slope = self._slope(material, one)
                        if slope is not None:
                            found[:, mine, place] += (sign * slope) @ eps[..., 1 + other]
        return found

    def _matrix(self, material: str) -> Floats:
        """E (s, s)."""
        return self._spans[material].matrix(self._moduli[material])

    def _slope(self, material: str, h: int) -> Floats | None:
        """Derivative (s, s) of E by a parameter in its size; None where there is none."""
        slope = self._slopes[material][:, h] * self._scale[1 + h]
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
