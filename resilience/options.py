"""Options of the command line, apart from what the commands do with them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

CaseName = Annotated[
    str, Argument(metavar="CASE", help="A case file, or the name of an installed case.")
]
Verbose = Annotated[bool, Option("--verbose", "-v", help="Print every phase to stderr.")]
AsJson = Annotated[bool, Option("--json", help="Print one JSON object.")]

Method = Annotated[str, Option(help="lp, milp, socp, nlp, minlp or exact.", metavar="METHOD")]
Physics = Annotated[
    str | None, Option(help="copperplate, lindistflow or distflow; the method's own if omitted.")
]
Outages = Annotated[
    str | None,
    Option(
        help='"6-26@14:00-17:30, ...", a CSV file, bell (one draw), or none; '
        "the case's own if omitted."
    ),
]
BellSeed = Annotated[int | None, Option(help="Of the draw of the bell; 0 if omitted.")]
TimeLimit = Annotated[float, Option(help="Seconds for the search.", min=0.0)]
Gap = Annotated[float, Option(help="Relative gap to stop at.", min=0.0)]
Folder = Annotated[
    Path | None, Option(help="Folder for tables, summary.json and the case as solved.")
]
Picture = Annotated[Path | None, Option(help="Picture of the plan: a .png, .pdf or .svg file.")]
Export = Annotated[Path | None, Option(help="Also write the model: a .lp, .mps or .nl file.")]

Methods = Annotated[
    str, Option(help="Dispatchers, with commas: idle, greedy, rule, mpc-blind, mpc, stochastic.")
]
Days = Annotated[int, Option(help="Days of an episode, the last of the profiles.")]
Draws = Annotated[int, Option(help="Outage paths, an episode each.", min=1)]
Seed = Annotated[int, Option(help="Of the outage paths.", min=0)]
EndValue = Annotated[
    float | None,
    Option(help="Worth of energy left, $/MWh; the case's terminal value if omitted."),
]
ReportFolder = Annotated[Path | None, Option(help="Folder for the report and its data.")]
