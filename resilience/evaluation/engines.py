"""Who does the work: processes of this machine, or a Dask or Ray cluster, all through joblib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal, TypeVar, get_args

from resilience.errors import UsageError

Engine = Literal["local", "dask", "ray"]
ENGINES: tuple[Engine, ...] = get_args(Engine)
PACKAGES = {"dask": "distributed", "ray": "ray"}
CALLS_PER_WORKER = 4  # handed out at once where results come back together
T = TypeVar("T")


def check_engine(engine: str, workers: int) -> None:
    """Refuses what cannot run.

    Raises:
        UsageError: an unknown engine, one that is not installed, or no worker.
    """
    from importlib.util import find_spec

    if engine not in ENGINES:
        raise UsageError(
            f"engine {engine!r} is unknown; allowed: {', '.join(ENGINES)}",
            hint="local uses processes of this machine",
        )
    if workers < 1:
        raise UsageError(
            f"workers is {workers}; allowed: 1 or more", hint="1 does everything in this process"
        )
    if engine in PACKAGES and find_spec(PACKAGES[engine]) is None:
        raise UsageError(
            f"engine {engine!r} needs the package {PACKAGES[engine]}, which is not installed",
            hint=f"pip install 'resilience[{engine}]'",
        )


def spread(
    calls: Sequence[Callable[[], T]], workers: int, engine: Engine
) -> Iterator[tuple[int, T]]:
    """Number and result of every call, as they are finished.

    A Dask cluster is the one of the current client, or of DASK_SCHEDULER_ADDRESS; a Ray cluster
    that of RAY_ADDRESS. Without one, `workers` processes are started on this machine.
    """
    from joblib import Parallel, delayed

    with _engine(engine, workers):
        # Calls last seconds: batches would only delay what is written down.
        if engine == "ray":  # joblib's backend for it hands over nothing before all is done
            size = CALLS_PER_WORKER * workers
            for first in range(0, len(calls), size):
                batch = calls[first : first + size]
                results = Parallel(n_jobs=workers, batch_size=1)(delayed(call)() for call in batch)
                yield from enumerate(results, start=first)
            return
        parallel = Parallel(n_jobs=workers, batch_size=1, return_as="generator_unordered")
        yield from parallel(delayed(_numbered)(k, call) for k, call in enumerate(calls))


def _numbered(k: int, call: Callable[[], T]) -> tuple[int, T]:
    return k, call()


@contextmanager
def _engine(engine: Engine, workers: int) -> Iterator[None]:
    import joblib

    if engine == "local":
        with joblib.parallel_config(backend="loky"):
            yield
    elif engine == "dask":
        with _dask(workers), joblib.parallel_config(backend="dask"):
            yield
    else:
        with _ray(workers), joblib.parallel_config(backend="ray"):
            yield


@contextmanager
def _dask(workers: int) -> Iterator[None]:
    import dask
    from distributed import Client, get_client

    try:
        get_client()
    except ValueError:
        local: dict[str, Any] = {"n_workers": workers, "threads_per_worker": 1}
        local |= {"dashboard_address": None}
        address = dask.config.get("scheduler-address", None)
        client: Any = Client
        with client(address) if address else client(**local):
            yield
    else:
        yield


@contextmanager
def _ray(workers: int) -> Iterator[None]:
    import os

    import ray
    from ray.util.joblib import register_ray

    register_ray()
    ours = not ray.is_initialized()
    if ours:
        local = {} if os.environ.get("RAY_ADDRESS") else {"num_cpus": workers}
        ray.init(include_dashboard=False, log_to_driver=False, **local)
    try:
        yield
    finally:
        if ours:
            ray.shutdown()
