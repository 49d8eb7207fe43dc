"""Channels of gauges that read stresses, strains, pressures and forces, put together in code."""

from __future__ import annotations

from typing import Any

from geoident.model.gauges import Channel, Reads

UNITS = {"stress": "pressure", "pressure-cell": "pressure", "piezometer": "pressure"}
ZERO_DIRECTION = {2: (0.0, 0.0), 3: (0.0, 0.0, 0.0)}


def gauge(
    kind: str, name: str, point: tuple[float, ...], quantity: str = "", **more: Any
) -> Channel:
    """A channel at a point; a value is read unless a zero is given."""
    dimension = more.pop("dimension", UNITS.get(kind, "strain"))
    reads = Reads.CHANGE if "zero" in more or kind == "strain" else Reads.VALUE
    settings = {
        "name": name, "gauge": name, "kind": kind, "first": None, "second": point,
        "direction": ZERO_DIRECTION[len(point)], "accuracy": 1e3, "zero": "virgin",
        "key": ("gauges", name), "dimension": dimension, "unit": "", "quantity": quantity,
        "reads": reads,
    }  # fmt: skip
    return Channel(**{**settings, **more})
