"""Nobody acts on the future, and who does is found."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.case import load_case
from resilience.dispatch.registry import DISPATCHERS
from resilience.errors import CertificateError
from resilience.evaluation.compare import compare, held_out, parse_error
from resilience.fragility.draw import sample_case
from resilience.simulation.causality import check_causality, with_another_future
from resilience.simulation.forecast import sample_outlook
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.world import World, microgrid_with_fallible_lines


def world(*, known_centre: bool) -> World:
    case = held_out(load_case("ieee33-tou"), 1)
    storms, error = sample_case(case, 2, 3), parse_error("ar1")
    assert error is not None
    return World.build(
        microgrid_with_fallible_lines(case, storms, "copperplate"),
        storms,
        outlook=sample_outlook(case, error, 2, 5),
        known_centre=known_centre,
    )


@pytest.mark.parametrize("known_centre", [True, False])
def test_nobody_acts_on_the_future(known_centre: bool) -> None:
    methods = {name: DISPATCHERS[name] for name in ("rule", "mpc-blind", "mpc", "stochastic")}
    slots = check_causality(world(known_centre=known_centre), methods, episodes=1, slots=2)
    assert len(slots) == 2


def test_another_future_is_another_and_the_past_is_the_same() -> None:
    one = world(known_centre=False)
    other = with_another_future(one, 40, np.random.default_rng(0))
    assert one.outlook is not None
    assert other.outlook is not None
    for mine, theirs in (
        (one.scenarios.down, other.scenarios.down), (one.outlook.error, other.outlook.error),
    ):  # fmt: skip
        assert (mine[:, :41] == theirs[:, :41]).all()
        assert (mine[:, 41:] != theirs[:, 41:]).any()
    told = with_another_future(world(known_centre=True), 40, np.random.default_rng(0))
    here, there, kept = (np.asarray(w.scenarios.centre) for w in (one, other, told))
    assert (here != there).any()
    assert (here == kept).all()


class Leak:
    """Sees the lines of the next slot, of whatever world acts."""

    def __init__(self, setting: Setting) -> None:
        self.name, self.units = "leak", len(setting.case.ess)

    def act(self, observation: Observation) -> Floats:
        ahead = observation.forecast(None, np.array([observation.t + 1]))
        return np.full((self.units, ahead.shape[1]), Leak.down[observation.t + 1].mean())

    down: Floats


def test_who_peeks_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """It acts as the lines of the next slot are, which are others in another future."""
    from resilience.simulation import causality

    def leaking(one: World, slot: int, rng: np.random.Generator) -> World:
        other = with_another_future(one, slot, rng)
        Leak.down = other.scenarios.down.sum(axis=(0, 2))
        return other

    one = world(known_centre=True)
    Leak.down = one.scenarios.down[:, :, :1].sum(axis=(0, 2)).astype(float)
    monkeypatch.setattr(causality, "with_another_future", leaking)
    with pytest.raises(CertificateError, match=r"leak acts otherwise in slot .* of episode 0"):
        check_causality(one, {"leak": Leak}, episodes=1)


def test_compare_checks_it_if_asked() -> None:
    compare("ieee33-tou", ["rule"], days=1, draws=1, causality=True)
