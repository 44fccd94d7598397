"""The house itself: arrows, types, style, what an import loads, what the documents say."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    "command", [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["lint-imports"], ["mypy"]], ids=" ".join
)
def test_the_house_rules_hold(command: list[str]) -> None:
    tool = Path(sys.executable).with_name(command[0])
    done = subprocess.run([str(tool), *command[1:]], check=False, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_importing_pdlab_loads_nothing_heavy() -> None:
    code = (
        "import sys, pdlab; pdlab.__version__; "
        "print([name for name in ('numba', 'scipy', 'pandas', 'sqlalchemy', 'streamlit') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "[]\n"


def test_lab_is_reached_from_the_package() -> None:
    import pdlab

    assert pdlab.Lab.__name__ == "Lab"
    with pytest.raises(AttributeError, match="no attribute 'Laboratory'"):
        _ = pdlab.Laboratory


def test_every_verb_stands_in_the_readme_and_in_the_plan() -> None:
    from pdlab.cli import STORE_VERBS, VERBS

    for file in ("README.md", "docs/design.md"):
        text = (ROOT / file).read_text(encoding="utf-8")
        for verb in [*VERBS, *(f"db {verb}" for verb in STORE_VERBS)]:
            assert f"pdlab {verb}" in text, f"{file}: {verb}"
