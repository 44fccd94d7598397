"""Words of the page: texts that Markdown shows as they stand, and how they begin."""

import re

MISSING = "–"  # stands in a table where a value is missing


def plain(text: str) -> str:
    """Return text that Markdown shows as it stands."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)


def pressed(text: str) -> str:
    """Return what is said of a prediction with the page's button in place of the command that does the same."""
    return re.sub(r"run 'pdlab (predict|refresh)'", "press 'Predict'", text)


def digits(value: float) -> str:
    """Return a number with three significant digits, zeros at its end too: 1.20, 14.4, 126."""
    return f"{value:#.3g}".rstrip(".")


def begun(text: str) -> str:
    """Return a text with a capital at its beginning, all else as it is: units and symbols too."""
    return text[:1].upper() + text[1:]
