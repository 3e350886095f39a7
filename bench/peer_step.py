"""Steps per second of python-microgrid's raw `step`, printed; run by `bench.peer` on its own."""

import sys
import time
import warnings

warnings.filterwarnings("ignore")  # its gym says that it is unmaintained

import numpy as np  # noqa: E402
from pymgrid import Microgrid  # noqa: E402
from pymgrid.modules import BatteryModule, GridModule, LoadModule, RenewableModule  # noqa: E402

HOURS = 8760


def main(turns: int, steps: int) -> None:
    rng = np.random.default_rng(0)
    battery = BatteryModule(
        min_capacity=2.2,
        max_capacity=19.8,
        max_charge=7.5,
        max_discharge=7.5,
        efficiency=0.999,
        init_soc=0.5,
    )
    load = LoadModule(time_series=5.0 + 4.0 * rng.random(HOURS))
    sun = RenewableModule(time_series=9.0 * rng.random(HOURS))
    prices = np.tile([0.3, 0.3, 0.0, 1.0], (HOURS, 1))
    grid = GridModule(max_import=12, max_export=12, time_series=prices)
    microgrid = Microgrid([battery, ("sun", sun), load, grid], loss_load_cost=1.5)
    rates = []
    for _ in range(turns):
        microgrid.reset()
        action = {"battery": [0.1], "grid": [-1.0]}
        began = time.perf_counter()
        for _ in range(steps):
            microgrid.step(action, normalized=False)
        rates.append(steps / (time.perf_counter() - began))
    print(np.median(rates))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
