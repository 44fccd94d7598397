"""Words of the page: texts that Markdown shows as they stand."""

import re


def plain(text: str) -> str:
    """Return text that Markdown shows as it stands."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)
