"""Creep and ageing of the ground in stages that last."""
