"""The gallery: every shipped case with what it is, its commands, its answer and two pictures.

Pictures and numbers come from results in ``build/results/NAME/case.fit.h5``; what is not there is
fitted first (all of them take about an hour). ``GEOIDENT_RESULTS`` names another folder.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import yaml
from click.testing import CliRunner

from geoident.cli.app import geoident
from geoident.io.docs.templates import TEMPLATES
from geoident.io.result.file import read_result
from geoident.model.results.result import Result
from geoident.report.drawing.album import album
from geoident.report.drawing.style import Picture, image
from geoident.report.text.parameters import parameter_table
from manual.pages import DOCS
from manual.transcript import small

ROOT = DOCS.parents[1]
FOLDER = DOCS / "gallery"
OF_README = "cavern-overview.png"
WANTED = ("model", "overview", "curves-1", "in-service-1")
WIDTH = 900  # px
MOST = 60_000  # bytes of a picture

HEAD = """\
# Gallery

The cases that come with geoident: those in the folder `cases` of the repository, and those that
`geoident init` writes. All readings are synthetic. They were computed on a finer mesh than that of
the case (of higher order where the case has linear elements), tests of soil by another law, with
noise of the stated accuracy. So no case is fitted with the model that made its readings. In some
cases the ground behind the readings is also of another kind; the text says so. The true
parameters are in `truth.yaml` of a case, and in the last column here.

Signs, axes and units: [conventions](conventions.md). The commands: [commands](commands.md). The
notebook `cases/notebook.py` shows the Python interface.
"""


@dataclass(frozen=True)
class Shown:
    """A case of the gallery.

    Attributes:
        name: of its folder.
        case: its file.
        template: whether ``init`` writes it.
    """

    name: str
    case: Path
    template: bool

    @property
    def title(self) -> str:
        """That of the case."""
        found = re.search(r"^title: (.+)$", self.text, re.MULTILINE)
        assert found is not None
        return found[1].strip("\"'")

    @property
    def where(self) -> str:
        """Where it is found."""
        return "a template of `geoident init`" if self.template else f"`cases/{self.name}`"

    @property
    def text(self) -> str:
        """Its file."""
        return self.case.read_text(encoding="utf-8")

    @property
    def about(self) -> str:
        """The paragraphs at its top."""
        lines = self.text.partition("\nformat:")[0].splitlines()
        words = [line.lstrip("#").strip() for line in lines if "yaml-language-server" not in line]
        paragraphs = re.split(r"\n{2,}", "\n".join(words).strip())
        unwanted = ("Run:", "Check:", "Every quantity")
        return "\n\n".join(p for p in paragraphs if not p.startswith(unwanted))

    @property
    def commands(self) -> list[str]:
        """What to type."""
        if self.template:
            start = f"geoident init {self.name} --template {self.name}"
            return [
                start,
                f"geoident fit {self.name}/case.yaml",
                f"geoident report {self.name}/case.fit.h5",
            ]
        place = f"cases/{self.name}/case"
        asked = " --trust" if "\n  kind: external" in self.text else ""
        return [
            f"geoident check {place}.yaml",
            f"geoident fit {place}.yaml{asked}",
            f"geoident report {place}.fit.h5",
        ]

    @property
    def truth(self) -> dict[str, str]:
        """Parameters behind the readings, as written."""
        path = self.case.with_name("truth.yaml")
        if not path.exists():
            return {}
        read = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
        return {str(name): str(value) for name, value in read.items()}


def shown() -> list[Shown]:
    """All cases, then all templates."""
    cases = sorted((ROOT / "cases").glob("*/case.yaml"))
    given = [Shown(case.parent.name, case, template=False) for case in cases]
    folder = DOCS.parent / "templates"
    return given + [Shown(name, folder / name / "case.yaml", template=True) for name in TEMPLATES]


def write() -> None:
    """Make the page and its pictures."""
    parts = [HEAD, *(renewed(one) for one in shown())]
    (DOCS / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


def write_one(one: Shown) -> None:
    """Make the pictures of one case, and its part of the page that is there."""
    page = DOCS / "gallery.md"
    head, *parts = re.split(r"(?m)^(?=## )", page.read_text(encoding="utf-8"))
    start = f"## {one.title}\n\n*{one.where}*\n"
    there = [k for k, part in enumerate(parts) if part.startswith(start)]
    if not there:  # a new case: before the one that comes after it
        after = [other.title for other in shown()]
        after = after[after.index(one.title) + 1 :]
        there = [k for k, part in enumerate(parts) if part[3:].split("\n")[0] in after][:1]
        parts.insert(there[0], "")
    number = there[0]
    last = number == len(parts) - 1
    parts[number] = renewed(one) + ("" if last else "\n")
    page.write_text("".join([head, *parts]), encoding="utf-8")


def renewed(one: Shown) -> str:
    """Make the pictures of a case; its part of the page."""
    FOLDER.mkdir(exist_ok=True)
    result = _result(one)
    pictures = [p for p in album(result).all if p.name in WANTED]
    for picture in pictures:
        (FOLDER / file_name(one, picture.name)).write_bytes(_light(image(picture, "png")))
        if file_name(one, picture.name) == OF_README:
            (DOCS / "cavern.png").write_bytes(small(image(picture, "png")))
    return _part(one, result, pictures)


def _light(picture: bytes) -> bytes:
    """A picture of at most `MOST` bytes, with fewer colours and points where it must."""
    for width, colours in ((WIDTH, 64), (WIDTH, 32), (800, 24), (700, 16)):
        made = small(picture, width=width, colours=colours)
        if len(made) < MOST:
            break
    return made


def part_name(one: Shown) -> str:
    """What is named to renew one case: ``gallery/dam``, ``gallery/template-dam``."""
    return f"gallery/{'template-' if one.template else ''}{one.name}"


def file_name(one: Shown, picture: str) -> str:
    """Of a picture; a template may have the name of a case."""
    return f"{'template-' if one.template else ''}{one.name}-{picture}.png"


def _result(one: Shown) -> Result:
    folder = Path(os.environ.get("GEOIDENT_RESULTS", ROOT / "build" / "results"))
    both = one.template and (ROOT / "cases" / one.name).is_dir()
    path = folder / (f"template-{one.name}" if both else one.name) / "case.fit.h5"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        done = CliRunner().invoke(geoident, ["fit", str(one.case), "-o", str(path), "--trust"])
        if not path.exists():
            raise RuntimeError(done.output)
    return read_result(path)


def _part(one: Shown, result: Result, pictures: list[Picture]) -> str:
    lines = [f"## {one.title}", "", f"*{one.where}*", "", one.about, ""]
    lines += ["```sh", *one.commands, "```", ""]
    for picture in pictures:
        lines += [f"![{one.title}: {picture.title}](gallery/{file_name(one, picture.name)})", ""]
    table = parameter_table(result.parameters)
    head, rows = list(table.header), [list(row) for row in table.rows]
    if rows and len(rows) <= 12:
        keep = [
            head.index(name) for name in ("parameter", "unit", "value", "95 % interval", "prior")
        ]
        extra = ["behind the readings"] if one.truth else []
        lines += [f"| {' | '.join([*(head[k] for k in keep), *extra])} |"]
        lines += ["|" + "---|" * (len(keep) + len(extra))]
        for row in rows:
            behind = [one.truth.get(row[0], "")] if one.truth else []
            lines.append(f"| {' | '.join([*(row[k] for k in keep), *behind])} |")
        lines.append("")
    return "\n".join(lines)
