"""Clusters of dask: a section of a campaign, or a file of its own."""
