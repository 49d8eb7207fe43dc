"""The model: materials, stages, supports, loads, structures and gauges, before any result."""
