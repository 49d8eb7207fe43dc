"""Closed forms of a deep circular opening, and the cases that have one."""
