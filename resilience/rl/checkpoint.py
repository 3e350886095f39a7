"""Networks and learners on disk: tensors in one safetensors file, which nothing can hide code in.

A file is written whole or not at all. What it belongs to stands in its header, and a file that
belongs elsewhere, or is torn, is refused with the reason.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import NonNegativeInt, TypeAdapter

from resilience.digest import digest_of
from resilience.errors import ResilienceError, UsageError, shortened
from resilience.files import replacing_file
from resilience.inputs import MissingFileError, checked_path
from resilience.rl.networks.acting import MAX_WEIGHT

if TYPE_CHECKING:
    import torch

    from resilience.case import Case

FORMAT = 1
HORIZON = frozenset(
    ("start", "slots", "profiles", "outages", "source", "path", "name", "description", "rebuild")
)
"""Fields of a case that a policy does not depend on: it acts on other days than it learned on."""


@dataclass(frozen=True)
class Header:
    """What a file says of itself.

    Attributes:
        method: name of the algorithm.
        case: digest of the case, see `case_digest`.
        schema: digest of the observations, see `Observer.schema`.
        iteration: iterations done, 0 or more.
        config: everything that the training was started with, as plain data.
        network: what the network of a policy is, as plain data.
        versions: of the libraries that wrote it.
        notes: numbers that are kept along, as the best validation cost.
        format: of the file.
    """

    method: str
    case: str
    schema: str
    iteration: NonNegativeInt
    config: dict[str, Any]
    network: dict[str, Any]
    versions: dict[str, str]
    notes: dict[str, Any] = field(default_factory=dict)
    format: int = FORMAT


def case_digest(case: Case) -> str:
    """A digest of the devices, the network and the rules of a case; its horizon is left out."""
    return digest_of(case, HORIZON)[:16]


def save(path: Path, tensors: Mapping[str, torch.Tensor], header: Header) -> None:
    """Writes a file; the one that stood there is replaced in one step.

    Raises:
        FileError: the system refuses.
    """
    from safetensors.torch import save as serialised

    # Copies, since tensors that share memory cannot be written.
    plain = {n: value.detach().cpu().clone().contiguous() for n, value in tensors.items()}
    text = json.dumps(asdict(header), sort_keys=True)
    with replacing_file(path) as fresh:
        # One entry, since several would be written in any order.
        facts = {"header": text, "sha256": _digest(text, plain)}
        fresh.write_bytes(serialised(plain, {"resilience": json.dumps(facts)}))


def load(path: Path) -> tuple[dict[str, torch.Tensor], Header]:
    """Tensors and header of a file.

    Raises:
        UsageError: there is none, it is torn, or it is none of ours.
    """
    from safetensors import safe_open

    try:
        with safe_open(checked_path(path), framework="pt") as opened:
            entry = (opened.metadata() or {}).get("resilience", "{}")
            tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118
        facts = json.loads(entry)
        text = facts.get("header", "")
        header = TypeAdapter(Header).validate_python(json.loads(text))
        if facts.get("sha256") != _digest(text, tensors):
            raise ValueError("its SHA-256 is another than was written")
    except MissingFileError:
        raise UsageError(
            f"{path} does not exist", hint="`resilience train --out RUN` writes such files"
        ) from None
    except ResilienceError:
        raise
    except Exception as error:  # SafetensorError and all that parsing its facts may raise
        raise UsageError(
            f"{path} cannot be read as a checkpoint ({shortened(str(error), 200)})",
            hint="it is torn or none of `resilience train`; delete it and train again",
        ) from error
    if header.format != FORMAT:
        raise UsageError(
            f"{path} has the format {header.format}; allowed: {FORMAT}",
            hint="train again with this version",
        )
    return tensors, header


def load_weights(network: torch.nn.Module, weights: Mapping[str, torch.Tensor]) -> None:
    """Takes weights for those of a network.

    Raises:
        RuntimeError, ValueError: they are of another network, or no numbers.
    """
    for name, value in weights.items():
        if not (value.isfinite() & (value.double().abs() <= MAX_WEIGHT)).all():
            raise ValueError(f"{name} holds what is no weight, up to {MAX_WEIGHT:g}")
    network.load_state_dict(weights)


def _digest(text: str, tensors: Mapping[str, torch.Tensor]) -> str:
    """SHA-256 of a header and of the names and bytes of tensors on the CPU."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(tensors[name].numpy().tobytes())
    return digest.hexdigest()


def check_fits(path: Path, header: Header, case: Case, schema: str) -> None:
    """Refuses a file that belongs to another case or to other observations.

    Raises:
        UsageError: it does; both digests are named.
    """
    digest = case_digest(case)
    if header.case != digest:
        raise UsageError(
            f"{path} was trained on a case with the digest {header.case}, and this one has "
            f"{digest}; allowed: the same devices, network and prices, on any days",
            hint="train it on this case",
        )
    if header.schema != schema:
        raise UsageError(
            f"{path} was trained on observations with the digest {header.schema}, and this case "
            f"has {schema}; allowed: the same",
            hint="train it again with this version",
        )


def versions() -> dict[str, str]:
    """Versions of what numbers depend on."""
    import platform
    from importlib.metadata import version

    names = ("resilience", "torch", "numpy", "safetensors")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}
