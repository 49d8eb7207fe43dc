"""Files of models elsewhere: what is written for programs, what they leave, tables of runs."""
