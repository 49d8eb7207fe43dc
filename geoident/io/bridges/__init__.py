"""Files of programs that drive geoident: PEST, PEST++ and pyEMU, and Dakota."""
