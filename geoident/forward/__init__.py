"""Staged construction: the march through the stages, the gauges' readings, their derivatives."""
