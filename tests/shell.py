"""The verbs as a shell runs them: in this process, which is quick, or in one of their own."""

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

from pdlab import cli

SHELL = {"PYTHONIOENCODING": "utf-8", "COLUMNS": "140"}


def pdlab(*arguments: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a verb in this process, in a folder; a test of how processes start and end takes ``process``."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    code = 0
    with (
        contextlib.chdir(folder),
        mock.patch.dict(os.environ, SHELL | environment),
        mock.patch.object(sys, "argv", ["pdlab", *arguments]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            cli.main()
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    return subprocess.CompletedProcess(arguments, code, _text(out), _text(err))


def _text(stream: io.TextIOWrapper) -> str:
    stream.seek(0)
    return stream.read()


def process(*arguments: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a verb in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "pdlab.cli", *arguments], check=False, cwd=folder, capture_output=True, text=True,
        encoding="utf-8", env={**os.environ, **SHELL, **environment},
    )  # fmt: skip


def refused(done: subprocess.CompletedProcess[str], *sentences: str) -> None:
    """See that a verb ended with exit code 2 and these sentences."""
    assert done.returncode == 2, done
    assert "Traceback" not in done.stderr
    for sentence in sentences:
        assert sentence in done.stderr
