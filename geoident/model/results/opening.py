"""What the closed form of a circular opening says beside its readings."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.results.columns import Record, column, derived


class GroundReaction(Record):
    """The ground around a circular opening: its reaction, and the stages on their way along it.

    Pressures and stresses are positive in compression, motions of the wall inwards, both as in
    ground that is pressed by the mean of the in-situ stress all round.

    Args:
        centre: (2,) of the opening, m.
        radius: of the opening, m.
        in_situ: (4,) stress xx, yy, zz, xy at the centre, Pa.
        critical: pressure inside below which the wall yields, Pa; NaN where it never does.
        pressure: (k,) pressures inside, from that of the ground down, Pa.
        displacement: (k,) of the wall under these, m.
        plastic_radius: (k,) how far the ground then yields, m; NaN where it is elastic.
        stages: names of the s stages with the opening.
        stage_pressure: (s,) pressure inside at each, Pa; NaN where there is no closed form.
        stage_displacement: (s,) of the wall at each, m.
        stage_plastic_radius: (s,) at each, m; NaN where it is elastic.
        supports: names of the supports, none where none ever stands.
        support_pressure: (p, s) of each on the wall at each stage, Pa; NaN where it does not stand;
            None where none ever stands.
        support_capacity: (p, s) what each can press with at each stage, Pa; infinite where it has
            no limit, NaN where it does not stand; None where none ever stands.
        radii: (m,) distances from the centre, m.
        radial: (s, m) radial stress at each stage there, Pa.
        hoop: (s, m) stress around the opening there, Pa.
    """

    centre: Floats = column("axis", dimension="length")
    radius: float
    in_situ: Floats = column("component", dimension="pressure")
    critical: float
    pressure: Floats = column("pressure", dimension="pressure", shown="MPa")
    displacement: Floats = column("pressure", dimension="length", sheet="wall_inwards", shown="mm")
    plastic_radius: Floats = column("pressure", dimension="length", shown="m")
    stages: tuple[str, ...] = column("stage", name="stage")
    stage_pressure: Floats = column("stage", title="pressure", dimension="pressure", shown="MPa")
    stage_displacement: Floats = column(
        "stage", title="displacement", dimension="length", sheet="wall_inwards", shown="mm"
    )
    stage_plastic_radius: Floats = column(
        "stage", title="plastic_radius", dimension="length", shown="m"
    )
    radii: Floats = column("radii", dimension="length", sheet="distance", shown="m")
    radial: Floats = column(
        "stage", "radii", dimension="pressure", sheet="radial_compression", shown="MPa"
    )
    hoop: Floats = column(
        "stage", "radii", dimension="pressure", sheet="hoop_compression", shown="MPa"
    )

    supports: tuple[str, ...] = column("support", default=(), name="support", optional=True)
    support_pressure: Floats | None = column(
        "support",
        "stage",
        default=None,
        sheet="pressure",
        dimension="pressure",
        shown="MPa",
        optional=True,
    )
    support_capacity: Floats | None = column(
        "support",
        "stage",
        default=None,
        sheet="capacity",
        dimension="pressure",
        shown="MPa",
        optional=True,
    )

    @property
    def standing(self) -> list[list[int]]:
        """Numbers of a support and of a stage at which it stands, for every pair of them."""
        if self.support_pressure is None:
            return []
        pairs: list[list[int]] = np.argwhere(np.isfinite(self.support_pressure)).tolist()
        return pairs

    @property
    @derived("component", name="component")
    def components(self) -> tuple[str, ...]:
        """Names of the components of the in-situ stress."""
        return ("xx", "yy", "zz", "xy")


class FaceAdvance(Record):
    """How a tunnel's wall moves as the face goes on, and what the stages of a case release.

    Args:
        law: name of the longitudinal displacement profile.
        radius: of the tunnel, m.
        distance: (k,) of the section behind the face, m, ascending.
        share: (k,) part of its final motion that the wall has made there.
        stages: names of the s stages that a distance speaks for.
        stage_distance: (s,) of each, m.
        stage_share: (s,) part of the final motion at each.
        stage_released: (s,) part of the stress that is released at each.
        stage_zero: (s,) whether gauges read zero at its end.
    """

    law: str = column(name="profile")
    radius: float
    distance: Floats = column("distance", dimension="length", shown="m")
    share: Floats = column("distance", sheet="share_of_motion")
    stages: tuple[str, ...] = column("stage", name="stage")
    stage_distance: Floats = column("stage", title="distance", dimension="length", shown="m")
    stage_share: Floats = column("stage", title="share", sheet="share_of_motion")
    stage_released: Floats = column("stage", title="released", sheet="released_stress")
    stage_zero: Bools = column("stage", title="zero", sheet="zero_of_gauges")

    @property
    def lost(self) -> float | None:
        """Part of the final motion that was over before the first gauges read zero, if any do."""
        known = self.stage_share[self.stage_zero]
        return float(known.min()) if len(known) else None
