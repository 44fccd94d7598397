"""Whether a store has changed since it was looked at."""

from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import sqlalchemy as sa


@dataclass
class Watch:
    """Looks at a store from a connection of its own, which is opened at the first look and used for nothing else."""

    connection: Any = None
    lock: Lock = field(default_factory=Lock)

    def look(self, reader: sa.Engine) -> str:
        """Return a text that is another one after every write that was committed, by this process or any other.

        SQLite counts the commits of all other connections for each one (its PRAGMA data_version); PostgreSQL tells
        which transactions are seen.
        """
        if reader.dialect.name == "postgresql":
            with reader.connect() as connection:
                return str(connection.scalar(sa.text("SELECT CAST(pg_current_snapshot() AS text)")))
        with self.lock:
            if self.connection is None:
                self.connection = reader.raw_connection()
            cursor = self.connection.cursor()
            try:
                return str(cursor.execute("PRAGMA data_version").fetchone()[0])
            finally:
                cursor.close()

    def close(self) -> None:
        """Give the connection back."""
        with self.lock:
            if self.connection is not None:
                self.connection.close()
            self.connection = None
