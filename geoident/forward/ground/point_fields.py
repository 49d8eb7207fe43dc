"""Material constants that vary from strain point to strain point (theory 9).

At strain point q of its material a constant is

    c_q = mean exp(known_q + sum_k modes[q, k] xi_k)

with ``mean`` the number that the case gives the constant, a parameter or not, and the xi ordinary
parameters. So the derivatives are pointwise: dc_q / dxi_k = c_q modes[q, k].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.parameter import Values


@dataclass(frozen=True, eq=False)
class PointField:
    """One constant of a material as a field.

    Args:
        material: its name.
        constant: an elastic constant (``E``, ``G_np``, ``c11``) or a strength (``cohesion``).
        known: (q,) the part of the logarithm that no parameter changes, at the strain points of the
            material (`CaseOnMesh.material_points`).
        modes: (q, n_modes) Phi: what one unit of each mode adds to the logarithm.
        names: of the n_modes parameters xi.
    """

    material: str
    constant: str
    known: Floats
    modes: Floats
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.modes.shape != (len(self.known), len(self.names)):
            msg = f"modes {self.modes.shape} for {len(self.known)} points, {len(self.names)} names"
            raise ValueError(msg)

    def factor(self, values: Values) -> Floats:
        """By how much the constant differs from its mean at parameter values, (q,)."""
        xi = np.array([values[name] for name in self.names])
        return np.asarray(np.exp(self.known + self.modes @ xi))

    def same_variation(self, other: PointField) -> bool:
        """Whether two constants vary together, by the same factor."""
        return (
            self.names == other.names
            and np.array_equal(self.known, other.known)
            and np.array_equal(self.modes, other.modes)
        )
