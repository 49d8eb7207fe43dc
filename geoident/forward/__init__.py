"""Staged construction: the analysis through the stages, the gauges' readings, their derivatives."""
