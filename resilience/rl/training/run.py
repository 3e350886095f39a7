"""A training on disk: configuration, log, the last state to go on from, and the best policy.

RUN/config.json           everything that it was started with, digests and versions
RUN/log.jsonl             a line per validation, everything that is known
RUN/curve.csv             the same for spreadsheets
RUN/last.safetensors      what `--resume` goes on from
RUN/policy.safetensors    the best policy so far, which `compare --methods apg:RUN` takes
RUN/result.json           the best line, and why training ended; once it has
RUN/events                for TensorBoard, where it is installed

A process may be killed at any time: every file appears whole, and `last.safetensors` after
whatever belongs to it. What is written again after that is the same but for the seconds. The folder
is locked while its training lasts, so that there is one at a time.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from resilience.case import Case
from resilience.dispatch.registry import POLICY_FILE
from resilience.errors import SolverError, UsageError
from resilience.files import check_folder, clear_abandoned, locked, reading, replacing_file
from resilience.progress import Meter, interruptible, meter, notice, phase
from resilience.rl.checkpoint import Header, case_digest, check_fits, load, save, versions
from resilience.rl.ground.observers import observer
from resilience.rl.learning.learner import under_prefix, with_prefix
from resilience.rl.training.curves import COLUMNS, CONFIG_FILE, CURVE_FILE, LAST_FILE, RESULT_FILE
from resilience.rl.training.trainer import LogRow, Training, TrainingOptions

LOG_FILE = "log.jsonl"
EVENTS_FOLDER = "events"
CHECKPOINT_S = 30.0  # of work that is lost at most, where an iteration is shorter


@dataclass
class Notes:
    """What stands beside the state of a training.

    Attributes:
        cpu_s: CPU-seconds of training so far.
        best_cost: of the best policy on the validation days, $; None before there is one.
        worse: validations since then.
        first_loss: size of the first loss; None before there is one.
        rows: of the log.
    """

    cpu_s: float
    best_cost: float | None
    worse: int
    first_loss: float | None
    rows: list[LogRow]


class Run:
    """A training that keeps itself in a folder.

    Args:
        case: the case.
        options: how it is trained.
        folder: where; None: nothing is kept.
        resume: goes on from what is there; begins anew where a run was killed before it had kept
            anything.

    Raises:
        UsageError: a folder that holds something else, a run to resume that does not fit, or one
            that another process is at work on.
        FileError: a folder that cannot be written to.
    """

    def __init__(
        self, case: Case, options: TrainingOptions, folder: Path | None, resume: bool = False
    ) -> None:
        self.folder, self.rows, self.ended = folder, list[LogRow](), ""
        with _alone_in(folder, resume):
            self._begin(case, options, folder, resume)

    def _begin(
        self, case: Case, options: TrainingOptions, folder: Path | None, resume: bool
    ) -> None:
        goes_on = folder is not None and self._goes_on(folder, resume)
        if folder is not None and goes_on and options.iterations is None:
            header = load(folder / LAST_FILE)[1]
            with reading(folder / LAST_FILE, "state of a training"):
                options = replace(options, iterations=int(header.config["iterations"]))
        with phase("training ground"):
            self.training = Training(case, options)
        self.case = case
        env = self.training.env
        self.schema = observer(env.observer_name, env.setting).schema
        if folder is None:
            return
        if goes_on:
            self._resume(folder)
        else:
            self._write_json(CONFIG_FILE, self._config())
            self._keep()
        self.kept_at = time.monotonic()

    def __repr__(self) -> str:
        options = self.training.options
        done = f"iteration {self.training.iteration} of {self.training.iterations}"
        best = f", best {self.best.cost_per_day:.4f} $/day" if self.rows else ""
        where = "" if self.folder is None else f", in {self.folder}"
        return f"<Run {self.case.name}: method {options.method}, {done}{best}{where}>"

    @property
    def best(self) -> LogRow:
        """The line of the best policy."""
        return min(self.rows, key=lambda row: row.cost_per_day)

    @property
    def _interface(self) -> dict[str, Any]:
        """What goes into the network and what comes out, for programs without the case."""
        env = self.training.env
        return {
            "inputs": env.size,
            "units": list(env.simulator.units),
            "observation": [
                asdict(block) for block in observer(env.observer_name, env.setting).blocks
            ],
        }

    @property
    def name(self) -> str:
        """What `compare --methods` takes, where the run is kept."""
        return f"{self.training.options.method}:{self.folder}"

    def summary(self) -> dict[str, Any]:
        """What came out, as plain data."""
        return {**self._config(), "ended": self.ended, "best": _finite(asdict(self.best))}

    def train(self) -> Run:
        """Trains to the end, keeping what it learns; itself, with the reason in `ended`.

        Raises:
            SolverError: training broke down before there was a policy.
        """
        training = self.training
        with (
            _alone_in(self.folder),
            interruptible(self._what_is_there),
            meter("training", training.iterations) as progress,
        ):
            progress.advance(training.iteration)
            pace = _Pace(training)
            try:
                self.ended = training.run(
                    lambda row, is_best: self._on_row(row, is_best, progress, pace),
                    lambda: self._on_iteration(progress),
                )
            except SolverError as error:
                self.ended = error.message
                if not self.rows:
                    raise
            if self.folder is not None:
                self._write_json(RESULT_FILE, {"ended": self.ended, "best": asdict(self.best)})
        return self

    def _what_is_there(self) -> str:
        if self.folder is None:
            return "nothing was written; with --out FOLDER, a training can be resumed"
        return (
            f"iteration {self.kept_iteration} of {self.training.iterations} is in {self.folder}; "
            "the same command with --resume goes on"
        )

    def _on_iteration(self, progress: Meter) -> None:
        progress.advance(1)
        if self.folder is not None and time.monotonic() - self.kept_at > CHECKPOINT_S:
            self._keep()

    def _on_row(self, row: LogRow, is_best: bool, progress: Meter, pace: _Pace) -> None:
        self.rows.append(row)
        progress.on(
            f"iteration {row.iteration} of {self.training.iterations}: "
            f"{row.cost_per_day:.3f} $/day, {100 * row.gap:.2f} % over the bound, "
            f"{pace.left_s(row.iteration):.0f} s left"
        )
        if self.folder is None:
            return
        lines = [json.dumps(_finite(asdict(row))) for row in self.rows]
        self._write_text(LOG_FILE, "\n".join(lines) + "\n")
        table = [",".join(COLUMNS)]
        table += [",".join(repr(getattr(row, name)) for name in COLUMNS) for row in self.rows]
        self._write_text(CURVE_FILE, "\n".join(table) + "\n")
        self._events(row)
        if is_best:
            # Nothing measured is in it, so that the same training gives the same bytes.
            notes = {"cost_per_day": row.cost_per_day, "gap": row.gap, **self._interface}
            weights = self.training.learner.weights()
            save(self.folder / POLICY_FILE, weights, self._header(notes))
        self._keep()

    def _keep(self) -> None:
        """Writes what to go on from; last of all, so that it is never ahead of what is written."""
        assert self.folder is not None
        training = self.training
        best_cost = training.best_cost if self.rows else None
        notes = Notes(training.cpu_s, best_cost, training.worse, training.first_loss, self.rows)
        state = with_prefix("learner", training.state())
        save(self.folder / LAST_FILE, state, self._header(asdict(notes)))
        self.kept_at, self.kept_iteration = time.monotonic(), training.iteration

    def _header(self, notes: dict[str, Any]) -> Header:
        training = self.training
        return Header(
            method=training.options.method,
            case=case_digest(self.case),
            schema=self.schema,
            iteration=training.iteration,
            config=training.config(),
            network=training.learner.network(),
            versions=versions(),
            notes=notes,
        )

    def _resume(self, folder: Path) -> None:
        path, training = folder / LAST_FILE, self.training
        tensors, header = load(path)
        check_fits(path, header, self.case, self.schema)
        config = {k: v for k, v in training.config().items() if k != "budget_s"}
        earlier = {k: header.config.get(k) for k in config}
        differing = [k for k in config if _plain(config[k]) != _plain(earlier[k])]
        if differing:
            text = ", ".join(f"{k} = {config[k]!r}" for k in differing)
            allowed = ", ".join(f"{k} = {earlier[k]!r}" for k in differing)
            raise UsageError(
                f"{folder} cannot be resumed with {text}; allowed: {allowed}",
                hint="say the same as when it was begun, or train into a new folder",
            )
        with reading(path, "state of a training"):
            training.learner.load_state(under_prefix("learner", tensors))
            self._take(header)
        self.kept_iteration = training.iteration
        notice(f"{folder}: goes on at iteration {training.iteration} of {training.iterations}")

    def _take(self, header: Header) -> None:
        """Takes counts and rows from where the run was left.

        Raises:
            ValidationError: they are none.
            ValueError: more was done than there is to do.
        """
        training, notes = self.training, TypeAdapter(Notes).validate_python(header.notes)
        if header.iteration > training.iterations:
            raise ValueError(f"iteration {header.iteration} of {training.iterations}")
        training.iteration, training.worse = header.iteration, notes.worse
        training.cpu_s, training.first_loss = notes.cpu_s, notes.first_loss
        training.best_cost = math.inf if notes.best_cost is None else notes.best_cost
        self.rows = notes.rows

    def _goes_on(self, folder: Path, resume: bool) -> bool:
        """Whether there is a run to go on with; otherwise it begins.

        Raises:
            UsageError: there is a run, but nobody said to resume it; or there is something else.
        """
        clear_abandoned(folder)
        has_run = (folder / LAST_FILE).is_file()
        if has_run and not resume:
            raise UsageError(
                f"{folder} holds a run", hint="--resume goes on with it; or name a new folder"
            )
        if has_run:
            return True
        names = sorted(path.name for path in folder.iterdir())
        if others := ", ".join(name for name in names if name != CONFIG_FILE):
            raise UsageError(f"{folder} holds no run, but {others}", hint="name a new folder")
        if names or resume:
            notice(f"{folder} was left before its first checkpoint; training begins")
        return False

    def _config(self) -> dict[str, Any]:
        header = self._header({})
        return {
            "case": self.case.name,
            "case_digest": header.case,
            "observation_digest": header.schema,
            **header.config,
            "versions": header.versions,
        }

    def _write_json(self, name: str, values: dict[str, Any]) -> None:
        self._write_text(name, json.dumps(_finite(values), indent=2) + "\n")

    def _write_text(self, name: str, text: str) -> None:
        assert self.folder is not None
        with replacing_file(self.folder / name) as fresh:
            fresh.write_text(text, encoding="utf-8")

    def _events(self, row: LogRow) -> None:
        writer = event_writer()
        if writer is None or self.folder is None:
            return
        folder, suffix = self.folder / EVENTS_FOLDER, f".{row.iteration}"
        for earlier in folder.glob(f"*{suffix}"):  # of a process that was killed after it
            earlier.unlink()
        with writer(str(folder), filename_suffix=suffix) as events:
            for name, value in {**asdict(row), **row.more}.items():
                if name not in ("iteration", "more"):
                    events.add_scalar(name, value, row.iteration)


@contextmanager
def _alone_in(folder: Path | None, resume: bool = False) -> Iterator[None]:
    """No other process trains in the folder, if there is any; it is made where a run may begin.

    Raises:
        UsageError: another does, it is a file, or there is no folder to resume from.
        FileError: the folder cannot be written to.
    """
    if folder is None:
        yield
        return
    check_folder(folder)
    is_new = not folder.is_dir()
    if resume and is_new:
        raise UsageError(f"{folder} holds no run to resume", hint="leave out --resume to begin one")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with ExitStack() as stack:
            _lock(folder, stack)
            yield
    except BaseException:
        if is_new:
            with suppress(OSError):
                folder.rmdir()  # unless something is in it
        raise


def _lock(folder: Path, stack: ExitStack) -> None:
    try:
        stack.enter_context(locked(folder, wait=False))
    except BlockingIOError:
        raise UsageError(
            f"another process trains in {folder}; allowed: one at a time",
            hint="wait until it has ended, or name a new folder",
        ) from None


class _Pace:
    """How long the iterations that are left will take.

    Args:
        training: as it is when the clock starts.
    """

    def __init__(self, training: Training) -> None:
        self.first, self.last = training.iteration, training.iterations
        self.began = time.monotonic()

    def left_s(self, iteration: int) -> float:
        """Seconds, if the rest goes as fast as what was done since the start."""
        seconds = time.monotonic() - self.began
        return seconds / max(iteration - self.first, 1) * (self.last - iteration)


def event_writer() -> Callable[..., Any] | None:
    """TensorBoard's writer, None where it is not installed."""
    from importlib.util import find_spec

    if find_spec("tensorboard") is None:
        return None
    from torch.utils.tensorboard.writer import SummaryWriter

    return SummaryWriter


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value))


def _finite(value: Any) -> Any:
    """The same with None for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
