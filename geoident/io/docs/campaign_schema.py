"""The JSON schema of campaign files and the page of their keys, from the code that validates them.

``python -m geoident.io.docs.campaign_schema`` prints the schema, with ``--markdown`` the page.
"""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import Any

from geoident.io.campaign.sections import CampaignSection
from geoident.io.docs.key_page import key_page
from geoident.io.docs.schema import schema_of

_HEAD = """\
# All keys of a campaign file

Made from the code that reads campaigns (`geoident schema --campaign --markdown`). Bold keys are
required; what each may hold, and its default, stands in parentheses.
How campaigns are used: [many runs](how-to/campaigns.md).
"""


@cache
def campaign_schema() -> dict[str, Any]:
    """The schema of campaign files, made once: not to be changed.

    >>> campaign_schema()["title"]
    'geoident campaign'
    """
    return schema_of(CampaignSection, "geoident campaign")


def campaign_schema_text() -> str:
    """The schema as it is in ``schemas/campaign.schema.json``."""
    return json.dumps(campaign_schema(), indent=2, ensure_ascii=False) + "\n"


def campaign_key_page_text() -> str:
    """The page of all keys as it is in ``geoident/docs/campaign_keys.md``."""
    return key_page(_HEAD, "Campaign", campaign_schema())


if __name__ == "__main__":
    page = "--markdown" in sys.argv[1:]
    sys.stdout.write(campaign_key_page_text() if page else campaign_schema_text())
