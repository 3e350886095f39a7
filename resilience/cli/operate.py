"""`resilience operate` and `resilience serve`: a policy in operation, called or over HTTP."""

from __future__ import annotations

import atexit
import json
import os
import sys
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resilience.cli import options, terminal
from resilience.dispatch.registry import REFERENCE

if TYPE_CHECKING:
    from resilience.operation.operator import Operator

LOG_FILE = Path("operate.jsonl")
USUAL_METHOD = "stochastic"

OperatingMethod = Annotated[
    str,
    typer.Option(help=f"Who decides: {options.DISPATCHER_NAMES}.", metavar="METHOD"),
]
LogFile = Annotated[
    Path, typer.Option(help="Every decision with its inputs, a line each; it is also the memory.")
]
Fallback = Annotated[
    str, typer.Option(help="The rule that decides where the method is late, fails or is unsound.")
]
Late = Annotated[
    float, typer.Option("--late", help="Seconds after which a decision is late.", min=0.0)
]
BelieveFile = Annotated[
    Path | None,
    typer.Option(help="Scenarios of outages to believe in; the case's own process if omitted."),
]


def operate(
    case: options.CaseName,
    method: OperatingMethod = USUAL_METHOD,
    state: Annotated[
        Path,
        typer.Option(help="The present state, a JSON file; - for stdin.", metavar="FILE"),
    ] = Path("-"),
    log: LogFile = LOG_FILE,
    replay: Annotated[
        Path | None,
        typer.Option(help="In place of a state: a log to do again, and to compare with."),
    ] = None,
    fallback: Fallback = REFERENCE,
    late_s: Late = 10.0,
    physics: options.OnePhysics = "copperplate",
    believe: BelieveFile = None,
    forecast_error: options.ForecastErrors = "none",
    end_value: options.EndValue = None,
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """Decide the slot in which the present state is, and say why."""
    make = partial(
        _operator, case, method, fallback, late_s, physics, believe, forecast_error, end_value
    )
    if replay is not None:
        with terminal.progress(verbose), closing(make(None)) as operator:
            text, code = _replayed(operator, replay)
        terminal.show(partial(typer.echo, text))
        raise typer.Exit(code)
    with terminal.progress(verbose):
        stated = _read_state(state)
        with closing(make(log)) as operator:
            answer = operator.decide(stated, None if str(state) == "-" else state)
            plan = operator.plan_summary()
    atexit.register(_leave, operator)
    if as_json:
        text = json.dumps({**answer.summary(), "plan": plan}, indent=2, allow_nan=False)
        terminal.show(partial(typer.echo, text))
        return
    from resilience.text.console import plain_console
    from resilience.text.operation import print_answer

    terminal.show(partial(print_answer, answer, plan, plain_console()))


def serve(
    case: options.CaseName,
    method: OperatingMethod = USUAL_METHOD,
    host: Annotated[str, typer.Option(help="Address to listen at; a token for any other.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(help="0: any that is free.", min=0, max=65535)] = 8000,
    log: LogFile = LOG_FILE,
    fallback: Fallback = REFERENCE,
    late_s: Late = 10.0,
    physics: options.OnePhysics = "copperplate",
    believe: BelieveFile = None,
    forecast_error: options.ForecastErrors = "none",
    end_value: options.EndValue = None,
    verbose: options.Verbose = False,
) -> None:
    """Answer /decide, /plan and /health over HTTP; RESILIENCE_TOKEN holds the token, if any."""
    from resilience.extras import need

    need("serve", "resilience serve", "fastapi", "uvicorn")
    from resilience.operation import server

    token = os.environ.get(server.TOKEN_VARIABLE) or None
    server.check_exposure(host, token)
    with terminal.progress(verbose):
        operator = _operator(
            case, method, fallback, late_s, physics, believe, forecast_error, end_value, log
        )
    atexit.register(_leave, operator)
    with closing(operator):
        for line in operator.warnings:
            print(f"warning: {line}", file=sys.stderr)
        server.serve(operator, host=host, port=port, token=token, on_ready=_say_where)


def _leave(operator: Operator) -> None:
    """Ends the process where a method that was late is at work in its thread still: the answer is
    given, and solvers whose threads were torn down at work would abort the process.
    """
    if operator.is_at_work:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _say_where(address: str) -> None:
    print(f"serving at {address}", flush=True)


def _operator(
    case: str,
    method: str,
    fallback: str,
    late_s: float,
    physics: str,
    believe: Path | None,
    forecast_error: str,
    end_value: float | None,
    log: Path | None,
) -> Operator:
    from resilience.evaluation.compare import parse_error
    from resilience.operation.operator import Operator

    return Operator(
        case,
        method,
        log=log,
        fallback=fallback,
        time_limit_s=late_s,
        physics=physics,  # type: ignore[arg-type]
        believe=believe,
        forecast_error=parse_error(forecast_error),
        end_value_per_mwh=end_value,
        log_wait_s=late_s,
    )


def _read_state(path: Path) -> Any:
    """A state from its file or from stdin.

    Raises:
        UsageError: it cannot be read, or is no JSON.
    """
    from resilience.errors import UsageError, shortened
    from resilience.inputs import read_text

    source = "stdin" if str(path) == "-" else str(path)
    text = sys.stdin.read() if str(path) == "-" else read_text(path)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        value = shortened(text.strip()) or "nothing"
        raise UsageError(
            f"{source} holds {value!r}; allowed: a state in JSON ({error})",
            hint='{"time": "2016-07-12T14:00", "soc": {"ess1": 0.5}, "down": []}, say',
        ) from None


def _replayed(operator: Operator, path: Path) -> tuple[str, int]:
    """What comes of a log whose decisions are done again, in words, and the exit code."""
    from resilience.operation.journal import differences, read_journal

    head, records = read_journal(path)
    if differing := differences(operator.head, head):
        print(f"note: {path} is the log of another {' and '.join(differing)}", file=sys.stderr)
    wrong = operator.differing(records)
    by_rule = sum(record["answer"]["fallback"] is not None for record in records)
    counted = f"{len(records)} decisions by {head.get('method')}, {by_rule} of them by the rule"
    if not wrong:
        return f"{counted}: all come out as in {path}", 0
    times = ", ".join(operator.setting.case.slot_label(slot) for slot in wrong[:10])
    return f"{counted}: {len(wrong)} come out otherwise than in {path}, at {times}", 1
