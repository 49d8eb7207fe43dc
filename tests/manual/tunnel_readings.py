"""Makes the workbook of the tutorial of the tunnel: the truth on a finer mesh, plus noise.

The clay of the truth is stronger at depth, which the model of the tutorial does not know. Run:
sh tests/manual/renew tutorials/tunnel/readings tutorials/tunnel
"""

from __future__ import annotations

import tempfile
from datetime import date
from pathlib import Path

from openpyxl import Workbook
from openpyxl.styles import Font

from geoident.workflow.simulate import simulate, with_noise
from manual.pages import DOCS, read_page
from manual.transcript import run_command

TRUTH = {
    "readings": "[]",
    "parameters.E_clay.start": "60 MPa",
    "parameters.ahead.start": "0.45",
    "materials.clay.yield": "{type: mohr-coulomb, cohesion: 75 kPa, friction: 5 deg}",
}
SEED = 3

# when it was read, of which stage (of the zero: none), and what the surveyor noted
DAYS = {
    date(2025, 3, 3): ("", "zero reading"),
    date(2025, 3, 20): ("A face", "face at the section"),
    date(2025, 3, 28): ("A lined", ""),
    date(2025, 5, 6): ("B face", ""),
    date(2025, 5, 15): ("B lined", ""),
    date(2025, 5, 19): ("B lined", "rain"),
}
HEIGHTS = {  # of the bolts at the zero, m
    "S1": 34.5127, "S2": 34.3980, "S3": 34.3551, "S4": 34.3264,
    "B1": 34.9513, "B2": 34.9388, "B3": 34.9412, "S5": 34.2905,
}  # fmt: skip


def main() -> None:
    """Write ``tutorials/tunnel/monitoring.xlsx``."""
    page = read_page(DOCS / "tutorials" / "tunnel.md")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in page.files.items():
            (folder / file).write_text(text, encoding="utf-8")
        run_command("gmsh -2 tunnel.geo -order 2 -setnumber size 0.6 -o fine.msh", folder)
        changes = {**TRUTH, "mesh.file": str(folder / "fine.msh")}
        truth = simulate(
            str(folder / "case.yaml"), overrides=[f"{k}={v}" for k, v in changes.items()]
        )
    exact = {(reading.channel, reading.stage): reading for reading in truth.readings}
    read = [
        (day, exact[key]) for day, (stage, _) in DAYS.items() for key in exact if key[1] == stage
    ]
    noisy = with_noise(truth.case, [reading for _, reading in read], seed=SEED)
    values = {
        (day, reading.channel): reading.value or 0.0
        for (day, _), reading in zip(read, noisy, strict=True)
    }

    book = Workbook()
    depths = [c.name for c in truth.case.channels if c.name.startswith("I.")]
    levels = book.active or book.create_sheet()
    levels.title = "Levelling"
    _table(
        levels,
        "Levelling, Mill Street 12 to 18: heights in m",
        ["Date", *HEIGHTS, "Remarks"],
        [
            [
                day,
                *(round(h - values.get((day, f"L.{p}"), 0.0), 4) for p, h in HEIGHTS.items()),
                note,
            ]
            for day, (_, note) in DAYS.items()
        ],
    )
    _table(
        book.create_sheet("Inclinometer"),
        "Inclinometer I, motion towards B in mm",
        ["Date", *(f"{name.removeprefix('I.A')} m" for name in depths)],
        [[day, *(round(1e3 * values.get((day, n), 0.0), 2) for n in depths)] for day in DAYS],
    )
    book.save(page.folder / "monitoring.xlsx")


def _table(sheet, title, header, rows) -> None:
    sheet.append([title])
    sheet["A1"].font = Font(bold=True)
    sheet.append([])
    for line in (header, *rows):
        sheet.append(list(line))
    sheet.column_dimensions["A"].width = 12
    for cells in sheet.iter_rows(min_row=4, max_col=1):
        cells[0].number_format = "DD/MM/YYYY"
