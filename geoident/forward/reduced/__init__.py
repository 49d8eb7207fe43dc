"""The reduced model of a staged elastic analysis (theory 14).

Others ask for one by `geoident.forward.reducible` (from the analyses of a search, or around a point
for many answers), and read one that a result keeps by `kept` and `case_model`. It is made in one
direction: an analysis leaves a snapshot (`recorder`), moduli, loads and histories become sums
(`moduli`, `loads`, `zones`, joined in `affine_analysis`), snapshots are projected (`projection`) to
the model that is solved (`model`); `response` makes readings of it and estimates their errors.
"""
