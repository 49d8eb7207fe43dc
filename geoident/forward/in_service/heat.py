"""Temperatures of a structure day by day, by thermal modes (theory 16.7).

With theta the temperatures of the air and, at some elevations, of the wetted faces, the nodes f
whose temperature is not given follow from

    M T_f' + H T_f = B0 theta(t) + B1 theta'(t)

B0 and B1 hold films, and the rows of H and M that tie f to nodes whose temperature is given.

T_f lies in the span of V, the answers (sigma M + H)^-1 (B0 + sigma B1) to some rates sigma from one
in twenty years to one in a day, at the start and with each parameter of heat half and twice as
large. It is enlarged until the answers to waves between these periods are those of the mesh, at all
these parameters. In the span

    T_f = V Phi x ,   x_k' = -mu_k x_k + (b0 theta + b1 theta')_k ,   Phi^T (V^T M V) Phi = I

with rates mu_k, so that a day in which theta is linear is exact:

    x(t + d) = E x(t) + P0 theta(t) + P1 theta(t + d)
    P0 = d (phi_1 - phi_2) b0 - phi_1 b1 ,   P1 = d phi_2 b0 + phi_1 b1
    E = phi_0 ,   phi_k of A d ,   A = -diag(mu)

Derivatives by conductivities, capacities and films are those of this recursion. With A' and b' in
the basis of the modes, which stays, the derivative of a function f of A has the divided differences
of f at the rates,  f(A)'_kl = f[a_k, a_l] A'_kl  (Daleckii & Krein), so it is exact as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geoident.fem.faces import FacetPatch, load_patches
from geoident.fem.heat import capacity_and_conduction, film
from geoident.fem.solvers import Solver
from geoident.fem.solvers.ordered import OrderedFactorization
from geoident.forward.heat.conduction import heat_capacity
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.in_service import DAY, YEAR, ReservoirFormula, Series, StructureInService
from geoident.model.mesh import nodes_in
from geoident.model.parameter import Scalar

STEP = DAY
"""Temperatures act as means of a day, s."""

_MOST_ELEVATIONS = 24
"""At which the temperature of wetted faces is given; linear between them."""

_SLOWEST, _FASTEST = 1.0 / (20.0 * YEAR), 1.0 / DAY
"""Rates that the span of temperatures has to answer, 1/s."""

_FIRST_RATES, _MOST_RATES = 10, 37

_WAVES = 7
"""Waves that are looked at."""

_TOLERANCE = 1e-3
"""Largest error of the answer to a wave, of the answer to a temperature that stays."""

_SEEN = 1e-5
"""Part of all temperatures below which a field is left out."""

_QUICKEST = 1e-13
"""Part of the longest time of a mode below which a shorter one is rounding."""

_KEPT = 1e-6
"""Size of a direction of the span, of a temperature that stays, below which it is left out."""

_WARM_UP = 3
"""Times that the first year acts before the beginning."""

_FORGOTTEN = 3.0
"""Lengths of a gap for which temperatures are not known after it."""


@dataclass(frozen=True)
class _Part:
    """A part of the equations and the number of the case with which it counts.

    Args:
        size: of the number, with derivatives.
        capacity: whether it belongs to M and B1; else to H and B0.
        matrix: (n, n) of M or H for the number one, or its part in the span.
        inputs: (n, m) of B1 or B0 for the number one, likewise.
    """

    size: Callable[[ParameterPoint], Dual]
    capacity: bool
    matrix: Any
    inputs: Floats


class HeatModel:
    """Temperatures of the ground that is there at one state.

    Args:
        on_mesh: the case on its mesh.
        service: what acts.
        state: number of the state.
        places: parameters at which the span holds; the first are those of the start.
        solver: factorizes.

    Attributes:
        elevations: (m - 1,) at which the temperatures of wetted faces are given, m, ascending.
        basis: (n_nodes, r) temperature fields of which those of all days are sums.
    """

    def __init__(
        self,
        on_mesh: CaseOnMesh,
        service: StructureInService,
        state: int,
        places: Sequence[ParameterPoint],
        solver: Solver,
    ) -> None:
        case, mesh, kinematics = on_mesh.case, on_mesh.mesh, on_mesh.kinematics
        sequence, up = on_mesh.sequence, on_mesh.mesh.points[:, -1]
        present, materials = sequence.present(state), sequence.states[state].materials
        self.service = service

        def faces(groups: Sequence[str]) -> list[FacetPatch]:
            patches = (load_patches(mesh, on_mesh.table, g, present) for g in groups)
            return [patch for some in patches for patch in some or ()]

        def nodes_of(groups: Sequence[str]) -> Ints:
            nodes = [patch.nodes.ravel() for patch in faces(groups)]
            return np.unique(np.concatenate(nodes)) if nodes else np.zeros(0, dtype=np.int64)

        wetted, in_air = nodes_of(service.wetted), nodes_of(service.in_air)
        self.elevations = _elevations(up[wetted])
        shares = np.zeros((mesh.n_nodes, 1 + len(self.elevations)))
        shares[in_air, 0] = 1.0
        shares[wetted] = 0.0
        shares[wetted, 1:] = _hats(self.elevations, up[wetted])
        given = np.zeros(mesh.n_nodes, dtype=np.bool_)
        given[nodes_of(service.constant)] = True
        given[in_air] |= service.film is None
        given[wetted] = True
        there = np.zeros(mesh.n_nodes, dtype=np.bool_)
        there[nodes_in(mesh.blocks, present)] = True
        self._free = there & ~given
        given_shares = np.where((given & there)[:, None], shares, 0.0)

        def part(size: Callable[[ParameterPoint], Dual], matrix: sp.csr_array, *,
                 capacity: bool = False, acting: Floats | None = None) -> _Part:  # fmt: skip
            rows = sp.csr_array(matrix[self._free])
            inputs = -(rows @ given_shares)
            if acting is not None:
                inputs += rows @ acting
            return _Part(size, capacity, sp.csr_array(rows[:, self._free]), inputs)

        self._mass = sp.csr_array((mesh.n_nodes, mesh.n_nodes))
        self._parts = list[_Part]()
        for name in sorted(set(materials.values())):
            groups = [g for g, material in materials.items() if material == name]
            M, H = capacity_and_conduction(mesh, kinematics, np.isin(sequence.group_of, groups))
            material = case.materials[name]
            assert material.conductivity is not None  # see the checks of `structure`
            conductivity = partial(_number, material.conductivity)
            self._parts.append(part(partial(heat_capacity, material), M, capacity=True))
            self._mass = self._mass + M
            self._parts.append(part(conductivity, H))
        if service.film is not None and service.in_air:
            F = film(mesh, kinematics, faces(service.in_air))
            acting = np.zeros_like(shares)
            acting[:, 0] = 1.0  # on all nodes of these faces, those of wetted ones among them
            self._parts.append(part(partial(_number, service.film), F, acting=acting))
        matrices = _on_one_pattern([one.matrix for one in self._parts])
        self._parts = [
            replace(one, matrix=matrix) for one, matrix in zip(self._parts, matrices, strict=True)
        ]
        self._pattern, self._points = matrices[0], mesh.points[self._free]
        V = self._span(places, solver)
        self._reduced = [
            replace(one, matrix=V.T @ (one.matrix @ V), inputs=V.T @ one.inputs)
            for one in self._parts
        ]
        self.basis = np.zeros((mesh.n_nodes, V.shape[1] + shares.shape[1]))
        self.basis[self._free, : V.shape[1]] = V
        self.basis[:, V.shape[1] :] = given_shares

    def _span(self, places: Sequence[ParameterPoint], solver: Solver) -> Floats:
        """V (n, r): answers to some rates, at as many places as need them."""
        M, H, B0, _ = self._equations(places[0])
        factors = OrderedFactorization(M, self._points, solver.analyse)
        acts = np.abs(B0).max(axis=0) > 0.0
        steady = factors.factorize(H)(B0[:, acts])
        size = np.sqrt(np.einsum("ij,ij->j", steady, M @ steady))
        V, metric = np.zeros((len(B0), 0)), M
        for place in places:
            M, H, B0, B1 = self._equations(place)
            B0, B1, number = B0[:, acts] / size, B1[:, acts] / size, _FIRST_RATES
            while number <= _MOST_RATES and _error(V, factors, M, H, B0, B1) > _TOLERANCE:
                rates = np.geomspace(_SLOWEST, _FASTEST, number)
                for rate in rates if number == _FIRST_RATES else rates[1::2]:  # between those
                    answers = factors.factorize(rate * M + H)(B0 + rate * B1)
                    V = np.hstack([V, _further(V, answers, metric)])
                number = 2 * number - 1
        return V

    def _equations(
        self, point: ParameterPoint
    ) -> tuple[sp.csr_array, sp.csr_array, Floats, Floats]:
        """M, H (n, n), B0 and B1 (n, m) at some parameters; M and H have one pattern."""
        M, H = (self._pattern * 0.0 for _ in range(2))
        B0, B1 = np.zeros((2, *self._parts[0].inputs.shape))
        for part in self._parts:
            size = float(part.size(point).value)
            matrix, inputs = (M, B1) if part.capacity else (H, B0)
            matrix.data += size * part.matrix.data
            inputs += size * part.inputs
        return M, H, B0, B1

    def inputs_at(self, times: Floats) -> Floats:
        """Theta (k, m): the air, and the wetted faces at their elevations, at times (k,), s."""
        service = self.service
        assert service.air is not None
        air = mean_of_day(service.air, times)
        theta = np.repeat(air[:, None], 1 + len(self.elevations), axis=1)
        if service.level is not None and len(self.elevations):
            level = mean_of_day(service.level, times)
            depth = level[:, None] - self.elevations
            if isinstance(service.water, ReservoirFormula):
                water = service.water.at(times, np.maximum(depth, 0.0))
            else:
                assert service.water is not None
                water = np.broadcast_to(mean_of_day(service.water, times)[:, None], depth.shape)
            theta[:, 1:] = np.where(depth >= 0.0, water, theta[:, 1:])
        return theta

    def days(self) -> Floats:
        """(k,) days on which all that acts is known, gaps aside, s."""
        series = self.service.series
        first = max(one.times[0] for one in series)
        last = min(one.times[-1] for one in series)
        return np.arange(np.floor(first / STEP), np.ceil(last / STEP) + 1.0) * STEP

    def known(self, times: Floats) -> Bools:
        """(k,) when temperatures are known: not within gaps, and not soon after."""
        known = np.ones(len(times), dtype=np.bool_)
        for series in (self.service.air, self.service.water):
            if isinstance(series, Series):
                known &= np.isfinite(series.at(times))
                for start, end in series.gaps:
                    known &= (times <= start) | (times > end + _FORGOTTEN * (end - start))
        return known

    def amplitudes(self, point: ParameterPoint, theta: Floats) -> Floats:
        """Of the directions V on days (k,) one after the other, (k, r, 1 + n).

        Args:
            point: the parameters.
            theta: (k, m) what acts on these days.
        """
        year = round(YEAR / STEP)
        first = theta[:year]
        before = np.tile(first, (_WARM_UP if len(theta) >= year else 0, 1))
        acting = np.concatenate([before, theta])
        M, H, B0, B1 = self._totals(point)
        times, modes = eigh(M[..., 0], H[..., 0])  # so the slow ones keep their digits
        times = np.maximum(times, _QUICKEST * times.max())
        rates, modes = 1.0 / times, modes / np.sqrt(times)
        a, mean = -rates, first.mean(axis=0)
        b0, b1 = modes.T @ B0[..., 0], modes.T @ B1[..., 0]
        x = np.zeros((len(acting), len(a), point.n_columns))
        start = b0 @ mean / rates
        E, late, early, whole = (f.value(a * STEP) for f in _STEPS)
        P0 = early[:, None] * b0 - whole[:, None] * b1
        P1 = late[:, None] * b0 + whole[:, None] * b1
        x[..., 0] = _recursion(E, start, acting[:-1] @ P0.T + acting[1:] @ P1.T)
        for h in range(1, point.n_columns):
            changes = M[..., h], H[..., h], B0[..., h], B1[..., h]
            if not any(change.any() for change in changes):
                continue
            dM, dH = (modes.T @ change @ modes for change in changes[:2])
            dA = dM * rates - dH
            db0, db1 = (modes.T @ d - dM @ b for d, b in zip(changes[2:], (b0, b1), strict=True))
            dE, dlate, dearly, dwhole = (_divided(f, a) * dA for f in _STEPS)
            dP0 = dearly @ b0 + early[:, None] * db0 - dwhole @ b1 - whole[:, None] * db1
            dP1 = dlate @ b0 + late[:, None] * db0 + dwhole @ b1 + whole[:, None] * db1
            forcing = x[:-1, :, 0] @ dE.T + acting[:-1] @ dP0.T + acting[1:] @ dP1.T
            x[..., h] = _recursion(E, (db0 @ mean + dA @ start) / rates, forcing)
        inner = np.einsum("jr,krh->kjh", modes, x[len(before) :], optimize=True)
        outer = np.zeros((*theta.shape, point.n_columns))
        outer[..., 0] = theta
        return np.concatenate([inner, outer], axis=1)

    def principal_fields(self, amplitudes: Sequence[Floats]) -> tuple[Floats, Floats]:
        """The few fields of which the temperatures of all days are sums.

        Args:
            amplitudes: (k, r) of the directions V on some days, at some parameters.

        Returns:
            Fields (n_nodes, s), and the matrix (s, r) from amplitudes of V to those of the fields:
            the best in the mean square over the body.
        """
        G = self.basis.T @ (self._mass @ self.basis)
        G[np.diag_indices_from(G)] += 1e-14 * G.trace()
        L = np.linalg.cholesky(G)
        rows = np.concatenate([q @ L for q in amplitudes])
        values, Z = np.linalg.eigh(rows.T @ rows)
        Z = Z[:, values > _SEEN**2 * values.sum()]
        return self.basis @ np.linalg.solve(L.T, Z), Z.T @ L.T

    def _totals(self, point: ParameterPoint) -> tuple[Floats, Floats, Floats, Floats]:
        """M, H (r, r, 1 + n), B0 and B1 (r, m, 1 + n) in the span, with derivatives."""
        r, m = self._reduced[0].inputs.shape
        M, H = np.zeros((2, r, r, point.n_columns))
        B0, B1 = np.zeros((2, r, m, point.n_columns))
        for part in self._reduced:
            size = part.size(point).columns
            matrix, inputs = (M, B1) if part.capacity else (H, B0)
            matrix += part.matrix[..., None] * size
            inputs += part.inputs[..., None] * size
        return M, H, B0, B1


def _number(scalar: Scalar, point: ParameterPoint) -> Dual:
    return point.number(scalar)


def _elevations(heights: Floats) -> Floats:
    """Elevations (m,), ascending, at which temperatures are given for nodes at some heights, m."""
    levels = np.unique(heights.round(6))
    if len(levels) > _MOST_ELEVATIONS:
        levels = np.linspace(levels[0], levels[-1], _MOST_ELEVATIONS)
    return levels


def _hats(elevations: Floats, heights: Floats) -> Floats:
    """(k, m) share of each of m elevations in a value at heights (k,), linear between them."""
    shares = np.zeros((len(heights), len(elevations)))
    for k, row in enumerate(np.eye(len(elevations))):
        shares[:, k] = np.interp(heights, elevations, row)
    return shares


def mean_of_day(series: Series, times: Floats) -> Floats:
    """Means of a day around times (k,), s; of a series with a value a day or less, its values."""
    t, v = series.times, series.values
    if np.median(np.diff(t)) >= 0.5 * STEP:
        return np.interp(times, t, v)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])

    def integral(at: Floats) -> Floats:
        k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        end = np.interp(at, t, v)
        return np.asarray(sums[k] + 0.5 * (v[k] + end) * (at - t[k]))

    low = np.clip(times - 0.5 * STEP, t[0], t[-1])
    high = np.clip(times + 0.5 * STEP, t[0], t[-1])
    width = np.maximum(high - low, 1.0)
    return np.where(high > low, (integral(high) - integral(low)) / width, np.interp(times, t, v))


def _on_one_pattern(matrices: Sequence[sp.csr_array]) -> list[sp.csr_array]:
    """Matrices (n, n) with the entries that any of them has, zeros stored."""

    def with_data(matrix: sp.csr_array, data: Any) -> sp.csr_array:
        return sp.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)

    ones = []
    for matrix in matrices:
        matrix.sum_duplicates()
        ones.append(with_data(matrix, np.ones(matrix.nnz)))
    pattern = sp.csr_array(sum(ones[1:], ones[0]))
    number = with_data(pattern, np.arange(1.0, pattern.nnz + 1.0))
    whole = []
    for matrix, one in zip(matrices, ones, strict=True):
        data = np.zeros(pattern.nnz)
        data[sp.csr_array(one * number).data.astype(np.int64) - 1] = matrix.data
        whole.append(with_data(pattern, data))
    return whole


def _further(V: Floats, columns: Floats, M: sp.csr_array) -> Floats:
    """Directions (n, r), orthonormal with M and to V, that with V span columns (n, k) nearly."""
    for _ in range(2):  # once leaves rounding
        columns = columns - V @ (V.T @ (M @ columns))
    values, vectors = np.linalg.eigh(columns.T @ (M @ columns))
    kept = values > _KEPT**2
    return np.asarray(columns @ (vectors[:, kept] / np.sqrt(values[kept])))


def _error(
    V: Floats,
    factors: OrderedFactorization,
    M: sp.csr_array,
    H: sp.csr_array,
    B0: Floats,
    B1: Floats,
) -> float:
    """Largest error in the span of the answers to waves.

    Of B so that the steady answers are of size one. A residual r at the frequency w stands for the
    error (i w M + H)^-1 r. With w M in place of i w M it is no larger, and at least 0.7 of it.
    """
    if not V.shape[1]:
        return np.inf
    MV, HV = M @ V, H @ V
    times, modes = eigh(V.T @ MV, V.T @ HV)
    worst = 0.0
    for wave in np.geomspace(1.4 * _SLOWEST, 0.7 * _FASTEST, _WAVES):
        y = modes.T @ (V.T @ B0) + 1j * wave * (modes.T @ (V.T @ B1))
        y /= 1.0 + 1j * wave * times[:, None]
        real, imaginary = modes @ y.real, modes @ y.imag
        residual = np.hstack(
            [
                B0 - HV @ real + wave * (MV @ imaginary),
                wave * (B1 - MV @ real) - HV @ imaginary,
            ]
        )
        error = factors.factorize(wave * M + H)(residual)
        squares = np.einsum("ij,ij->j", error, M @ error)
        worst = max(worst, float(np.sqrt(2.0 * squares.reshape(2, -1).sum(axis=0).max())))
    return worst


def _recursion(factor: Floats, start: Floats, forcing: Floats) -> Floats:
    """(k + 1, r) of x -> factor x + forcing (k, r) from a start (r,)."""
    x = np.empty((len(forcing) + 1, len(start)))
    x[0] = start
    for k, row in enumerate(forcing):
        x[k + 1] = factor * x[k] + row
    return x


def _phi(k: int, z: Floats) -> Floats:
    """phi_k of z (...): phi_0 = exp, phi_k = (phi_k-1 - 1/(k-1)!) / z."""
    small = np.abs(z) < 0.5
    series = np.zeros_like(z)
    for j in range(16, -1, -1):  # sum z^j / (j + k)!
        series = 1.0 / _FACTORIAL[j + k] + z * series
    safe = np.where(small, -1.0, z)
    direct = np.exp(safe)
    for order in range(k):
        direct = (direct - 1.0 / _FACTORIAL[order]) / safe
    return np.where(small, series, direct)


_FACTORIAL = np.cumprod(np.concatenate([[1.0], np.arange(1.0, 30.0)]))


@dataclass(frozen=True)
class _Step:
    """A function of a rate a over a step of time.

    Args:
        value: of z = a d.
        slope: its derivative by a.
    """

    value: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]


# derivatives: phi_k' = phi_k - k phi_k+1
_STEPS = (
    _Step(lambda z: _phi(0, z), lambda z: STEP * _phi(0, z)),
    _Step(lambda z: STEP * _phi(2, z), lambda z: STEP**2 * (_phi(2, z) - 2.0 * _phi(3, z))),
    _Step(
        lambda z: STEP * (_phi(1, z) - _phi(2, z)),
        lambda z: STEP**2 * (_phi(1, z) - 2.0 * _phi(2, z) + 2.0 * _phi(3, z)),
    ),
    _Step(lambda z: _phi(1, z), lambda z: STEP * (_phi(1, z) - _phi(2, z))),
)
"""phi_0, d phi_2, d (phi_1 - phi_2) and phi_1."""

_NEAR = 1e-4
"""Relative difference of two rates below which a divided difference is a derivative."""


def _divided(f: _Step, a: Floats) -> Floats:
    """Divided differences f[a_k, a_l] (r, r)."""
    value, gap = f.value(a * STEP), a[:, None] - a[None, :]
    middle = 0.5 * (a[:, None] + a[None, :])
    near = np.abs(gap) <= _NEAR * (np.abs(middle) + 1.0 / STEP)
    quotient = (value[:, None] - value[None, :]) / np.where(near, 1.0, gap)
    return np.where(near, f.slope(middle * STEP), quotient)
