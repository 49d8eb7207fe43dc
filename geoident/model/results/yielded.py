"""How far ground yields, stage by stage, and how it moves where it cannot carry the loads."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.mesh import Mesh
from geoident.model.results.columns import Record, column


class YieldedGround(Record):
    """Ground that yields in a state or did in those that it builds on, as far as it is there.

    Places are those of strain points, so distances are known to about half an element.

    Args:
        states: (k) names of the states, the virgin state first.
        volume: (k,) m2 in plane strain (m3 per metre), else m3, about an axis of the whole
            circumference.
        share: (k,) part of the ground that is there and can yield.
        reach: (k,) largest distance from the outline of what was excavated so far, m; NaN where
            nothing yields or nothing was excavated.
        radius: (k,) largest distance from the centre of that outline, m; NaN also where the
            outline is no circle.
        lower: (k, dim) least coordinates, m; NaN where nothing yields.
        upper: (k, dim) largest coordinates, m.
        unit: of the volume, ``m2`` or ``m3``.
    """

    states: tuple[str, ...] = column("state", name="state", title="stage")
    volume: Floats = column("state", unit="m3, or m2 in plane strain", shown="m3")
    share: Floats = column("state", unit="1")
    reach: Floats = column("state", title="from_excavation", dimension="length", shown="m")
    radius: Floats = column("state", title="from_centre", dimension="length", shown="m")
    lower: Floats = column("state", "axis", sheet="{axis}_min", dimension="length", shown="m")
    upper: Floats = column("state", "axis", sheet="{axis}_max", dimension="length", shown="m")
    unit: str = "m3"

    @property
    def most(self) -> int | None:
        """The state in which most has yielded; None where nothing does."""
        known = np.nan_to_num(self.volume)
        return int(known.argmax()) if known.any() else None


class Mechanism(Record, eq=False, repr=False):
    """The velocities with which ground moves under a load that it does not carry.

    Args:
        stage: name of the stage.
        state: number of its state; the virgin state is 0.
        fraction: part of the change of load of the stage that is carried; NaN where not known.
        mesh: the mesh.
        present: (n_elements,) what is there.
        velocity: (n_nodes, dim), the largest component 1.
        shear: (n_elements,) largest rate of shear in each element, in parts of the largest of all.
    """

    stage: str
    state: int
    fraction: float = column(name="carried")
    mesh: Mesh
    present: Bools = column("element")
    velocity: Floats = column("node", "component", unit="1")
    shear: Floats = column("element", unit="1")

    def __repr__(self) -> str:
        carried = f", {100.0 * self.fraction:.3g} % carried" if np.isfinite(self.fraction) else ""
        return f"Mechanism({self.stage!r}{carried}, {self.mesh.n_nodes} nodes)"
