"""Options of the command line, apart from what the commands do with them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from resilience.dispatch.registry import DISPATCHERS

CaseName = Annotated[
    str, Argument(metavar="CASE", help="A case file, or the name of an installed case.")
]
Verbose = Annotated[bool, Option("--verbose", "-v", help="Print every phase to stderr.")]
AsJson = Annotated[bool, Option("--json", help="Print one JSON object.")]

Method = Annotated[
    str,
    Option(
        help="lp, milp, socp, nlp, minlp or exact, which know the outages in advance; stochastic, "
        "which knows scenarios; or any dispatcher, simulated in the same scenarios.",
        metavar="METHOD",
    ),
]
Physics = Annotated[
    str | None, Option(help="copperplate, lindistflow or distflow; the method's own if omitted.")
]
Outages = Annotated[
    str | None,
    Option(
        help='"6-26@14:00-17:30, ...", a CSV file, bell or storm (one draw), or none; '
        "the case's own if omitted. Over scenarios: a .npz or .csv file of them; "
        "drawn from the case's process if omitted."
    ),
]
BellSeed = Annotated[int | None, Option(help="Of the draw; 0 if omitted.")]
Scenarios = Annotated[
    int | None,
    Option(help="Of stochastic and dispatchers: how many are drawn; 200 if omitted.", min=1),
]
Risk = Annotated[
    str | None,
    Option(
        help="Of stochastic: mean, or cvar:0.95:0.5, half the mean and half the mean of the worst "
        "5 %; mean if omitted.",
        metavar="RISK",
    ),
]
CommonSlots = Annotated[
    int | None,
    Option(
        help="Of stochastic: slots after which every scenario goes its own way; if omitted, each "
        "does when its own outage shows.",
        min=1,
    ),
]
Algorithm = Annotated[
    str | None,
    Option(help="Of stochastic: extensive or lshaped; by the size if omitted.", metavar="NAME"),
]
TimeLimit = Annotated[float, Option(help="Seconds for the search.", min=0.0)]
Gap = Annotated[
    float | None,
    Option(help="Relative gap to stop at; 0.001, of stochastic 0.0001, if omitted.", min=0.0),
]
Folder = Annotated[
    Path | None, Option(help="Folder for tables, summary.json and the case as solved.")
]
Picture = Annotated[
    Path | None,
    Option(
        help="Picture of the plan: a .png, .pdf or .svg file; called map, it is one of the feeder."
    ),
]
Page = Annotated[
    Path | None,
    Option("--html", help="One page to send, with everything in it: a .html file.", metavar="FILE"),
]
Export = Annotated[Path | None, Option(help="Also write the model: a .lp, .mps or .nl file.")]

DISPATCHER_NAMES = f"{', '.join(DISPATCHERS)}, rule-LEVEL, METHOD:RUN"
Methods = Annotated[str, Option(help=f"Dispatchers, with commas: {DISPATCHER_NAMES}.")]
Days = Annotated[
    int | None,
    Option(
        help="Days of an episode, the last of the profiles; 16; with a storm, the case's horizon."
    ),
]
MAX_STORMS = 10**9
"""More than any memory holds, and few enough for the shape of an array."""
ScenarioCount = Annotated[int, Option("-n", help="How many.", max=MAX_STORMS)]
ScenarioSeed = Annotated[int, Option(help="The same seed draws the same scenarios.")]
WholeDays = Annotated[
    int | None, Option(help="Whole days from the start; the case's horizon if omitted.")
]
ScenarioOut = Annotated[
    Path | None, Option(help="File to write: .npz keeps everything, .csv the outages.")
]
Track = Annotated[
    Path | None,
    Option(
        help="Storm track, IBTrACS, HURDAT2, CMA or plain CSV; the storm of the case if omitted.",
        metavar="FILE",
    ),
]
TrackStorm = Annotated[
    str | None, Option("--storm", help="Name or identifier, of several in the track file.")
]
Averaging = Annotated[
    float | None,
    Option(help="Seconds that the track's wind is averaged over, where its file does not say."),
]
Agency = Annotated[
    str | None,
    Option(
        help="Whose winds: the columns of IBTrACS, or the practice of a plain CSV file's agency: "
        "usa, tokyo, cma, hko, newdelhi, reunion, bom, nadi, wellington."
    ),
]
HazardPicture = Annotated[
    Path | None, Option("--plot", help="Map and curves: a .png, .pdf or .svg file.")
]
HazardFolder = Annotated[
    Path | None, Option("--out", help="Folder for probabilities, islands and scenarios.")
]
Draws = Annotated[int, Option(help="Outage paths, an episode each.", min=1)]
Seed = Annotated[int, Option(help="Of the outage paths.", min=0)]
EndValue = Annotated[
    float | None,
    Option(help="Worth of energy left, $/MWh; the case's terminal value if omitted."),
]
ReportPicture = Annotated[
    Path | None, Option(help="Picture of the comparison: a .png, .pdf or .svg file.")
]

DrawnMethods = Annotated[
    str | None,
    Option(help="Of a comparison: the dispatchers whose storm is drawn, with commas, up to 6."),
]
DrawnEpisode = Annotated[
    int | None, Option(help="Number of the episode from 1; the one shedding most if omitted.")
]
DrawnDay = Annotated[
    str | None, Option(help='Number of the day from 1, or "all"; the worst one if omitted.')
]
ScenarioFile = Annotated[
    Path | None,
    Option(help="Outage paths in place of draws: what `resilience scenarios --out` writes."),
]
Believe = Annotated[
    str | None,
    Option(
        metavar="FILE",
        help="What operators believe of outages to come where --scenarios are given: other "
        "scenarios, `case` for the case's own process, or `same`.",
    ),
]
CheckCausality = Annotated[
    bool,
    Option("--check-causality", help="First check that no method acts on what is yet to come."),
]
Schedule = Annotated[
    bool, Option("--schedule", help="Also print what every unit does, hour by hour.")
]
Prices = Annotated[
    bool,
    Option(
        "--prices",
        help="Also say what a MWh costs: lowest, mean and highest over buses, hour by hour; "
        "--out has every bus and slot. Not over scenarios.",
    ),
]
DualBound = Annotated[
    bool,
    Option(
        "--dual-bound",
        help="Also prove what nobody without foreknowledge stays below: a clairvoyant who pays "
        "for what it foresees.",
    ),
]
OnePhysics = Annotated[
    str, Option(help="Of everybody, the bound included: copperplate or lindistflow.")
]
ForecastErrors = Annotated[
    str,
    Option(
        help="Of load and PV: none, ar1 (measured: 2.5 %, correlation 0.97), feeder (10 %, 0.97, "
        "70 % of it common), gaussian (2.5 %, none), or SIGMA,RHO[,COMMON].",
        metavar="ERRORS",
    ),
]
UnknownCentre = Annotated[
    bool, Option("--unknown-centre", help="Operators are not told when a day's storm peaks.")
]
ResetDaily = Annotated[
    bool,
    Option("--reset-daily", help="State of charge starts anew every midnight; gives energy away."),
]
AC = Annotated[bool, Option("--ac", help="Certify all trajectories by AC power flow.")]
Workers = Annotated[int, Option(help="Processes; numbers do not depend on it.", min=1)]
EngineName = Annotated[str, Option("--engine", help="Who runs them: local, dask or ray.")]
ReportFolder = Annotated[
    Path | None,
    Option(help="Folder for the report and its data; an interrupted run goes on from it."),
]
