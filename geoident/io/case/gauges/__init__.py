"""Gauges of a case: what each kind says, the channels that it has, and how accurate they are."""
