"""How good models are: trials on later readings, models compared, models in a ladder."""
