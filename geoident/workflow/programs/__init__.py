"""Models that are run: programs in folders, functions in processes, a log of all runs, trust."""
