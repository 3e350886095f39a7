"""Wind fields of tropical cyclones, and conversions between kinds of wind."""

from resilience.fragility.wind.asymmetry import ASYMMETRIES, INFLOWS
from resilience.fragility.wind.convert import AVERAGING, ROUGHNESS, Kind
from resilience.fragility.wind.fields import MODELS, Model
from resilience.fragility.wind.wind import Wind, wind

__all__ = [
    "ASYMMETRIES",
    "AVERAGING",
    "INFLOWS",
    "MODELS",
    "ROUGHNESS",
    "Kind",
    "Model",
    "Wind",
    "wind",
]
