"""The JSON schema of project files and the page of their keys, from the code that validates them.

``python -m geoident.io.docs.project_schema`` prints the schema, with ``--markdown`` the page.
"""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import Any

from geoident.io.docs.key_page import key_page
from geoident.io.docs.schema import schema_of
from geoident.io.project.sections import ProjectFile

_HEAD = """\
# All keys of a project file

Made from the code that reads projects (`geoident schema --project --markdown`). Bold keys are
required; what each may hold, and its default, stands in parentheses.
How projects are used: [several sections](how-to/several-sections.md).
"""


@cache
def project_schema() -> dict[str, Any]:
    """The schema of project files, made once: not to be changed.

    >>> project_schema()["title"]
    'geoident project'
    """
    return schema_of(ProjectFile, "geoident project")


def project_schema_text() -> str:
    """The schema as it is in ``schemas/project.schema.json``."""
    return json.dumps(project_schema(), indent=2, ensure_ascii=False) + "\n"


def project_key_page_text() -> str:
    """The page of all keys as it is in ``geoident/docs/project_keys.md``."""
    return key_page(_HEAD, "Project", project_schema())


if __name__ == "__main__":
    page = "--markdown" in sys.argv[1:]
    sys.stdout.write(project_key_page_text() if page else project_schema_text())
