"""geoident identifies the material parameters of ground models from gauge readings."""

__version__ = "0.1.0"
