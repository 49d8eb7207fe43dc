"""A case of two gauges in a section of a tunnel, by the convergence law."""

STAGES = {
    "first": ("103 m", "2024-03-01"),
    "second": ("109 m", "2024-03-04"),
    "third": ("109 m", "2024-03-10"),
    "fourth": ("127 m", "2024-03-10"),
    "fifth": ("133 m", "2024-03-22"),
    "sixth": ("160 m", "2024-04-12"),
    "later": ("300 m", "2024-07-01"),
}
CASE = f"""\
format: geoident-case/1
model:
  kind: convergence-law
  face: {{{", ".join(f"{name}: {face}" for name, (face, _) in STAGES.items())}}}
  sections:
    A: {{chainage: 100 m, excavated: 2024-03-01}}
  C_inf: {{H: $C, V: 0.5 $C}}
  X: $X
  m: $m
  T: $T
  n: $n
parameters:
  C: {{start: 30 mm, bounds: [1 mm, 500 mm], scale: log}}
  X: {{start: 9 m, bounds: [1 m, 60 m], scale: log}}
  m: {{start: 1.6, bounds: [0, 10]}}
  T: {{start: 3 days, bounds: [0.1 days, 100 days], scale: log}}
  n: {{start: 0.5, bounds: [0.1, 1]}}
dates: {{{", ".join(f"{name}: {day}" for name, (_, day) in STAGES.items())}}}
gauges:
  H: {{kind: reading, accuracy: 0.1 mm, zero: first}}
  V: {{kind: reading, accuracy: 0.1 mm, zero: first}}
"""
TRUTH = (30e-3, 9.0, 1.6, 3 * 86400.0, 0.5)
FIXED = CASE.replace("n: $n", "n: 0.5").replace("  n: {start: 0.5, bounds: [0.1, 1]}\n", "")
READ = tuple(STAGES)[1:-1]


def write_law(folder, text=CASE, readings=None):
    """A case file, with readings in m by gauge and stage; its path."""
    path = folder / "case.yaml"
    if readings is not None:
        rows = [f"{gauge},{stage},{1e3 * v!r},mm" for (gauge, stage), v in readings.items()]
        (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
        text += "readings: readings.csv\n"
    path.write_text(text)
    return path
