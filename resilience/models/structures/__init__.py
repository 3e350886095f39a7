"""The named structures, the only non-affine things in the language: one class and one file each."""

from resilience.models.structures.adjacent import Adjacent
from resilience.models.structures.angle import Angle
from resilience.models.structures.base import Mode, SecondOrder, Structure, UnrolledStructure
from resilience.models.structures.cone import Cone
from resilience.models.structures.disc import Disc, Discs
from resilience.models.structures.largest import Largest
from resilience.models.structures.split import Split

__all__ = [
    "Adjacent",
    "Angle",
    "Cone",
    "Disc",
    "Discs",
    "Largest",
    "Mode",
    "SecondOrder",
    "Split",
    "Structure",
    "UnrolledStructure",
]
