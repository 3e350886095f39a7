"""Who watches the method: what is late, fails or does not pass the audit is decided by the rule."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from resilience.dispatch.registry import Factory
from resilience.models.program.gate import check_audit
from resilience.models.program.referee import Audit
from resilience.models.simulator import Decision, Step
from resilience.operation.answer import Fallback, OperatorAnswer
from resilience.operation.present import Present
from resilience.operation.why import Reasons
from resilience.operation.worker import Worker
from resilience.simulation.observation import Dispatcher, Observation, parts_of
from resilience.simulation.slots import Slot
from resilience.simulation.stage_audit import StageAudit, audit_step

T = TypeVar("T")


class Watched(NamedTuple):
    """A decision that passed, and what follows it.

    Attributes:
        decision: by the method, or by the rule.
        step: what follows.
        audit: of the step.
        fallback: why the rule decided; None where the method did.
        why: what the method believes and plans, in sentences.
        seconds: that the method took.
    """

    decision: Decision
    step: Step
    audit: Audit
    fallback: Fallback | None = None
    why: tuple[str, ...] = ()
    seconds: float = 0.0


class Considered(NamedTuple):
    """What the method says: its decision, why, and how long it took."""

    decision: Decision
    why: tuple[str, ...]
    seconds: float


class Watchdog:
    """Asks a method, and a rule where the method does not answer or must not be followed.

    The method works in a thread of its own and is asked in order: one that is late still takes
    notice of the slot, and the next one waits for it.

    Args:
        present: what steps decisions.
        make: makes the method's dispatcher.
        make_rule: makes the rule.
        time_limit_s: seconds after which an answer is late.

    Attributes:
        dispatcher: the method's; to be used through `ask` alone.
        rule: it needs no thread.
    """

    def __init__(
        self, present: Present, make: Factory, make_rule: Factory, time_limit_s: float
    ) -> None:
        setting = present.setting
        self.present, self.time_limit_s = present, time_limit_s
        self.reasons = Reasons(setting)
        self._audit = StageAudit(setting.simulator, lambda *_: "now]")
        self.rule, self._worker = make_rule(setting), Worker()
        self.dispatcher: Dispatcher = self._worker.submit(lambda: make(setting)).result()

    def stop(self) -> None:
        """Ends the thread."""
        self._worker.stop()

    @property
    def is_at_work(self) -> bool:
        """Whether the thread, though stopped, has not ended yet."""
        return self._worker.is_alive

    def ask(self, call: Callable[[], T]) -> T:
        """What a call in the method's thread returns.

        Raises:
            TimeoutError: nothing within the time limit.
        """
        return self._worker.submit(call).result(timeout=self.time_limit_s)

    def let_notice(self, observation: Observation) -> None:
        """Lets the method see a slot of which no decision is wanted."""
        self._worker.submit(lambda: self.dispatcher.act(observation))

    def decided(
        self, observation: Observation, slot: Slot, earlier: OperatorAnswer | None
    ) -> Watched:
        """The decision of a slot: the method's if it is in time and passes, else the rule's.

        Args:
            observation: of the slot.
            slot: its data.
            earlier: what was decided, where that is done again: the same is late, and nothing else.

        Raises:
            CertificateError, SolverError: not even the rule's decision passes.
        """
        considered = self._considered(observation, earlier)
        if isinstance(considered, Fallback):
            return self.by_rule(observation, slot, considered)
        if problem := misshapen(considered.decision, observation):
            return self.by_rule(observation, slot, Fallback("unsound", problem))
        try:
            watched = self._carried_out(observation, slot, considered.decision)
        except Exception as error:
            return self.by_rule(observation, slot, Fallback("unsound", _words(error)))
        return watched._replace(why=considered.why, seconds=considered.seconds)

    def by_rule(self, observation: Observation, slot: Slot, fallback: Fallback) -> Watched:
        """The rule's decision of a slot.

        Raises:
            CertificateError, SolverError: it does not pass either.
        """
        decision = parts_of(self.rule.act(observation))
        return self._carried_out(observation, slot, decision)._replace(fallback=fallback)

    def _considered(
        self, observation: Observation, earlier: OperatorAnswer | None
    ) -> Considered | Fallback:
        """What the method says, or why it says nothing in time."""

        def act() -> Considered:
            began = time.perf_counter()
            decision = parts_of(self.dispatcher.act(observation))
            seconds = time.perf_counter() - began
            why = self.reasons.of_method(self.dispatcher, observation)
            return Considered(decision, tuple(why), seconds)

        future = self._worker.submit(act)
        then = None if earlier is None else earlier.fallback
        if then is not None and then.kind == "late":
            return then
        try:
            return future.result(timeout=self.time_limit_s if earlier is None else None)
        except TimeoutError:
            return Fallback("late", f"nothing within {self.time_limit_s:g} s")
        except Exception as error:  # whatever it is, the plant needs set-points
            return Fallback("failed", _words(error))

    def _carried_out(self, observation: Observation, slot: Slot, decision: Decision) -> Watched:
        """What follows a decision, audited.

        Raises:
            CertificateError: it does not pass.
        """
        step = self.present.step(observation, decision)
        audit = audit_step(self._audit, observation, slot.stacked, step)
        check_audit(audit, ())
        return Watched(decision, step, audit)


def misshapen(decision: Decision, observation: Observation) -> str:
    """Why something is no decision for what is observed, in words; empty where it is one."""
    shape, allowed = np.shape(decision.power), observation.energy.shape
    if shape != allowed:
        return f"an action of shape {shape}; allowed: {allowed}"
    for name, values in decision._asdict().items():
        if values is not None and not np.isfinite(values).all():
            return f"{name} holds what is no number"
    return ""


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
