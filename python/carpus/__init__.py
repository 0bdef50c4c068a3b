"""Carpus fits the muscle parameters of an OpenSim model of the hand and wrist to one person's recordings, and shows
where it fails.

Example:
    >>> import carpus
    >>> session = carpus.demo().load()
    >>> fit = session.personalize()  # doctest: +SKIP
    >>> fit.errors  # doctest: +SKIP

Angles are radians and everything else SI units, unless a name says otherwise (``angle_deg``); data frames of results
have the units of the files that the program writes, which their columns name.
"""

from . import _carpus
from ._progress import show_progress
from .effects import Amplitude, Shape, define_effect, effects, forget_effect
from .errors import CarpusError, CarpusWarning, Diagnostic, InputError, InternalError
from .model import Body, Component, Components, Coordinate, ForwardMotion, Model, Muscle, Paths
from .results import (
    CohortDiagnosis,
    Comparison,
    Diagnosis,
    Evaluation,
    Groups,
    Identification,
    ModelWithEffects,
    Personalization,
    Plan,
    Result,
    Sensitivity,
    SimulatedTrial,
    Simulation,
    StudyReport,
)
from .study import PARAMETERS, Batch, Participant, Recorded, Session, Study, Trial, demo
from .tools import ToolRun, command, read_storage, run_tool

__version__: str = _carpus.VERSION
_carpus.set_program(_carpus.__file__)

__all__ = [
    "PARAMETERS",
    "Amplitude",
    "Batch",
    "Body",
    "CarpusError",
    "CarpusWarning",
    "CohortDiagnosis",
    "Comparison",
    "Component",
    "Components",
    "Coordinate",
    "Diagnosis",
    "Diagnostic",
    "Evaluation",
    "ForwardMotion",
    "Groups",
    "Identification",
    "InputError",
    "InternalError",
    "Model",
    "ModelWithEffects",
    "Muscle",
    "Participant",
    "Paths",
    "Personalization",
    "Plan",
    "Recorded",
    "Result",
    "Sensitivity",
    "Session",
    "Shape",
    "SimulatedTrial",
    "Simulation",
    "Study",
    "StudyReport",
    "ToolRun",
    "Trial",
    "command",
    "define_effect",
    "demo",
    "effects",
    "forget_effect",
    "read_storage",
    "run_tool",
    "show_progress",
]
