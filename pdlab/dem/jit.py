"""The one place for numba options, each with its reason."""

import hashlib
import tempfile
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import platformdirs
from llvmlite import binding


def _cache_folder() -> Path:
    """Return a folder named by the engine's sources: numba alone misses a change in another file."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    folder = Path(platformdirs.user_cache_dir("pdlab", appauthor=False)) / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:  # a read-only home
        return Path(tempfile.mkdtemp(prefix=f"pdlab-{name}-"))


_FOLDER = _cache_folder()


def _compiled(function: Callable[..., Any], **more: bool) -> Callable[..., Any]:
    options: Any = numba.config
    njit: Any = numba.njit
    outside, options.CACHE_DIR = options.CACHE_DIR, str(_FOLDER)  # read once, when the cache is enabled below
    try:
        compiled: Callable[..., Any] = njit(
            nogil=True,  # other threads of the process live on
            error_model="numpy",  # no test for a zero divisor in the inner loop
            fastmath={"contract"},  # fused multiply-add; NaN and infinity keep their meaning
            **more,
        )(function)
    finally:
        options.CACHE_DIR = outside
    return compiled


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` with the options that every kernel of the engine shares."""
    return _compiled(function, cache=True)  # a second process starts in milliseconds


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` into its callers: what it returns stays in registers."""
    return _compiled(function, forceinline=True)


def alone_and_shared(function: Callable[..., Any]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Compile ``function`` twice: for one thread, and with its ``prange`` loops on several."""
    shared = types.FunctionType(function.__code__, function.__globals__, f"{function.__name__}_shared")
    shared.__qualname__ = f"{function.__qualname__}_shared"  # the cache knows a function by its name alone
    return kernel(function), _compiled(shared, cache=True, parallel=True)


def fingerprint() -> dict[str, str]:
    """Return what beside ``dem.VERSION`` decides the last bits: numba's version and the processor."""
    options: Any = numba.config
    return {"numba": numba.__version__, "cpu": options.CPU_NAME or binding.get_host_cpu_name()}
