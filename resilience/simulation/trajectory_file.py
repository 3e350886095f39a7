"""Trajectories as files: one .npz per dispatcher, an array per field of `Trajectory`.

An array more, `sha256`, holds a digest of all the others, so that what was changed since is told
from what was written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from resilience.digest import digest_of
from resilience.errors import UsageError
from resilience.files import reading, replacing_file
from resilience.inputs import MissingFileError, checked_path
from resilience.simulation.trajectory import Trajectory

FOLDER = "trajectories"
"""Where a saved comparison keeps them, `METHOD.npz` each."""


DIGEST = "sha256"


def save_trajectory(trajectory: Trajectory, path: str | Path, key: str = "") -> None:
    """Writes a .npz file, whole or not at all; a field that is None is left out.

    Args:
        trajectory: what is written.
        path: of the file.
        key: what the file belongs to; it is read back by the same key only.

    Raises:
        UsageError: another suffix.
        FileError: the system refuses.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise UsageError(
            f"a trajectory cannot be kept in {path.name!r}; allowed suffix: .npz",
            hint=f"{path.stem}.npz, say",
        )
    values = {f.name: getattr(trajectory, f.name) for f in fields(trajectory)}
    if not trajectory.decision_columns:
        values["decision_columns"] = None
    arrays: dict[str, Any] = {k: np.asarray(v) for k, v in values.items() if v is not None}
    arrays[DIGEST] = np.asarray(digest_of([key, arrays]))
    with replacing_file(path) as fresh, fresh.open("wb") as binary:
        np.savez_compressed(binary, **arrays)


def load_trajectory(path: str | Path, key: str = "") -> Trajectory:
    """Reads what `save_trajectory` wrote.

    Args:
        path: of the file.
        key: what it belongs to.

    Raises:
        UsageError: no such file, no trajectory in it, or one that was changed or is of another key.
    """
    path = Path(path)
    try:
        checked_path(path)
    except MissingFileError:
        raise UsageError(
            f"trajectory file {path} does not exist", hint="`resilience compare --out` writes some"
        ) from None
    with reading(path), path.open("rb") as opened, np.load(opened) as file:
        arrays = {f.name: file[f.name] for f in fields(Trajectory) if f.name in file}
        if str(file[DIGEST]) != digest_of([key, arrays]):
            raise ValueError("its SHA-256 is another than was written")
        values = {name: _value(array) for name, array in arrays.items()}
    needed = {f.name for f in fields(Trajectory) if f.default is MISSING}
    if not (needed <= values.keys() and _are_of_one_trajectory(values)):
        raise _unreadable(path)
    return Trajectory(**values)


def _are_of_one_trajectory(values: Mapping[str, Any]) -> bool:
    """Whether kinds and shapes of all fields fit each other, and every number is one."""
    cost, columns = values["cost"], values["columns"]
    inner = values.get("decision_columns", ())
    if not (isinstance(columns, tuple) and isinstance(inner, tuple)) or np.ndim(cost) != 2:
        return False
    slots, n = np.shape(cost)
    units, tanks = np.shape(values["energy"])[:1], np.shape(values.get("fuel", 0))[:1]
    shapes = {
        "cost": (slots, n),
        "energy": (*units, slots + 1, n),
        "storage": (*units, slots, n),
        "flows": (len(columns), slots, n),
        "spill": (slots, n),
        "left_mwh": (n,),
        "proven": (n,),
        "fuel": (*tanks, slots + 1, n),
        "decisions": (len(inner), slots, n),
    }
    numbers = {f for f in values if f not in ("name", "columns", "decision_columns")}
    return (
        isinstance(values["name"], str)
        and all(np.asarray(values[f]).dtype.kind in "fi" for f in numbers)
        and all(np.isfinite(values[f]).all() for f in numbers)
        and all(np.shape(values[f]) == shapes.get(f, ()) for f in numbers)
    )


def _unreadable(path: Path) -> UsageError:
    return UsageError(
        f"{path} holds no trajectory", hint="`resilience compare --out` writes such files"
    )


def _value(array: np.ndarray) -> Any:
    """A number or text as itself, names as a tuple, everything else as the array it is."""
    if array.ndim == 0:
        return array.item()
    return tuple(array.tolist()) if array.dtype.kind == "U" else array


def save_trajectories(trajectories: Mapping[str, Trajectory], folder: Path) -> None:
    """Writes each as `folder/trajectories/METHOD.npz`; the method is its key."""
    for method, trajectory in trajectories.items():
        save_trajectory(trajectory, folder / FOLDER / f"{method}.npz")


def load_trajectories(folder: Path) -> dict[str, Trajectory]:
    """Reads all trajectories, by method; none where the folder has none."""
    paths = sorted((folder / FOLDER).glob("*.npz"))
    return {path.stem: load_trajectory(path) for path in paths}
