"""What can be wrong with a store; every error comes with advice.

What the operating system refuses (full disk, missing permission) stays an OSError and names the file.
"""

from __future__ import annotations

from pathlib import Path


class StoreError(Exception):
    """A store cannot be used.

    ``advice`` tells the user what to change; ``path`` is the file or folder concerned.
    """

    def __init__(self, message: str, advice: str, path: Path | str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice
        self.path = None if path is None else Path(path)

    def __str__(self) -> str:
        place = "" if self.path is None else f"{self.path}: "
        return f"{place}{self.message}. {self.advice}"

    def __reduce__(self) -> tuple[object, ...]:
        # exceptions cross process boundaries when workers report; the default rebuilds from the message alone
        return type(self), (self.message, self.advice, self.path)


class NotAStoreError(StoreError):
    """The path holds nothing, or no store."""


class ForeignStoreError(StoreError):
    """The store was not written by this schema: other shapes, types, codecs, links, or a newer version."""


class OtherConfigurationError(StoreError):
    """The store belongs to another configuration."""


class LockedStoreError(StoreError):
    """Another process writes the group."""


class CorruptedError(StoreError):
    """A file is missing, or its checksum does not hold."""
