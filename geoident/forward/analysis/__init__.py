"""The analysis through the stages: equations, equilibrium and derivatives."""
