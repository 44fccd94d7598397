"""Words of the page: texts that Markdown shows as they stand, and how they begin."""

import re

MISSING = "–"  # stands in a table where a value is missing


def plain(text: str) -> str:
    """Return text that Markdown shows as it stands."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)


def begun(text: str) -> str:
    """Return a text with a capital at its beginning, all else as it is: units and symbols too."""
    return text[:1].upper() + text[1:]
