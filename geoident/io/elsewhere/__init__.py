"""Files of programs that geoident runs: what is written for them, and what they leave."""
