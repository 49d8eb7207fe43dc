"""Building blocks of the schema of case files: values, sections, and their faults in words."""
