"""Whether a store has changed since it was looked at."""

from dataclasses import dataclass, field
from threading import Lock
from uuid import uuid4

import sqlalchemy as sa


@dataclass
class Watch:
    """Looks at a store from a connection of its own, which is opened at the first look and used for nothing else."""

    connection: sa.Connection | None = None
    name: str = ""
    lock: Lock = field(default_factory=Lock)

    def look(self, reader: sa.Engine) -> str:
        """Return a text that is another one after every write that was committed, by this process or any other.

        SQLite counts the commits of all other connections for each one, from where each begins (its PRAGMA
        data_version), so the text names the connection too; PostgreSQL tells which transactions are seen.
        """
        if reader.dialect.name == "postgresql":
            with reader.connect() as connection:
                return str(connection.scalar(sa.text("SELECT CAST(pg_current_snapshot() AS text)")))
        with self.lock:
            if self.connection is None:
                self.connection, self.name = reader.connect(), uuid4().hex
            with self.connection.begin():  # one that ends, or the next look would see this one's state
                commits = self.connection.exec_driver_sql("PRAGMA data_version").scalar()
            return f"{self.name}:{commits}"

    def close(self) -> None:
        """Give the connection back."""
        with self.lock:
            if self.connection is not None:
                self.connection.close()
            self.connection = None
