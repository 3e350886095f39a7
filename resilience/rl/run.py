"""A training on disk: configuration, log, the last state to go on from, and the best policy.

RUN/config.json           everything that it was started with, digests and versions
RUN/log.jsonl             a line per validation, everything that is known
RUN/curve.csv             the same for spreadsheets
RUN/last.safetensors      what `--resume` goes on from
RUN/policy.safetensors    the best policy so far, which `compare --methods apg:RUN` takes
RUN/events                for TensorBoard, where it is installed
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from resilience.case import Case
from resilience.dispatch.registry import POLICY_FILE
from resilience.errors import SolverError, UsageError
from resilience.files import replacing_file
from resilience.progress import Meter, meter, phase
from resilience.rl.checkpoint import Header, case_digest, check_fits, load, save, versions
from resilience.rl.learner import under_prefix, with_prefix
from resilience.rl.observers import observer
from resilience.rl.trainer import Row, Training, TrainingOptions

CONFIG_FILE, LOG_FILE, CURVE_FILE = "config.json", "log.jsonl", "curve.csv"
LAST_FILE = "last.safetensors"
COLUMNS = ("iteration", "cpu_s", "loss", "cost_per_day", "gap")


class Run:
    """A training that keeps itself in a folder.

    Args:
        case: the case.
        options: how it is trained.
        folder: where; None: nothing is kept.
        resume: goes on from what is there.

    Raises:
        UsageError: a folder that holds something else, or a run to resume that does not fit.
    """

    def __init__(
        self, case: Case, options: TrainingOptions, folder: Path | None, resume: bool = False
    ) -> None:
        self.folder, self.rows = folder, list[Row]()
        earlier = self._earlier(options, resume)
        if earlier is not None:
            options = TrainingOptions(**(asdict(options) | {"iterations": earlier}))
        with phase("training ground"):
            self.training = Training(case, options)
        self.case = case
        env = self.training.env
        self.schema = observer(env.observer_name, env.setting).schema
        if resume and folder is not None:
            self._resume(folder)
        elif folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            self._write_text(CONFIG_FILE, json.dumps(self._config(), indent=2) + "\n")
        self.ended = ""

    @property
    def best(self) -> Row:
        """The line of the best policy."""
        return min(self.rows, key=lambda row: row.cost_per_day)

    @property
    def name(self) -> str:
        """What `compare --methods` takes, where the run is kept."""
        return f"{self.training.options.method}:{self.folder}"

    def summary(self) -> dict[str, Any]:
        """What came out, as plain data."""
        return {**self._config(), "ended": self.ended, "best": asdict(self.best)}

    def train(self) -> Run:
        """Trains to the end, keeping what it learns; itself, with the reason in `ended`."""
        training = self.training
        with meter("training", training.iterations) as progress:
            progress.advance(training.iteration)
            try:
                self.ended = training.run(
                    lambda row, best: self._on_row(row, best, progress),
                    lambda: progress.advance(1),
                )
            except SolverError as error:
                self.ended = str(error)
                if not self.rows:
                    raise
        return self

    def _on_row(self, row: Row, is_best: bool, progress: Meter) -> None:
        self.rows.append(row)
        progress.on(f"{row.cost_per_day:.3f} $/day, {100 * row.gap:.2f} % over the bound")
        if self.folder is None:
            return
        lines = [json.dumps(asdict(row)) for row in self.rows]
        self._write_text(LOG_FILE, "\n".join(lines) + "\n")
        table = [",".join(COLUMNS)]
        table += [",".join(repr(getattr(row, name)) for name in COLUMNS) for row in self.rows]
        self._write_text(CURVE_FILE, "\n".join(table) + "\n")
        self._events(row)
        if is_best:
            save(self.folder / POLICY_FILE, self.training.learner.weights(), self._header())
        # Last, so that what is resumed from is never ahead of what is written.
        state = with_prefix("learner", self.training.learner.state())
        save(self.folder / LAST_FILE, state, self._header())

    def _header(self) -> Header:
        training = self.training
        return Header(
            method=training.options.method,
            case=case_digest(self.case),
            schema=self.schema,
            iteration=training.iteration,
            config=training.config(),
            network=training.learner.network(),
            versions=versions(),
            notes={
                "cpu_s": training.cpu_s,
                "best_cost": training.best_cost,
                "worse": training.worse,
                "first_loss": training.first_loss,
                "rows": [asdict(row) for row in self.rows],
            },
        )

    def _resume(self, folder: Path) -> None:
        path, training = folder / LAST_FILE, self.training
        tensors, header = load(path)
        check_fits(path, header, self.case, self.schema)
        wanted = {k: v for k, v in training.config().items() if k != "budget_s"}
        given = {k: header.config.get(k) for k in wanted}
        differing = [k for k in wanted if _plain(wanted[k]) != _plain(given[k])]
        if differing:
            found = ", ".join(f"{k} = {wanted[k]!r}" for k in differing)
            allowed = ", ".join(f"{k} = {given[k]!r}" for k in differing)
            raise UsageError(
                f"{folder} cannot be resumed with {found}; allowed: {allowed}",
                hint="train into a new folder",
            )
        training.learner.load_state(under_prefix("learner", tensors))
        training.iteration = header.iteration
        notes = header.notes
        training.cpu_s, training.best_cost = notes["cpu_s"], notes["best_cost"]
        training.worse, training.first_loss = notes["worse"], notes["first_loss"]
        self.rows = [Row(**row) for row in notes["rows"]]

    def _earlier(self, options: TrainingOptions, resume: bool) -> int | None:
        """Iterations of the run that is to be resumed.

        Raises:
            UsageError: there is a run, but nobody said to resume it; or there is none.
        """
        if self.folder is None:
            return None
        has_run = (self.folder / LAST_FILE).is_file()
        if resume and not has_run:
            raise UsageError(
                f"{self.folder} holds no run to resume",
                hint="leave out --resume to begin one; a run can be resumed from its first "
                "validation on",
            )
        if not resume and (has_run or (self.folder.is_dir() and any(self.folder.iterdir()))):
            raise UsageError(
                f"{self.folder} is not empty",
                hint="--resume goes on with a run; or name a new folder",
            )
        if not has_run:
            return None
        iterations: int = load(self.folder / LAST_FILE)[1].config["iterations"]
        return options.iterations or iterations

    def _config(self) -> dict[str, Any]:
        header = self._header()
        return {
            "case": self.case.name,
            "case_digest": header.case,
            "observation_digest": header.schema,
            **header.config,
            "versions": header.versions,
        }

    def _write_text(self, name: str, text: str) -> None:
        assert self.folder is not None
        with replacing_file(self.folder / name) as fresh:
            fresh.write_text(text, encoding="utf-8")

    def _events(self, row: Row) -> None:
        writer = event_writer()
        if writer is None or self.folder is None:
            return
        with writer(str(self.folder / "events"), filename_suffix=f".{row.iteration}") as events:
            for name in COLUMNS[1:]:
                events.add_scalar(name, getattr(row, name), row.iteration)
            for name, value in row.more.items():
                events.add_scalar(name, value, row.iteration)


def event_writer() -> Callable[..., Any] | None:
    """TensorBoard's writer, None where it is not installed."""
    from importlib.util import find_spec

    if find_spec("tensorboard") is None:
        return None
    from torch.utils.tensorboard.writer import SummaryWriter

    return SummaryWriter


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value))
