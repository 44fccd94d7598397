"""The verbs in the shell. Exit codes: 0; 2 for what the user can mend; 1 for a fault of pdlab."""

import sys
from collections.abc import Callable

from pdlab.cli import batching, beds, comparing, descent, predicting, serving, stores, sweeping, tables
from pdlab.cli.shell import app, db
from pdlab.errors import InputError, PdlabError

VERBS: dict[str, Callable[..., None]] = {
    "demo": predicting.demo,
    "import": tables.import_,
    "export": tables.export,
    "ls": tables.ls,
    "calibrate": predicting.calibrate,
    "predict": predicting.predict,
    "batch": batching.batch,
    "runner": batching.runner,
    "sheet": predicting.sheet,
    "sweep": sweeping.sweep,
    "compare": comparing.compare,
    "serve": serving.serve,
    "show": descent.show,
    "report": descent.report,
    "verify": descent.verify,
    "refresh": descent.refresh,
    "correct": descent.correct,
    "delete": descent.delete,
    "bed": beds.bed,
    "bench": beds.bench,
}
STORE_VERBS: dict[str, Callable[..., None]] = {"upgrade": stores.upgrade, "backup": stores.backup, "copy": stores.copy}

for name, verb in VERBS.items():
    app.command(name)(verb)
for name, verb in STORE_VERBS.items():
    db.command(name)(verb)


def main() -> None:
    """Run a verb; turn what went wrong into one sentence and an exit code."""
    try:
        app()
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except PdlabError as error:
        print(error, file=sys.stderr)
        sys.exit(1)
