"""The JSON schema of case files, and its faults in words."""
