"""Gauss-Newton in a trust region, condensation, and what they share."""
