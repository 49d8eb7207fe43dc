"""The march through the stages: equations, equilibrium and derivatives."""
