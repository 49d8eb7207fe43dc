"""A case that another program is going to drive, and the files that are written for that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from geoident.errors import Term, UsageError
from geoident.forward.observed import ObservedModel
from geoident.io.text.text_file import STDIN, seen_from
from geoident.workflow.export import ListedFiles, Writer
from geoident.workflow.running.jobs import Inputs, build_model, load_inputs


@dataclass(frozen=True)
class DrivenCase:
    """A case and the folder for the files of the program that drives it.

    Args:
        path: of the case.
        inputs: it.
        model: of it.
        folder: of the files.
        seen: path of the case, seen from there.
        force: files that stand there are replaced.
    """

    path: str
    inputs: Inputs
    model: ObservedModel
    folder: Path
    seen: str
    force: bool

    def write(self, texts: Mapping[str, str], stem: str) -> tuple[str, ...]:
        """Write the files; their paths.

        Args:
            texts: name to what it holds.
            stem: what the name of their list begins with.

        Raises:
            OutputError: a file exists or cannot be written.
        """
        writers: dict[Path, Writer] = {
            self.folder / name: partial(_write, text) for name, text in texts.items()
        }
        identity = self.inputs.identity("export", (), seed=0)
        files = self.inputs.files
        return ListedFiles(self.folder, stem, self.path, files, identity, self.force).write(writers)


def driven_case(
    path: str, program: str, output: str | None, *, not_taken: str, force: bool
) -> DrivenCase:
    """Read a case that a program is going to drive.

    Args:
        path: of the case.
        program: its name; in small letters the ending of the folder.
        output: folder of the files; ``CASE.PROGRAM`` beside the case if None.
        not_taken: characters that the program does not take in a command.
        force: files that stand there are replaced.

    Raises:
        InputError: the case is wrong.
        UsageError: the case comes from stdin, or its path has such characters.
    """
    if path == STDIN:
        message = f"{program} runs the case again and again: save it as a file and name that"
        raise UsageError(message)
    inputs = load_inputs(path)
    model = build_model(inputs)
    beside = Path(path).with_name(f"{Path(path).stem}.{program.lower()}")
    folder = beside if output is None else Path(output)
    if set(seen := seen_from(folder, path)) & set(not_taken):
        signs = "blanks or quotes" if "'" in not_taken else "blanks"
        message = f"'{seen}' has {signs}, which {program} does not take in a command\n"
        raise UsageError(f"{message}    rename the case or its folder, or choose {Term.OUTPUT}")
    return DrivenCase(path, inputs, model, folder, seen, force)


def _write(text: str, part: str) -> None:
    Path(part).write_text(text, encoding="utf-8", newline="")
