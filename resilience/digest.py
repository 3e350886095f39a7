"""Digests of plain data, so that a file can be called after all that its numbers depend on."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from pydantic import BaseModel


class Digest(Protocol):
    """A hash that bytes are fed into."""

    def update(self, data: bytes, /) -> None:
        """Takes in more bytes."""


def digest_of(value: object, without: Collection[str] = ()) -> str:
    """Hexadecimal SHA-256 of a value: numbers, text, arrays, records and what holds them.

    Args:
        value: what is told apart.
        without: names of fields and keys that are left out wherever they stand.
    """
    digest = hashlib.sha256()
    feed(digest, value, without)
    return digest.hexdigest()


def feed(digest: Digest, value: object, without: Collection[str] = ()) -> None:
    """Takes a value into a digest, each kind with its own mark."""
    digest.update(f"{type(value).__name__}:".encode())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype} {value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, BaseModel):
        digest.update(value.model_dump_json().encode())
    elif is_dataclass(value):
        feed(digest, {f.name: getattr(value, f.name) for f in fields(value)}, without)
    elif isinstance(value, Mapping):
        for key in sorted(value):
            if key not in without:
                feed(digest, [key, value[key]], without)
    elif isinstance(value, list | tuple):
        for item in value:
            feed(digest, item, without)
    else:
        digest.update(repr(value).encode())


@cache
def code() -> str:
    """Digest of the sources of this package and of the solver's version."""
    from importlib.metadata import version

    root, digest = Path(__file__).parent, hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    feed(digest, [version(name) for name in ("highspy", "numpy", "scipy")])
    return digest.hexdigest()
