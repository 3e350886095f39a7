r"""Angles of lines: what parallel ones share, what closes loops, and how far voltages may part.

Parallel lines share what they carry as their impedances have it. They have one angle between their
ends, and $V_i V_j^* = a (v_i / \tau^2 - (r - \mathrm{j} x)(P + \mathrm{j} Q))$ is the same for
all of them. Its imaginary part, divided by the first one's $e^{\mathrm{j} \varphi}$, gives for two
lines of equal shift

$$ \tau_1 (r_1 Q_1 - x_1 P_1) = \tau_2 (r_2 Q_2 - x_2 P_2) $$

where both are up (with the other sign on the right if they point in opposite directions).

Lines in a loop have to agree in their angles. With $r_l + \mathrm{j} i_l = v_i / \tau^2
- (r - \mathrm{j} x)(P + \mathrm{j} Q)$ and $\varphi'$, what phase shifts leave round the loop,

$$ \theta_i - \theta_j - \varphi' - \delta = \operatorname{atan2}(x P - r Q,\;
v_i / \tau^2 - r P - x Q) $$

exactly (`resilience.models.structures.angle`), and without losses $\tau (x P - r Q)$ on the right.
The slack $\delta$ opens where the line is out. Trees have no such rows: there angles always exist.

Limits of angles, $\underline{\theta} \le \theta_i - \theta_j - \varphi \le
\overline{\theta}$ within 90 degrees of zero, are rows where the line's rating lets them bind:

$$ \tan \underline{\theta}\; r_l \le i_l \le \tan \overline{\theta}\; r_l $$

and without losses $\underline{\theta} \le \tau (x P - r Q) \le \overline{\theta}$. A line that
carries nothing keeps them, so they need no slack. At copperplate there are no angles.

| symbol | name | unit |
|---|---|---|
| $\theta_b$ | `bus.angle`, only where lines make loops | rad |
| $\delta$ | `line.turn`, angle across an open line of a loop | rad |
| | `line.twist`, what parallel lines differ by where one is out | pu |
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Affine, labelled, scatter
from resilience.models.components.line_data import LineData
from resilience.models.language.stage import Stage

RIGHT_ANGLE = 0.5 * np.pi  # rad: from here on a limit says nothing
TURN_MAX = 7.0  # rad: two angles of buses, and what phase shifts leave


def share(lines: LineData, stage: Stage, p: Affine, q: Affine, v_i: Affine) -> None:
    """Parallel lines that are both up have one angle between their ends."""
    first, second, sign = parallel(lines)
    if lines.looped is not None and not lines.losses:
        # Their own angles say it, and to the first order in another way.
        keep = ~lines.looped[first]
        first, second, sign = first[keep], second[keep], sign[keep]
    if not len(first):
        return
    tap, shift = lines.tap, np.angle(lines.ratio)
    apart = sign * shift[second] - shift[first]
    twist = (q * lines.r - p * lines.x) * tap
    second_twist = twist[second] * (sign * np.cos(apart))
    if apart.any():
        along = (v_i - p * lines.r - q * lines.x) * tap
        second_twist = second_twist - along[second] * np.sin(apart)
    limit = 2.0 * np.maximum(*lines.peaks[:2]) * (np.abs(lines.r) + np.abs(lines.x)) * tap
    twist_max = limit[first] + limit[second]
    if apart.any():
        assert lines.v_max is not None
        v_max = lines.v_max[lines.from_bus] ** 2 / tap
        twist_max = twist_max + np.abs(np.sin(apart)) * v_max[second]
    names = [lines.names[k] for k in second]
    up = stage["line.up"]
    free = (2.0 - up[first] - up[second]) * twist_max
    gap = stage.var("line.twist", names, -free, free, unit="pu", about="angle if one is out")
    stage.eq("line.angle", twist[first] - second_twist - gap)


def close_loops(
    lines: LineData,
    stage: Stage,
    flow: tuple[Affine, Affine],
    v_sq: tuple[Affine, Affine],
    closed: Affine | None,
) -> None:
    """Lines of a loop have the angles of their buses between their ends.

    Args:
        lines: all lines.
        stage: to state it in.
        flow: P and Q.
        v_sq: squared voltages at both ends, the first behind the ratio.
        closed: status of the lines of which it is decided.
    """
    if lines.looped is None or lines.loop_shift is None or not lines.looped.any():
        return
    (p, q), (v_i, v_j), rows = flow, v_sq, np.flatnonzero(lines.looped)
    i, j = lines.from_bus[rows], lines.to_bus[rows]
    buses, names = np.unique([i, j]), tuple(lines.names[k] for k in rows)
    angle = stage["bus.angle"]
    ends = np.searchsorted(buses, i), np.searchsorted(buses, j)
    theta = angle[ends[0]] - angle[ends[1]] - lines.loop_shift[rows]
    free = np.flatnonzero((lines.fallible | lines.decided)[rows])
    if len(free):
        is_switched = lines.decided[rows[free]]
        room = TURN_MAX - stage["line.up"][rows[free]] * (TURN_MAX * ~is_switched)
        turn = stage.var(
            "line.turn", [names[k] for k in free], -room, room, unit="rad",
            about="angle across open line",
        )  # fmt: skip
        if closed is not None and is_switched.any():
            place = np.searchsorted(np.flatnonzero(lines.decided), rows[free[is_switched]])
            open_lines = turn[np.flatnonzero(is_switched)]
            stage.switch("line.turn.switch", open_lines, 1.0 - closed[place], TURN_MAX)
        theta = theta - scatter(turn, free, len(rows))
    im = (p * lines.x - q * lines.r)[rows]
    if not lines.losses:
        stage.eq("line.loop", labelled(theta - im * lines.tap[rows], names))
        return
    re = (v_i - p * lines.r - q * lines.x)[rows]
    stage.angle("line.loop", labelled(theta, names), re, im, (v_i[rows], v_j[rows]))


def limit_angles(lines: LineData, stage: Stage, flow: tuple[Affine, Affine], v_i: Affine) -> None:
    """No line has a larger angle between its ends than it may.

    Args:
        lines: all lines.
        stage: to state it in.
        flow: P and Q, into the impedance.
        v_i: squared voltage at the first end, behind the ratio.
    """
    (p, q), reach = flow, _angles_let_through(lines)
    im, re = p * lines.x - q * lines.r, v_i - p * lines.r - q * lines.x
    for name, limit, sign in (
        ("line.angle_min", -lines.angle_min, -1.0),
        ("line.angle_max", lines.angle_max, 1.0),
    ):
        rows = np.flatnonzero((limit < reach) & (limit < RIGHT_ANGLE))
        if not len(rows):
            continue
        names, width = tuple(lines.names[k] for k in rows), limit[rows]
        if lines.losses:
            beyond = im[rows] * sign - re[rows] * np.tan(width)
        else:
            beyond = im[rows] * (sign * lines.tap[rows]) - width
        stage.le(name, labelled(beyond, names))


def _angles_let_through(lines: LineData) -> Floats:
    """(lines,) the largest angle that a rating leaves, rad; infinite if any.

    Of the impedance's flow S, |Im V_i' V_j*| = |x P - r Q| <= |z| |S|, and V_i' V_j* has a positive
    real part as long as |z| |S| < V_i'^2. So |theta| <= asin(|z| |S| / (V_i' V_j)).
    """
    assert lines.v_min is not None
    assert lines.v_max is not None
    low = lines.v_min[lines.from_bus] / lines.tap, lines.v_min[lines.to_bus]
    charging = np.abs(lines.y_from) * (lines.v_max[lines.from_bus] / lines.tap) ** 2
    z = np.hypot(lines.r, lines.x)
    through = np.multiply(z, lines.rating + charging, out=np.zeros(len(z)), where=z > 0.0)
    if not lines.losses:
        return through * lines.tap
    sine = through / np.minimum(*low) / low[0]
    return np.where(sine < 1.0, np.arcsin(np.minimum(sine, 1.0)), np.inf)


def parallel(lines: LineData) -> tuple[Ints, Ints, Floats]:
    """Pairs of fixed lines that join two buses, and 1 or -1: whether they point alike."""
    first: dict[tuple[int, int], int] = {}
    pairs = []
    for k in np.flatnonzero(~lines.switchable).tolist():
        ends = int(lines.from_bus[k]), int(lines.to_bus[k])
        lead = first.setdefault((min(ends), max(ends)), k)
        if lead != k:
            pairs.append((lead, k, 1.0 if lines.from_bus[lead] == ends[0] else -1.0))
    table = np.array(pairs, float).reshape(len(pairs), 3)
    return table[:, 0].astype(np.intp), table[:, 1].astype(np.intp), table[:, 2]
