"""How densely will this mixture of aggregates pack? See ``pdlab.Lab``."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdlab.lab import Lab

__version__ = "0.1.0"
__all__ = ["Lab", "__version__"]


def __getattr__(name: str) -> Any:
    if name == "Lab":  # imported on first use: it brings numba, pandas and SQLAlchemy
        from pdlab.lab import Lab

        return Lab
    raise AttributeError(f"module 'pdlab' has no attribute {name!r}")
