"""How Sphinx makes the site of the manual from the Markdown pages of the package.

The pages are plain Markdown, so that they can be read where they lie. What a site needs beyond
that is made here: the tree of contents comes from the lists of links of ``index.md``.
"""

from __future__ import annotations

import re

from geoident import __version__

project = "geoident"
author = "The geoident developers"
copyright = author  # noqa: A001 - Sphinx wants this name
version = release = __version__

extensions = ["myst_parser"]
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_inline"]
include_patterns = ["docs/**.md", "ARCHITECTURE.md"]
root_doc = "docs/index"
nitpicky = True

html_theme = "furo"
html_title = f"geoident {release}"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {
        "font-stack": "system-ui, sans-serif",
        "color-brand-primary": "#1f4e79",
        "color-brand-content": "#1f4e79",
    }
}
html_static_path = ["static"]
html_css_files = ["manual.css"]
html_extra_path = ["root"]

CHAPTER = re.compile(r"^## (.+)\n((?:(?!^## ).*\n?)*)", re.MULTILINE)
LINK = re.compile(r"^- \[[^\]]+\]\(([\w/.-]+)\.md\)", re.MULTILINE)


def contents(text: str) -> str:
    """Hidden trees of contents, one for every heading of the first page that has a list of links.

    Args:
        text: of ``index.md``.
    """
    trees = []
    for title, body in CHAPTER.findall(text):
        pages = LINK.findall(body)
        if pages:
            head = ["```{toctree}", ":hidden:", f":caption: {title}", ""]
            trees.append("\n".join([*head, *pages, "```"]))
    return "\n\n".join(trees)


def add_contents(_app: object, page: str, source: list[str]) -> None:
    """Give the first page its trees, and the first page of a folder that of its pages."""
    if page == root_doc:
        source[0] += "\n\n" + contents(source[0]) + "\n"
    elif page.endswith("/index"):
        pages = dict.fromkeys(re.findall(r"\]\((\w+)\.md\)", source[0]))
        source[0] += "\n".join(["\n\n```{toctree}", ":hidden:", "", *pages, "```", ""])


def setup(app) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("source-read", add_contents)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
