"""Models that geoident does not compute itself: readings from runs, derivatives by differences."""
