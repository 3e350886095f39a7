"""Trained cuts on disk, by what they were trained from.

A file's name is a digest of every number of the problem, of where paths begin, and of the settings:
whatever changes one of them changes the name. A file that is damaged, or is no such file, counts as
missing and is written anew.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.dispatch.sddp.model import Cuts, Multistage
from resilience.dispatch.sddp.program import StageProgram
from resilience.dispatch.sddp.training import Settings, Trained
from resilience.files import replacing_file

VERSION = 1
"""Raised whenever the same problem and settings give other cuts."""


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/resilience/sddp`, or `~/.cache/resilience/sddp`."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "resilience" / "sddp"


def digest(multistage: Multistage, more: Iterable[Floats], settings: Settings) -> str:
    """Of all that cuts depend on; `more` are arrays that say where paths begin."""
    found = hashlib.sha256(f"{VERSION} {settings}".encode())

    def take(name: str, value: Floats | Bools) -> None:
        array = np.ascontiguousarray(value, float)
        found.update(f"{name} {array.shape}".encode())
        found.update(array.tobytes())

    for stage in multistage.stages:
        program = StageProgram(stage)
        take("matrix", program.standard.a.toarray())
        take("equality", program.equality)
        take("fixed", program.form.constants)
        take("moving", program.form.slopes.toarray())
        take("offset", np.append(program.form.offset, program.form.offset_data))
    for modes, transition in zip(multistage.outcomes, multistage.transition, strict=True):
        take("transition", transition)
        for mode in modes:
            take(f"stage {mode.stage}", mode.probability)
            for name in sorted(mode.data):
                take(name, mode.data[name])
    for part in (multistage.terminal.alpha, multistage.terminal.beta, multistage.terminal.gamma):
        take("terminal", part)
    for part in more:
        take("start", part)
    return found.hexdigest()


def save(path: Path, key: str, trained: Trained) -> None:
    """Writes the file whole or not at all."""
    modes = np.array([len(cuts) for cuts in trained.cuts])
    parts = [cuts for slot in trained.cuts for cuts in slot]
    count = np.array([cuts.n for cuts in parts])
    whole = Cuts.joined([*parts, trained.root])
    with replacing_file(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(
            file,
            key=np.array(key),
            modes=modes,
            count=count,
            alpha=whole.alpha,
            beta=whole.beta,
            gamma=whole.gamma,
            bounds=trained.bounds,
        )


def load(path: Path, key: str) -> Trained | None:
    """What `save` wrote under that key, or None."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            if str(file["key"]) != key:
                return None
            whole = Cuts(file["alpha"], file["beta"], file["gamma"])
            return _split(whole, file["modes"], file["count"], file["bounds"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _split(whole: Cuts, modes: Floats, count: Floats, bounds: Floats) -> Trained:
    ends = np.cumsum(count)
    parts = [whole[a:b] for a, b in zip(ends - count, ends, strict=True)]
    slots = np.cumsum(modes)
    cuts = [parts[a:b] for a, b in zip(slots - modes, slots, strict=True)]
    return Trained(cuts, whole[ends[-1] :], bounds)
