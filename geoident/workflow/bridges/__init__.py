"""geoident as the model of other programs: what they are given, and what they ask."""
