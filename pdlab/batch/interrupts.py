"""Ctrl-C is never lost: Python drops what a signal raises while an object is being deleted."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextmanager
def kept() -> Iterator[Callable[[], None]]:
    """Yield a function that raises again what a signal raised meanwhile, if Python dropped it.

    Signals come to the main thread alone; in another it has nothing to raise.
    """
    raised = list[BaseException]()

    def hear(number: int, frame: FrameType | None) -> None:
        try:
            before[number](number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    def check() -> None:
        if raised:
            raise raised.pop()

    found = ((number, signal.getsignal(number)) for number in SIGNALS)
    before = {number: handler for number, handler in found if callable(handler)}
    heard = [number for number in before if _handle(number, hear)]
    try:
        yield check
    finally:
        for number in heard:
            if signal.getsignal(number) is hear:  # unless it was given another meaning meanwhile
                _handle(number, before[number])


def _handle(number: int, handler: Callable[[int, FrameType | None], object]) -> bool:
    """Have a signal handled, which only the main thread may; return whether it is."""
    try:
        signal.signal(number, handler)
    except ValueError:
        return False
    return True
