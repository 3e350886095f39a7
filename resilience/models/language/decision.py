"""The step before the first: what is built, and nothing that happens."""

from __future__ import annotations

import numpy as np

from resilience.models.language.stage import Stage


def decision(stage: Stage) -> Stage:
    """A stage with the states of another, in which designs are chosen and all else stays as it is.

    As the root of a tree it is where what is built may be tied by rows, a budget above all.
    """
    first = Stage(stage.dt, stage.reactive)
    designs = {design.block.name: design for design in stage.designs}
    for _, block in stage.states:
        unit, about = block.unit, block.about
        if (design := designs.get(block.name)) is not None:
            integer = stage.integer[stage.variables.index(block)]
            numbers = design.lower, design.upper, design.cost
            first.design(
                block.name, block.labels, *numbers, unit=unit, about=about, integer=integer
            )
            continue
        now, after = first.state(block.name, block.labels, -np.inf, np.inf, unit=unit, about=about)
        first.eq(f"{block.name}.kept", after, now)
    return first
