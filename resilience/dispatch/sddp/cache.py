"""Trained cuts on disk, by what they were trained from.

A file's name is a digest of every number of the problem, of where paths begin, and of the settings:
whatever changes one of them changes the name. A file that is damaged, was changed, or is no such
file counts as missing and is written anew.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.digest import digest_of
from resilience.dispatch.sddp.model import Cuts, Multistage
from resilience.dispatch.sddp.program import StageProgram
from resilience.dispatch.sddp.training import Settings, Trained
from resilience.files import DAMAGED, replacing_file

VERSION = 1
"""Raised whenever the same problem and settings give other cuts."""


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/resilience/sddp`, or `~/.cache/resilience/sddp`."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "resilience" / "sddp"


def digest(multistage: Multistage, starts: Iterable[Floats], settings: Settings) -> str:
    """Of all that cuts depend on; `starts` are arrays that say where paths begin."""
    hashed = hashlib.sha256(f"{VERSION} {settings}".encode())

    def add(name: str, value: Floats | Bools) -> None:
        array = np.ascontiguousarray(value, float)
        hashed.update(f"{name} {array.shape}".encode())
        hashed.update(array.tobytes())

    for stage in multistage.stages:
        program = StageProgram(stage)
        add("matrix", program.standard.a.toarray())
        add("equality", program.equality)
        add("fixed", program.form.constants)
        add("moving", program.form.slopes.toarray())
        add("offset", np.append(program.form.offset, program.form.offset_data))
    for modes, transition in zip(multistage.outcomes, multistage.transition, strict=True):
        add("transition", transition)
        for mode in modes:
            add(f"stage {mode.stage}", mode.probability)
            for name in sorted(mode.data):
                add(name, mode.data[name])
    terminal = multistage.terminal
    for array in (terminal.alpha, terminal.beta, terminal.gamma):
        add("terminal", array)
    for array in starts:
        add("start", array)
    return hashed.hexdigest()


def save(path: Path, key: str, trained: Trained) -> None:
    """Writes the file whole or not at all."""
    modes = np.array([len(cuts) for cuts in trained.cuts])
    mode_cuts = [cuts for slot in trained.cuts for cuts in slot]
    count = np.array([cuts.n for cuts in mode_cuts])
    everything = Cuts.joined([*mode_cuts, trained.root])
    arrays: dict[str, Any] = {
        "modes": modes,
        "count": count,
        "alpha": everything.alpha,
        "beta": everything.beta,
        "gamma": everything.gamma,
        "bounds": np.asarray(trained.bounds),
    }
    arrays["sha256"] = np.array(digest_of([key, arrays]))
    with replacing_file(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load(path: Path, key: str) -> Trained | None:
    """What `save` wrote under that key, or None."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files if name != "sha256"}
            if str(file["sha256"]) != digest_of([key, arrays]):
                return None
            everything = Cuts(arrays["alpha"], arrays["beta"], arrays["gamma"])
            return _split(everything, arrays["modes"], arrays["count"], arrays["bounds"])
    except DAMAGED:
        return None


def _split(everything: Cuts, modes: Ints, count: Ints, bounds: Floats) -> Trained:
    """The inverse of how `save` joins cuts.

    Args:
        everything: all cuts, slot by slot and mode by mode, those of the root last.
        modes: (slots,) number of modes.
        count: (modes of all slots,) number of cuts.
        bounds: as in `Trained`.
    """
    ends, slots = np.cumsum(count), np.cumsum(modes)
    mode_cuts = [everything[a:b] for a, b in zip(ends - count, ends, strict=True)]
    cuts = [mode_cuts[a:b] for a, b in zip(slots - modes, slots, strict=True)]
    return Trained(cuts, everything[ends[-1] :], bounds)
