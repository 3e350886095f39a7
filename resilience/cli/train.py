"""The commands `resilience train`, `export` and `env`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from resilience.cli import options, terminal
from resilience.errors import UsageError
from resilience.inputs import to_number
from resilience.rl.algorithms.registry import ALGORITHMS

METHODS = "; ".join(f"{name}: {entry.about}" for name, entry in ALGORITHMS.items())


CaseName = Annotated[
    str, typer.Argument(metavar="CASE", help="Case file, or name of an installed case.")
]
Method = Annotated[str, typer.Option(help=f"Algorithm. {METHODS}.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with the run in --out.")]
Seeds = Annotated[str, typer.Option(help="Seeds with commas, a run each.")]
Budget = Annotated[
    str, typer.Option(help="CPU time per seed, as 120s or 10m; becomes iterations once.")
]
Iterations = Annotated[int | None, typer.Option(help="Iterations, in place of a budget.", min=1)]
TrainingBand = Annotated[str | None, typer.Option(help="How outputs become MW: anchors or affine.")]
Baseline = Annotated[
    str, typer.Option(help="Whose cost rewards are relative to: none, idle or rule.")
]
Days = Annotated[int, typer.Option(help="Days of an episode.", min=1)]
Patience = Annotated[
    int, typer.Option(help="Stop after so many validations without gain; 0: never.", min=0)
]
SettingPairs = Annotated[
    list[str] | None, typer.Option("--set", help="A setting of the algorithm, as batch=256.")
]
ShowSettings = Annotated[
    bool, typer.Option("--settings", help="Say what the algorithm's settings are, and stop.")
]


def train(
    case: CaseName = "ieee33",
    method: Method = "apg",
    out: Annotated[Path | None, typer.Option(help="Folder of the run.")] = None,
    resume: Resume = False,
    seeds: Seeds = "0",
    budget: Budget = "120s",
    iterations: Iterations = None,
    band: TrainingBand = None,
    baseline: Baseline = "rule",
    days: Days = 1,
    forecast_error: options.ForecastErrors = "none",
    unknown_centre: options.UnknownCentre = False,
    patience: Patience = 0,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    setting: SettingPairs = None,
    show_settings: ShowSettings = False,
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """Train a learning dispatcher; `compare --methods METHOD:RUN` judges it."""
    from resilience.extras import need

    need("learn", "training", "torch", "safetensors")
    if show_settings:
        _print_settings(method, _settings(setting or []))
        return
    from resilience.rl.training.train import train as train_policies

    with terminal.progress(verbose):
        runs = train_policies(
            case,
            method,
            out=out,
            resume=resume,
            seeds=_seeds(seeds),
            budget_s=_seconds(budget),
            iterations=iterations,
            band=band,
            baseline=baseline,
            days=days,
            forecast_error=forecast_error,
            known_centre=not unknown_centre,
            patience=patience,
            device=device,
            **_settings(setting or []),
        )
    if as_json:
        typer.echo(json.dumps([run.summary() for run in runs], indent=2, allow_nan=False))
        return
    from resilience.text.console import plain_console
    from resilience.text.training import print_runs

    print_runs(runs, plain_console())
    terminal.print_written(("run", out))


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder that train wrote.")],
    to: Annotated[
        Path, typer.Option(help="File to write: .npz for NumPy, .pt2 for torch, or .onnx.")
    ],
) -> None:
    """Write the best policy of a run for other programs, checked against it."""
    from resilience.extras import need

    need("learn", "exporting", "torch", "safetensors")
    from resilience.rl.export import CHECKED, export_policy

    difference = export_policy(run, to)
    typer.echo(f"policy: {to}, as the run's to {difference:.1e} on {CHECKED} observations")


def env(
    case: CaseName,
    check: Annotated[
        bool, typer.Option("--check", help="Run the official checks of Gymnasium and PettingZoo.")
    ] = False,
    band: Annotated[
        str, typer.Option(help="How actions become MW: anchors or affine.")
    ] = "anchors",
    days: Days = 1,
    forecast_error: options.ForecastErrors = "none",
    unknown_centre: options.UnknownCentre = False,
    as_json: options.AsJson = False,
) -> None:
    """Say what learners see and do in a case; with --check, hold it against the official checks."""
    from resilience.case import load_case
    from resilience.rl.adapters.play import Play

    ground: dict[str, Any] = {
        "band_name": band,
        "days": days,
        "forecast_error": forecast_error,
        "known_centre": not unknown_centre,
    }
    loaded = load_case(case)
    facts = Play(loaded, **ground).facts()
    checks = []
    if check:
        from resilience.rl.adapters.checks import check_environments

        checks = check_environments(loaded, **ground)
    if as_json:
        results = [asdict(result) for result in checks]
        typer.echo(json.dumps(facts | {"checks": results}, indent=2, allow_nan=False))
    else:
        from resilience.text.console import plain_console
        from resilience.text.training import print_environment

        print_environment(facts, checks, plain_console())
    if any(result.verdict == "failed" for result in checks):
        raise typer.Exit(1)


def _print_settings(method: str, values: dict[str, Any]) -> None:
    """What the settings of an algorithm are, of the variant that is among these."""
    from resilience.rl.algorithms.described import described
    from resilience.rl.algorithms.registry import algorithm
    from resilience.text.console import plain_console
    from resilience.text.training import print_settings

    variant = {name: value for name, value in values.items() if name == "variant"}
    print_settings(method, described(algorithm(method).settings_kind(**variant)), plain_console())


def _seeds(text: str) -> list[int]:
    """Seeds from `0,1,2`."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not all(word.isascii() and word.isdigit() and len(word) < 20 for word in words):
        raise UsageError(
            f"seeds {text!r}; allowed: whole numbers with commas", hint="--seeds 0,1,2"
        )
    return [int(word) for word in words]


def _seconds(text: str) -> float:
    """Seconds from `120s`, `10m` or `120`."""
    unit = {"s": 1.0, "m": 60.0, "h": 3600.0}.get(text[-1:], 0.0)
    seconds = to_number(text[:-1] if unit else text)
    if seconds is None or not 0.0 < seconds * (unit or 1.0) < 1e6:
        raise UsageError(
            f"budget {text!r}; allowed: a time such as 120s or 10m", hint="--budget 120s"
        )
    return seconds * (unit or 1.0)


def _settings(pairs: list[str]) -> dict[str, Any]:
    """Settings from `name=value`, values as JSON where they are."""
    settings: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals:
            raise UsageError(f"--set {pair!r}; allowed: NAME=VALUE", hint="--set batch=256")
        try:
            value = json.loads(text)
        except (ValueError, RecursionError):
            value = text
        settings[name.strip()] = tuple(value) if isinstance(value, list) else value
    return settings
