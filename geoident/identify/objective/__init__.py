"""The discrepancy between readings and model, and the losses."""
