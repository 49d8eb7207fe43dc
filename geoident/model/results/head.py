"""What a report says of itself: for whom it was made, by whom, of what."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace


@dataclass(frozen=True)
class ReportHead:
    """The head of a report; empty texts say nothing.

    Args:
        title: in place of that of the case.
        project: the project.
        author: who made it.
        client: for whom.
        revision: of the report.
        date: as it is to be written.
        logo: path of a picture.
    """

    title: str = ""
    project: str = ""
    author: str = ""
    client: str = ""
    revision: str = ""
    date: str = ""
    logo: str = ""

    def over(self, other: ReportHead) -> ReportHead:
        """This head, with what it leaves empty from another one.

        >>> ReportHead(client="A").over(ReportHead(client="B", author="C"))
        ReportHead(title='', project='', author='C', client='A', revision='', date='', logo='')
        """
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        return replace(other, **{name: text for name, text in own.items() if text})


NO_HEAD = ReportHead()
"""Says nothing."""
