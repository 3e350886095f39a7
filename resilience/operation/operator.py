"""A policy at work: asked slot by slot, watched, and remembered."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from resilience.case import Case
from resilience.dispatch.registry import REFERENCE, factory_of
from resilience.dispatch.window_plan import Planning, WindowPlan
from resilience.errors import FileError, UsageError, check_range
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.models.simulator import Step
from resilience.operation.answer import Fallback, OperatorAnswer, cut_back, set_points
from resilience.operation.journal import Journal, Record
from resilience.operation.outlook import copied, plan_summary, rolled_out
from resilience.operation.post import Post, head_of, operating_setting
from resilience.operation.present import CarriedOver, Present
from resilience.operation.state import State, StateReader
from resilience.operation.watchdog import Watchdog, Watched
from resilience.operation.why import Reasons
from resilience.simulation.forecast import ForecastError
from resilience.simulation.observation import Dispatcher, Observation
from resilience.simulation.slots import Slot

TIME_LIMIT_S = 10.0
POWER_TOLERANCE = 1e-9
"""MW by which a decision that is made again may differ from the one in the log."""


@dataclass(frozen=True)
class LastDecision:
    """What is kept of the slot decided last, so that the plan behind it can be told.

    Attributes:
        observation: of the slot.
        slot: its data.
        step: what followed the decision.
        by_rule: whether the rule decided.
    """

    observation: Observation
    slot: Slot
    step: Step
    by_rule: bool


class Operator:
    """Answers one decision per slot, from the present state and what it remembers.

    Every slot is decided once, whoever asks and however often. What is late, fails, or does not
    pass the audit is decided by the rule in its place. With a log, every decision is on the disk
    before it is given away, and an operator that starts anew goes on from there: it does the
    decisions of the log again, so that it remembers what it would have remembered.

    Threads may share one.

    Args:
        case: a case, its file, or the name of an installed one; its horizon is that of operation.
        method: who decides: a name that `compare` knows, or `METHOD:RUN`.
        log: file of the log; None: nothing is kept beyond the process.
        fallback: the rule that decides where the method cannot.
        time_limit_s: seconds after which a decision is late.
        physics: copperplate or lindistflow.
        believe: what is believed of outages to come: scenarios, or their file; the case's own
            process if omitted.
        forecast_error: how forecasts err, as the method knows it; None: not at all.
        end_value_per_mwh: worth of energy left at the end of the horizon, $/MWh; the case's if
            omitted.
        log_wait_s: seconds to wait for another process that uses the log.

    Attributes:
        setting: where decisions are made.
        head: what a log of it says first: all that decisions depend on beside states.
        warnings: what is to be known of the log that it goes on from.

    Raises:
        CaseError: the case has mistakes.
        UsageError: an unknown method, one that the case does not suit, or a log of something else.
        FileError: the log cannot be written.
    """

    def __init__(  # noqa: PLR0913 every one is an option of the command line
        self,
        case: Case | str | Path,
        method: str = "stochastic",
        *,
        log: str | Path | None = None,
        fallback: str = REFERENCE,
        time_limit_s: float = TIME_LIMIT_S,
        physics: Physics = "copperplate",
        believe: Scenarios | str | Path | None = None,
        forecast_error: ForecastError | None = None,
        end_value_per_mwh: float | None = None,
        log_wait_s: float = 0.0,
    ) -> None:
        check_range("time limit", time_limit_s, 0.0, 86400.0, hint="seconds")
        make = factory_of(method)
        post = Post(method, fallback, physics, believe, forecast_error, end_value_per_mwh)
        self.setting, fallible = operating_setting(case, post)
        self.method, self.fallback, self.time_limit_s = method, fallback, time_limit_s
        self._reader = StateReader(self.setting, fallible)
        self._present, self._reasons = Present(self.setting), Reasons(self.setting)
        self._watch = Watchdog(self._present, make, factory_of(fallback), time_limit_s)
        self._lock = threading.Lock()
        self._carried, self._since = CarriedOver.at_start(self.setting), dict[str, int]()
        self._answers, self._states = dict[int, OperatorAnswer](), dict[int, Mapping[str, Any]]()
        self._latest: LastDecision | None = None
        self._unwritten = list[Record]()
        self.warnings = list[str]()
        self._journal: Journal | None = None
        self.head = head_of(self.setting, post, make)
        if log is not None:
            self._journal = Journal(Path(log), self.head, log_wait_s)
            self._remember(self._journal.records)

    def __repr__(self) -> str:
        return f"<Operator {self.setting.case.name}: {self.method}, {len(self._answers)} decisions>"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Lets others use the log."""
        self._watch.stop()
        if self._journal is not None:
            self._journal.close()

    @property
    def is_at_work(self) -> bool:
        """Whether a method that was late is at work still, though the operator is closed."""
        return self._watch.is_at_work

    def decide(self, state: Mapping[str, Any], source: Path | None = None) -> OperatorAnswer:
        """The decision for the slot in which a state is.

        A slot that was decided before has the same answer again, whatever else the state says.

        Args:
            state: as JSON has it; see `resilience.operation.state.StateTable`.
            source: the file that it is from, for messages.

        Raises:
            CaseError: the state has mistakes; nothing is remembered of it.
            CertificateError, SolverError: not even the rule's decision passes.
        """
        with self._lock:
            checked = self._reader.read(state, source)
            if (earlier := self._answers.get(checked.t)) is not None:
                return self._repeated(earlier, checked)
            answer = self._decided(checked)
            self._answers[checked.t], self._states[checked.t] = answer, checked.stated
            return self._logged(checked, answer)

    def _repeated(self, earlier: OperatorAnswer, state: State) -> OperatorAnswer:
        now, then = dict(state.stated), dict(self._states[state.t])
        keys = sorted(k for k in {*now, *then} - {"time"} if now.get(k) != then.get(k))
        notes = [*earlier.notes]
        if keys:
            notes.append(f"the slot was decided with another {', '.join(keys)}")
        self._write()
        return replace(earlier, repeated=True, notes=notes)

    def _logged(self, state: State, answer: OperatorAnswer) -> OperatorAnswer:
        """The answer, once it is on the disk; where that cannot be, it says so."""
        if self._journal is None:
            return answer
        logged = datetime.now().astimezone().isoformat(timespec="milliseconds")
        self._unwritten.append(
            {"logged": logged, "state": state.stated, "answer": answer.summary()}
        )
        problem = self._write()
        return replace(answer, notes=[*answer.notes, problem]) if problem else answer

    def _write(self) -> str:
        """Writes what is not in the log yet; what is in the way, in words."""
        try:
            while self._unwritten and self._journal is not None:
                self._journal.append(self._unwritten[0])
                del self._unwritten[0]
        except FileError as error:
            return f"not in the log: {error.message}"
        return ""

    def _remember(self, records: list[Record]) -> None:
        """Does the decisions of a log again, and keeps what was answered then."""
        wrong = [self.setting.case.slot_label(slot) for slot in self.differing(records)]
        if wrong:
            self.warnings.append(
                f"{len(wrong)} decisions of the log come out otherwise now, the first at "
                f"{wrong[0]}: another version of the package or a library made them"
            )

    def differing(self, records: Iterable[Record]) -> list[int]:
        """Does the decisions of a log again; the slots of those that come out otherwise today.

        Raises:
            UsageError: a record is none of this case.
        """
        pairs = map(self.redone, records)
        return [answer.slot for answer, again in pairs if not alike(answer, again)]

    def redone(self, record: Record) -> tuple[OperatorAnswer, OperatorAnswer]:
        """An answer of a log, and what is decided today; slots in the order of the log.

        Raises:
            UsageError: it is no record of this case.
        """
        try:
            answer = OperatorAnswer.of_summary(record["answer"])
            state = self._reader.read(record["state"])
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(
                f"a record of the log cannot be read: {type(error).__name__}: {error}",
                hint="the file was changed; move it away to begin anew",
            ) from None
        again = self._decided(state, answer)
        self._answers[state.t], self._states[state.t] = answer, state.stated
        return answer, again

    def _decided(self, state: State, earlier: OperatorAnswer | None = None) -> OperatorAnswer:
        """The decision for a slot.

        Args:
            state: of the slot.
            earlier: what was decided, where that is done again: nothing is late then that was not.
        """
        notes, is_next = [*state.notes], state.t > self._carried.t
        if is_next:
            notes += self._caught_up(state.t)
        observation, slot = self._present.observed(state, self._carried)
        if is_next:
            self._notice(state)
            watched = self._watch.decided(observation, slot, earlier)
        else:
            last = self.setting.case.slot_label(self._carried.t)
            fallback = Fallback("clock", f"{last} has been decided, and this slot has not")
            watched = self._watch.by_rule(observation, slot, fallback)
        step = watched.step
        notes += cut_back(self._present, watched.decision, step)
        why = [*self._reasons.of_world(observation, self._since), *watched.why]
        if is_next:
            self._carried = CarriedOver.after(observation, step)
            self._latest = LastDecision(observation, slot, step, watched.fallback is not None)
        return self._answer(observation, slot, watched, why, notes)

    def _notice(self, state: State) -> None:
        """Takes notice of what is out, and since when."""
        elements = self._reader.elements
        out = [elements[k] for k in np.flatnonzero(~state.line_up[:, 0])]
        self._since = {name: self._since.get(name, state.t) for name in out}

    def _caught_up(self, t: int) -> list[str]:
        """Lets the method notice the slots that nobody asked for, a day of them at most."""
        first = self._carried.t + 1
        if first == 0 or first >= t:
            return []
        first = max(first, t - self.setting.case.window.slots_per_day)
        for slot in range(first, t):
            carried = replace(self._carried, t=slot - 1)
            observation = self._present.missed(slot, carried)
            self._watch.let_notice(observation)
        window = self.setting.case.window
        times = window.label(first), window.text(window.time(t))
        return [f"nothing was told of {times[0]} to {times[1]}: taken as before it"]

    def _answer(
        self,
        observation: Observation,
        slot: Slot,
        watched: Watched,
        why: list[str],
        notes: list[str],
    ) -> OperatorAnswer:
        window, audit, t = self.setting.case.window, watched.audit, observation.t
        worst = max(audit.worst, key=lambda name: audit.worst[name], default="")
        return OperatorAnswer(
            slot=t,
            begins=window.time(t),
            ends=window.time(t + 1),
            method=self.method,
            decided_by=self.method if watched.fallback is None else self.fallback,
            fallback=watched.fallback,
            **set_points(self._present, slot, watched.step)._asdict(),
            cost=float(np.reshape(watched.step.cost, -1)[0]),
            why=why,
            notes=notes,
            audit={"violation": audit.worst.get(worst, 0.0), "of": worst},
            seconds=watched.seconds,
        )

    def plan(self) -> WindowPlan | None:
        """The plan behind the decision made last: the method's own, or what it goes on to do if all
        comes as forecast; None where there is no decision yet, or the method cannot tell.

        Raises:
            UsageError: the method is still busy with a decision that was late.
        """
        with self._lock:
            latest = self._latest
            if latest is None:
                return None
            if latest.by_rule:
                return self._rolled(self._watch.rule, latest)
            try:
                return self._watch.ask(lambda: self._planned(latest))
            except TimeoutError:
                raise UsageError(
                    f"{self.method} is busy; allowed: a plan of what has been decided",
                    hint="ask again",
                ) from None

    def _planned(self, latest: LastDecision) -> WindowPlan | None:
        dispatcher = self._watch.dispatcher
        if isinstance(dispatcher, Planning):
            return dispatcher.latest_plan()
        return self._rolled(dispatcher, latest)

    def _rolled(self, dispatcher: Dispatcher, latest: LastDecision) -> WindowPlan | None:
        same = copied(dispatcher, self.setting)
        if same is None:
            return None
        return rolled_out(self.setting, same, latest.observation, latest.slot, latest.step)

    def plan_summary(self) -> dict[str, Any]:
        """The plan behind the decision made last as plain data; see `plan`."""
        plan, latest = self.plan(), self._latest
        by = self.fallback if latest is not None and latest.by_rule else self.method
        paths = 0 if plan is None else len(plan.probability)
        steps = [] if plan is None else plan_summary(plan, self.setting)
        return {"decided_by": by, "paths": paths, "steps": steps}

    def health(self) -> dict[str, Any]:
        """How it stands: what has been decided, by whom, and what is wrong."""
        answers = list(self._answers.values())
        slot = self._carried.t
        window = self.setting.case.window
        return {
            "status": "unwritten" if self._unwritten else "ok",
            "case": self.setting.case.name,
            "method": self.method,
            "decisions": len(answers),
            "by_rule": sum(answer.fallback is not None for answer in answers),
            "last_slot": window.time(slot).isoformat() if slot >= 0 else None,
            "horizon": str(window),
            "warnings": list(self.warnings),
        }

    @property
    def answers(self) -> list[OperatorAnswer]:
        """Every decision, by its slot."""
        return [self._answers[t] for t in sorted(self._answers)]


def alike(answer: OperatorAnswer, again: OperatorAnswer) -> bool:
    """Whether two answers for a slot are the same set-points by the same decider."""
    if answer.power_mw.keys() != again.power_mw.keys() or answer.decided_by != again.decided_by:
        return False
    return all(abs(again.power_mw[k] - v) <= POWER_TOLERANCE for k, v in answer.power_mw.items())
