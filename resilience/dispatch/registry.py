"""Dispatchers by name. Their code is imported when one is made, not when its name is looked up."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, cast

from resilience.errors import UsageError
from resilience.extras import need

if TYPE_CHECKING:
    from resilience.simulation.observation import Dispatcher
    from resilience.simulation.setting import Setting

Factory: TypeAlias = "Callable[[Setting], Dispatcher]"
Futures = Literal["one", "many"]

POLICY_FILE = "policy.safetensors"
"""The file of a run in which its best policy is."""
REFERENCE = "rule-0.9"
"""Always reported: a battery kept full is the method to beat."""


@dataclass(frozen=True)
class DispatcherEntry:
    """How a dispatcher is made from the setting that it acts in, and what is known of it before.

    Attributes:
        make: imports the dispatcher's code and makes one.
        batched: it decides for many scenarios at once and for each as if it were alone. All others
            are given one scenario at a time in a comparison; see `evaluation.runs`.
        plans_for: whether it plans for one future or for many, both for their mean cost; None
            where it does not plan, or for something else than the mean.
        believes: it acts on a belief in outages to come, see `Setting.belief`.
    """

    make: Factory
    batched: bool = False
    plans_for: Futures | None = None
    believes: bool = False

    def __call__(self, setting: Setting) -> Dispatcher:
        """A fresh dispatcher."""
        return self.make(setting)


def _idle(setting: Setting) -> Dispatcher:
    from resilience.dispatch.rules import Idle

    return Idle(setting)


def _greedy(setting: Setting) -> Dispatcher:
    from resilience.dispatch.rules import Greedy

    return Greedy(setting)


def _rule(setting: Setting, level: float) -> Dispatcher:
    from resilience.dispatch.rules import Rule

    return Rule(setting, level)


def _mpc_blind(setting: Setting) -> Dispatcher:
    from resilience.dispatch.mpc import BlindMPC

    return BlindMPC(setting)


def _mpc(setting: Setting) -> Dispatcher:
    from resilience.dispatch.mpc import MPC

    return MPC(setting)


def _stochastic(setting: Setting) -> Dispatcher:
    from resilience.dispatch.stochastic import Stochastic

    return Stochastic(setting)


def _stochastic_cvar(setting: Setting) -> Dispatcher:
    """For half the mean and half the mean of the worst 5 % of the paths."""
    from resilience.dispatch.stochastic import Stochastic
    from resilience.models.program.risk import Risk

    return Stochastic(setting, risk=Risk(alpha=0.95, weight=0.5))


def _comb(setting: Setting) -> Dispatcher:
    from resilience.dispatch.comb import Comb

    return Comb(setting)


def _sddp(setting: Setting) -> Dispatcher:
    from resilience.dispatch.sddp.policy import Sddp

    return Sddp(setting)


DISPATCHERS: dict[str, Factory] = {
    "idle": DispatcherEntry(_idle, batched=True),
    "greedy": DispatcherEntry(_greedy, batched=True),
    "rule": DispatcherEntry(partial(_rule, level=0.5), batched=True),
    REFERENCE: DispatcherEntry(partial(_rule, level=0.9), batched=True),
    "mpc-blind": DispatcherEntry(_mpc_blind, plans_for="one"),
    "mpc": DispatcherEntry(_mpc, plans_for="one", believes=True),
    "stochastic": DispatcherEntry(_stochastic, plans_for="many", believes=True),
    "stochastic-cvar": DispatcherEntry(_stochastic_cvar, believes=True),
    "comb": DispatcherEntry(_comb, batched=True, plans_for="many", believes=True),
    "sddp": DispatcherEntry(_sddp, plans_for="many", believes=True),
}
"""What makes each dispatcher, by name; `register_dispatcher` adds to them."""


LEARNED_LOADER = "resilience.rl.policy:load_policy"
"""What makes a dispatcher from a setting, the name of its algorithm and the folder of its run."""


@dataclass(frozen=True)
class LearnedEntry:
    """A policy that `resilience train` has made, called `METHOD:RUN`.

    Attributes:
        method: name of the algorithm.
        run: folder of the run.
        digest: SHA-256 of its policy, so that a comparison never takes one for another.
    """

    method: str
    run: str
    digest: str
    batched: ClassVar[bool] = True

    def __call__(self, setting: Setting) -> Dispatcher:
        """A fresh dispatcher."""
        need("learn", f"{self.method}:{self.run}", "torch", "safetensors")
        module, _, name = LEARNED_LOADER.partition(":")
        load = getattr(import_module(module), name)
        return cast("Dispatcher", load(setting, self.method, Path(self.run)))


@dataclass(frozen=True)
class RuleEntry:
    """The rule at a level of its own, called `rule-LEVEL`.

    Attributes:
        level: state of charge that it holds while the grid is there, 0 to 1.
    """

    level: float
    batched: ClassVar[bool] = True

    def __call__(self, setting: Setting) -> Dispatcher:
        """A fresh dispatcher."""
        return _rule(setting, self.level)


def rule_of(name: str) -> RuleEntry | None:
    """The rule that `rule-0.7` means; None where a name is none of a rule.

    Raises:
        UsageError: a level above 1.
    """
    match = re.fullmatch(r"rule-(\d+(?:\.\d+)?)", name, re.ASCII)
    if match is None:
        return None
    level = float(match[1])
    if level > 1.0:
        raise UsageError(
            f"dispatcher {name!r} holds a level of {level:g}; allowed: 0 to 1",
            hint=f"probably percent: rule-{level / 100:g}"
            if level <= 100.0
            else "rule-0.9 is full",
        )
    return RuleEntry(level)


def factory_of(name: str) -> Factory:
    """What makes the dispatcher of a name.

    Args:
        name: a key of `DISPATCHERS`, `rule-LEVEL`, or `METHOD:RUN` for a trained policy.

    Raises:
        UsageError: neither, or a run without a policy.
    """
    if name in DISPATCHERS:
        return DISPATCHERS[name]
    if rule := rule_of(name):
        return rule
    method, colon, run = name.partition(":")
    if not colon:
        raise UsageError(
            f"dispatcher {name!r} is unknown; allowed: {', '.join(DISPATCHERS)}, rule-LEVEL, or "
            "METHOD:RUN of a trained policy",
            hint="`clairvoyant` is the bound and always there",
        )
    path = Path(run) / POLICY_FILE
    if not path.is_file():
        raise UsageError(
            f"{run} holds no trained policy ({POLICY_FILE})",
            hint=f"resilience train CASE --method {method} --out {run}",
        )
    return LearnedEntry(method, run, hashlib.sha256(path.read_bytes()).hexdigest())


def register_dispatcher(
    name: str,
    factory: Factory,
    *,
    batched: bool | None = None,
    plans_for: Futures | None = None,
) -> None:
    """Adds a dispatcher under a name that `solve` and `compare` then know.

    Args:
        name: how users call it.
        factory: makes it from the setting that it acts in; imports there what is slow to import.
        batched: see `DispatcherEntry`; as the factory itself says if omitted.
        plans_for: likewise; None: it does not plan for a mean.

    Raises:
        UsageError: the name is taken.
    """
    if name in DISPATCHERS:
        raise UsageError(
            f"dispatcher {name!r} is registered already; allowed: any other name than "
            f"{', '.join(DISPATCHERS)}",
            hint="`compare` takes dispatchers of one's own under any name, unregistered",
        )
    stated = is_batched(factory) if batched is None else batched
    DISPATCHERS[name] = DispatcherEntry(factory, stated, plans_for)


def is_batched(factory: Factory) -> bool:
    """Whether what makes a dispatcher says that it decides for many scenarios at once."""
    return bool(getattr(factory, "batched", False))


def names_planning_for(futures: Futures, names: Iterable[str]) -> list[str]:
    """Those among some names that plan for one future, or for many, in the registry's order."""
    among = set(names)
    return [
        name
        for name, factory in DISPATCHERS.items()
        if name in among and getattr(factory, "plans_for", None) == futures
    ]
