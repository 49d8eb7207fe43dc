"""Stress of the virgin ground: its models, the weight above, surfaces, pressure of water."""
