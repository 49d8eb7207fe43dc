"""Running a page: its files are written into a folder, its commands are run there.

Commands run inside this process, as the tests do: ``geoident`` by click's runner, ``gmsh`` through
its Python interface with the words of its command line.
"""

from __future__ import annotations

import argparse
import io
import shlex
import shutil
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

from click.testing import CliRunner
from PIL import Image

from geoident.cli.app import geoident
from geoident.io.result.file import read_result
from geoident.report.drawing.album import album
from geoident.report.drawing.style import Picture, image
from manual.pages import Command, File, Page, cut, difference, read_page

PICTURES = {".png", ".svg"}
COLOURS = 64  # of pictures in a page
WIDTH = 1200  # px


@dataclass(frozen=True)
class AnalysisRun:
    """What happened.

    Attributes:
        folder: where it ran.
        outputs: of the commands that were run, as on a screen.
        codes: their exit codes.
        long: those that take long were run, too.
    """

    folder: Path
    outputs: tuple[str, ...]
    codes: tuple[int, ...]
    long: bool = True


def run_page(page: Page, folder: Path, *, long: bool = True) -> AnalysisRun:
    """Write the files of a page and run its commands in their order, in an empty folder.

    Args:
        page: the page.
        folder: the folder.
        long: also those that take long.
    """
    for file in (*_files_before(page), *given_files(page)):
        if file.suffix not in PICTURES:
            shutil.copy(file, folder / file.name)
    outputs, codes = [], []
    for step in page.steps:
        if isinstance(step, File):
            with (folder / step.name).open("a" if step.added else "w", encoding="utf-8") as file:
                file.write(step.text)
        elif long or not step.long:
            output, code = run_command(step.line, folder)
            outputs.append(output)
            codes.append(code)
    return AnalysisRun(folder, tuple(outputs), tuple(codes), long)


def _files_before(page: Page) -> list[Path]:
    """The files of the page or folder that a page begins with."""
    if page.like is None:
        return []
    folder = page.like if page.like.is_dir() else read_page(page.like).folder
    return sorted(file for file in folder.iterdir() if file.is_file())


def given_files(page: Page) -> list[Path]:
    """The files of a page that it does not show."""
    there = page.folder.iterdir() if page.folder.is_dir() else ()
    return sorted(f for f in there if f.suffix not in PICTURES and f.name not in page.files)


def run_command(line: str, folder: Path) -> tuple[str, int]:
    """Output and exit code of a line that is typed in a folder.

    Raises:
        ValueError: it is no command of a page.
    """
    program, *words = shlex.split(line)
    with chdir(folder):
        if program == "geoident":
            done = CliRunner().invoke(geoident, words)
            return done.output, done.exit_code
        if program == "gmsh":
            return "", _gmsh(words)
    raise ValueError(f"a page may run geoident and gmsh, not: {line}")


def faults(page: Page, run: AnalysisRun) -> list[str]:
    """What in a page is not as it was when run: outputs, exit codes, pictures that are missing."""
    found = []
    commands = [command for command in page.commands if run.long or not command.long]
    for command, output, code in zip(commands, run.outputs, run.codes, strict=True):
        if code != command.code:
            found.append(f"{command.line}: exit code {code}: {output[-2000:]}")
        elif told := difference(command.output, cut(output, command.show)):
            found.append(f"{command.line}: {told}")
    all_run = len(commands) == len(page.commands)
    pictures = page.pictures if all_run else []
    lost = [p for p in pictures if not _made(run, p) and p.stem not in _drawn(run)]
    return found + [f"no command makes {p.name}" for p in lost]


def renew(page: Page, run: AnalysisRun) -> None:
    """Write the outputs of a run into a page, and its files and pictures beside it.

    A picture is a file that a command made, or the figure of that name in the report.

    Raises:
        ValueError: a command ended otherwise than the page says, or makes no such picture.
    """
    for command, output, code in zip(page.commands, run.outputs, run.codes, strict=True):
        if code != command.code:
            raise ValueError(f"{command.line}: exit code {code}\n{output}")
    page.path.write_text(page.with_outputs(run.outputs), encoding="utf-8")
    for name, text in page.files.items():
        page.folder.mkdir(exist_ok=True)
        (page.folder / name).write_text(text, encoding="utf-8")
    drawn = _drawn(run)
    for picture in page.pictures:
        made = _made(run, picture)
        if made is None and picture.stem not in drawn:
            raise ValueError(f"{page.path.name}: no command makes {picture.name}")
        new = made.read_bytes() if made else image(drawn[picture.stem], "png")
        picture.write_bytes(small(new))


def small(picture: bytes, *, width: int = WIDTH, colours: int = COLOURS) -> bytes:
    """A PNG with few colours, no wider than a page."""
    opened = Image.open(io.BytesIO(picture)).convert("RGB")
    if opened.width > width:
        height = round(opened.height * width / opened.width)
        opened = opened.resize((width, height), Image.Resampling.LANCZOS)
    kept = io.BytesIO()
    opened.quantize(colours, dither=Image.Dither.NONE).save(kept, "png", optimize=True)
    return kept.getvalue()


def _made(run: AnalysisRun, picture: Path) -> Path | None:
    return next(iter(sorted(run.folder.rglob(picture.name))), None)


def _drawn(run: AnalysisRun) -> dict[str, Picture]:
    """The figures of the report of the result, by name; of a control those of its status page."""
    named = (run.folder / f"case.{command}.h5" for command in ("control", "fit"))
    path = next((path for path in named if path.exists()), None)
    return {p.name: p for p in album(read_result(path)).all} if path else {}


def _gmsh(words: list[str]) -> int:
    """What gmsh does with the words of its command line that pages use."""
    import gmsh  # noqa: PLC0415 - only where meshes are made

    parser = argparse.ArgumentParser(allow_abbrev=False, prefix_chars="-")
    parser.add_argument("geometry")
    parser.add_argument("-o", dest="mesh", required=True)
    parser.add_argument("-order", type=int, default=1)
    parser.add_argument("-setnumber", nargs=2, default=("size", "1"))
    for dimension in (2, 3):
        parser.add_argument(f"-{dimension}", dest="dim", action="store_const", const=dimension)
    asked = parser.parse_args(words)
    gmsh.initialize(["gmsh", "-v", "1", "-setnumber", *asked.setnumber], readConfigFiles=False)
    gmsh.open(asked.geometry)
    gmsh.model.mesh.generate(asked.dim)
    gmsh.model.mesh.setOrder(asked.order)
    gmsh.write(asked.mesh)
    gmsh.finalize()
    return 0


__all__ = ["AnalysisRun", "Command", "faults", "given_files", "renew", "run_page", "small"]
