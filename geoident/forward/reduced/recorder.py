"""What an analysis leaves for the reduced model: its states, their derivatives, further columns.

States and derivatives come out of an analysis with derivatives as they are, each derivative by its
parameter in units of the parameter's size. Neither stresses nor strains of displacements are kept:
in space they are fifteen times as many numbers as the displacements. With E = sum_r c_r(p) J_r the
stresses of a material are J_r eps T_r, summed, with T_r made of c_r and its derivatives:
sigma_h = E C u_h + E_h C u. The motion that balances the virgin stress is forgotten by the analysis
(theory 2); its strain is what brought the stress from the given one to where it is.

While the factorization of a stage is there, further columns cost a solution each. With v the
displacements of a load, and h the parameters that move moduli,

    C^T V ( E C w + (E_h - b_h E) C v ) = 0

makes a column w of v and h, and further ones of w and every h: products of K^-1 K_h with v, the
space of conjugate gradients for other moduli, preconditioned by the factor that is there (Saad,
Iterative methods for sparse linear systems, 2003, 6.7). What is in the bracket is a stress in
equilibrium with no load, as the estimate of the error needs it. Second derivatives are there,
too, so the model of one analysis is right to second order in the moduli. The shift b_h changes
nothing in the space, and keeps columns from growing and from being alike: b_h E is as near to E_h
as it can be, in the mean over the volume. Where it is the same as E_h (all moduli grow alike, which
divides displacements by a number), no column is needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from geoident.forward.analysis.analysis import AnalysisRun
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.gauges.observation import PlacedGauges
from geoident.forward.reduced.affine_analysis import AffineAnalysis
from geoident.model.arrays import Floats

MOST_FURTHER = 16
"""Further columns of an analysis at most: more of them cost more to project than they save."""

_ALIKE = 1e-9
"""Part by which derivatives may miss being in proportion, from rounding."""


@dataclass(frozen=True)
class FurtherColumn:
    """(E_h - b E) C v is the stress that a further column balances.

    Args:
        parameter: h.
        column: of v.
        shift: b, h in its size.
    """

    parameter: int
    column: int
    shift: float


@dataclass(eq=False)
class Snapshot:
    """States 0 .. J of one analysis, M columns each.

    Args:
        p: (n,) parameters, SI.
        psi: (r, M) coordinates of the loads of the columns.
        turns: material to T, (r_m, M, M), which makes the columns of its stress of those of strain.
        motion: of every state, its displacements, (n_dofs, M); none of the virgin state.
        settled: (s, n_points, M) strain of the motion that balanced the virgin stress; None: of
            none.
        observed: of every state, what the channels see of the displacements, (n_channels, M).
    """

    p: Floats
    psi: Floats
    turns: Mapping[str, Floats]
    motion: list[Floats] = field(default_factory=list)
    settled: Floats | None = None
    observed: list[Floats] = field(default_factory=list)

    @property
    def columns(self) -> int:
        """Number M."""
        return int(self.psi.shape[1])

    @property
    def last(self) -> int:
        """The last state."""
        return len(self.motion) - 1


class Recorder:
    """Records one analysis with derivatives.

    Args:
        affine: the analysis with the form of its moduli and loads.
        gauges: those of the case, on its mesh.
        p: (n,) parameters of the analysis.
        further: how many columns are added at most.
    """

    def __init__(
        self, affine: AffineAnalysis, gauges: PlacedGauges, p: Floats, *, further: int
    ) -> None:
        self._affine, self._gauges = affine, gauges
        self._spans, self._loads, self._points = affine.form.spans, affine.form.loads, affine.points
        self._scale = np.concatenate([[1.0], self._loads.scale])
        at = affine.form.at(p[None])
        self._psi = np.hstack([at.loads[0][:, None], at.load_slopes[0]]) * self._scale
        self._moduli = {name: c[0] for name, c in at.moduli.items()}
        self._slopes = {name: dc[0] * self._loads.scale for name, dc in at.slopes.items()}
        self._further = [] if self._loads.settles else self._chosen(further)
        none = np.zeros((len(self._psi), len(self._further)))
        self.snapshot = Snapshot(p.copy(), np.hstack([self._psi, none]), self._turns())

    def add(self, end: StageEnd, run: AnalysisRun) -> None:
        """Record a state.

        Args:
            end: the state.
            run: the analysis, at this state.
        """
        kept = self.snapshot
        if end.number == 0:
            if self._loads.settles:
                kept.settled = self._settled(self._points.joined(end.stress, end.members))
            kept.motion.append(np.zeros((0, kept.columns)))
            kept.observed.append(np.zeros((len(self._gauges.channels), kept.columns)))
            return
        u = end.u * self._scale
        if self._further:
            u = self._with_further(end.number, u, run)
        seen = np.full((len(self._gauges.channels), u.shape[1]), np.nan)
        for rows, observable in self._gauges.parts:
            if observable.rows is not None:
                seen[rows] = observable.rows @ u
        kept.motion.append(u)
        kept.observed.append(seen)

    def _turns(self) -> dict[str, Floats]:
        """Material to T (r, M, M): for a state, its derivatives, and further columns."""
        n, turns = len(self._loads.scale), {}
        for name, c in self._moduli.items():
            slopes = self._slopes[name]
            T = np.einsum("r,ij->rij", c, np.eye(1 + n + len(self._further)))
            T[:, 0, 1 : 1 + n] += slopes
            for place, one in enumerate(self._further, start=1 + n):
                T[:, one.column, place] += slopes[:, one.parameter] - one.shift * c
            turns[name] = T
        return turns

    def _chosen(self, most: int) -> list[FurtherColumn]:
        """Of what further columns are made, each of one before it: all of one order, then the next.

        They begin with the displacements of each load that a parameter moves alone, and with those
        of all loads together unless these are sums of the others.

        Args:
            most: how many at most.
        """
        n = len(self._loads.scale)
        moves = [any(slope[:, h].any() for slope in self._slopes.values()) for h in range(n)]
        shifts = {h: b for h in range(n) if moves[h] and (b := self._shift(h)) is not None}
        if self._psi.size == 0 or not shifts:
            return []
        before = [1 + k for k in range(n) if not moves[k] and self._psi[:, 1 + k].any()]
        size = np.abs(self._psi).max(axis=1, keepdims=True)
        psi = self._psi / np.where(size > 0.0, size, 1.0)
        left = psi[:, 0] - psi[:, before] @ np.linalg.lstsq(psi[:, before], psi[:, 0])[0]
        if np.abs(left).max() > _ALIKE:
            before.insert(0, 0)
        chosen: list[FurtherColumn] = []
        while True:
            first = 1 + n + len(chosen)
            for column in before:
                for h, b in shifts.items():
                    if len(chosen) == most:
                        return chosen
                    chosen.append(FurtherColumn(h, column, b))
            before = list(range(first, 1 + n + len(chosen)))

    def _shift(self, h: int) -> float | None:
        """B, for which the integral of |E_h - b E|^2 is least; None where nothing is left."""
        volume: dict[str, float] = {}
        for zone in self._affine.zones[-1]:
            if zone.material in self._spans:
                own = float(self._points.volume[zone.points].sum())
                volume[zone.material] = volume.get(zone.material, 0.0) + own
        product = sum(V * self._moduli[m] @ self._slopes[m][:, h] for m, V in volume.items())
        square = sum(V * self._moduli[m] @ self._moduli[m] for m, V in volume.items())
        b = float(product / square)
        left = max(np.abs(s[:, h] - b * self._moduli[m]).max() for m, s in self._slopes.items())
        largest = max(np.abs(s[:, h]).max() for s in self._slopes.values())
        return b if left > _ALIKE * largest else None

    def _with_further(self, number: int, u: Floats, run: AnalysisRun) -> Floats:
        """Displacements (n_dofs, M) of all columns of a state, those that need others after them.

        Args:
            number: of the state.
            u: (n_dofs, 1 + n) of the state and its scaled derivatives.
            run: the analysis there.
        """
        factor = run.factors.find(self._affine.analysis.sequence.states[number])
        system, first = self._affine.analysis.systems[number], u.shape[1]
        while u.shape[1] < first + len(self._further):
            known = u.shape[1]
            ready = self._further[known - first :]
            waits = (k for k, one in enumerate(ready) if one.column >= known)
            ready = ready[: next(waits, len(ready))]
            w = np.zeros((len(u), len(ready)))
            if factor is not None:  # else nothing can move
                stress = self._unbalanced(number, u, ready, slice(known, known + len(ready)))
                dofs = system.pattern.dofs
                w[dofs] = -factor.solve(self._points.forces(stress, system)[dofs])
            u = np.hstack([u, w])
        return u

    def _unbalanced(
        self, number: int, u: Floats, ready: list[FurtherColumn], which: slice
    ) -> Floats:
        """Stresses (s, n_points, count) that columns of a state have to balance.

        Args:
            number: of the state.
            u: (n_dofs, k) its columns so far.
            ready: the columns that are to be found.
            which: their places.
        """
        needed = [one.column for one in ready]
        own = self._points.strain(u[:, needed])
        stress = np.zeros_like(own)
        for zone in self._affine.zones[number]:
            for state, material, sign in zone.parts:
                if state == 0:
                    continue
                strain = own[:, zone.points]
                E = self._spans[material].matrix(self._moduli[material])
                if state != number:
                    motion = self.snapshot.motion[state]
                    strain = self._points.strain(motion[:, needed], zone.points)
                    earlier = self._points.strain(motion[:, which], zone.points)
                    stress[:, zone.points] += sign * np.tensordot(E, earlier, axes=1)
                for place, one in enumerate(ready):
                    slope = self._slopes[material][:, one.parameter]
                    turned = slope - one.shift * self._moduli[material]
                    if turned.any():
                        E_h = self._spans[material].matrix(sign * turned)
                        stress[:, zone.points, place] += E_h @ strain[..., place]
        return stress

    def _settled(self, virgin: Floats) -> Floats:
        """Strain (s, n_points, 1 + n) of the motion that balanced the virgin stress.

        From sigma = given + E eps: d eps = E^-1 (d sigma - d given - dE eps).

        Args:
            virgin: (s, n_points, 1 + n) stress at the end of the virgin state.
        """
        virgin = virgin * self._scale
        settled, size = np.zeros_like(virgin), np.zeros(len(self._scale))
        load_stress = self._loads.stress @ self._psi
        for zone in self._affine.zones[0]:
            span, points = self._spans[zone.material], zone.points
            E = span.matrix(self._moduli[zone.material])
            change = virgin[:, points] - load_stress[:, points]
            strain = np.linalg.solve(E, change[..., 0])
            for h, slope in enumerate(self._slopes[zone.material].T, start=1):
                change[..., h] -= span.matrix(slope) @ strain
            settled[:, points] = np.tensordot(np.linalg.inv(E), change, axes=1)
            stress = np.tensordot(E, settled[:, points], axes=1)
            size = np.maximum(size, np.abs(stress).max(axis=(0, 1), initial=0.0))
        noise = 1e-9 * np.abs(virgin[..., 0]).max()  # rounding of the virgin stress
        settled[..., size <= noise] = 0.0
        return settled
