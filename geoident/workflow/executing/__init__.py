"""Independent evaluations, in processes that may die."""
