"""The catalogue of physical effects, and effects that are functions of Python."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _carpus

__all__ = ["Amplitude", "Shape", "define_effect", "effects", "forget_effect"]

_VARIABLES = (
    "angle",
    "speed",
    "acceleration",
    "time",
    "session",
    "moment",
    "activation",
    "length",
    "lengthening_speed",
    "moment_arm",
    "excitation",
    "muscle",
)


@dataclass(frozen=True)
class Amplitude:
    """A parameter at whose value 0 the effect is absent.

    Attributes:
        unit: Its unit, in SI.
        typical: A typical size.
        plausible: The least and the greatest plausible value.
        source: Where the range comes from.
    """

    unit: str
    typical: float
    plausible: tuple[float, float]
    source: str = ""
    start: float = 0.0


@dataclass(frozen=True)
class Shape:
    """A parameter that says how the effect looks when it is there.

    Attributes:
        unit: Its unit, in SI.
        start: The usual value.
        typical: Its expected standard deviation.
        plausible: The least and the greatest plausible value.
        source: Where the range comes from.
    """

    unit: str
    start: float
    typical: float
    plausible: tuple[float, float]
    source: str = ""


def effects() -> list[dict[str, Any]]:
    """The catalogue, then the effects that were defined beside it.

    Returns:
        For each its ``id``, ``name``, ``stage``, ``equation``, ``parameters``, ``signature``, ``experiment``,
        ``rivals``.
    """
    return json.loads(_carpus.catalogue())


def define_effect(
    id: str,
    function: Callable[..., np.ndarray],
    *,
    name: str | None = None,
    parameters: dict[str, Amplitude | Shape],
    acts_on: str = "joint",
    derivatives: Callable[..., np.ndarray] | None = None,
    equation: str = "a function of Python",
    signature: str = "",
    experiment: str = "",
    rivals: Sequence[str] = (),
) -> None:
    """Puts an effect beside the catalogue, until `forget_effect` takes it away: `Session.diagnose` considers it.

    A formula needs no code: ``carpus effects --own-effect FILE.toml`` and `Study.open(…, own_effects=[…])` take it as
    text, and OpenSim can have it too.

    Args:
        id: An identifier that no other effect has.
        function: Gives, for a trial of n samples, the moment that is added to the joint's [N·m], shape (n,); with
            ``acts_on="muscles"`` the share by which every muscle's moment is larger, shape (n,). It is vectorized,
            depends on nothing but its arguments, and is called very often. What its arguments are their names say:

            =====================  ==========  ================================================
            ``angle``              (n,)        of the joint [rad]
            ``speed``              (n,)        [rad/s]; not with muscles
            ``acceleration``       (n,)        [rad/s²]; not with muscles
            ``time``               (n,)        [s]
            ``session``            number      place in the session, 0 to 1
            ``moment``             (n,)        of the muscles [N·m]; not with muscles
            ``activation``         (m, n)      of every muscle; (n,) with muscles
            ``moment_arm``         (m, n)      [m]; (n,) with muscles
            ``length``             (m, n)      of the paths [m]; not with muscles
            ``lengthening_speed``  (m, n)      [m/s]; not with muscles
            ``excitation``         (m, n)      of every muscle; not with muscles
            ``muscle``             text        name of the muscle; only with muscles
            =====================  ==========  ================================================

            Every other argument is one of the parameters, a number.
        name: How people call it.
        parameters: By name; one at least is an `Amplitude`.
        acts_on: ``joint`` or ``muscles``.
        derivatives: Of the same arguments: derivatives of ``function`` by every parameter, in their order, shape
            (parameters, n). Without it they are taken from differences.
        equation, signature, experiment: For reports: what it is, how it shows in the residual, what would expose it.
        rivals: Identifiers of effects that look alike.

    Raises:
        InputError: The identifier is taken; an argument that is neither a parameter nor known; no amplitude.

    What the function raises is raised by the work that called it.

    Example:
        >>> def friction(speed, size, width):
        ...     return -size * np.tanh(speed / width)
        >>> carpus.define_effect("my_friction", friction, parameters={
        ...     "size": carpus.Amplitude("N·m", 0.2, (0.0, 1.0)),
        ...     "width": carpus.Shape("rad/s", 0.1, 0.05, (0.01, 0.5)),
        ... })  # doctest: +SKIP
    """
    names = list(parameters)
    arguments = list(inspect.signature(function).parameters)
    variables = [a for a in arguments if a not in parameters and a != "muscle"]

    def called(of: Callable[..., np.ndarray]) -> Callable[[dict[str, Any], list[float]], np.ndarray]:
        wanted = set(inspect.signature(of).parameters)

        def call(series: dict[str, Any], values: list[float]) -> np.ndarray:
            given = {k: v for k, v in series.items() if k in wanted}
            given.update(zip(names, values, strict=True))
            return np.ascontiguousarray(of(**given), dtype=float)

        return call

    def row(name: str, p: Amplitude | Shape) -> tuple[Any, ...]:
        is_amplitude = isinstance(p, Amplitude)
        return (name, p.unit, is_amplitude, float(p.start), float(p.typical), [float(v) for v in p.plausible], p.source)

    _carpus.define_effect(
        acts_on,
        [id, name or id, equation, signature, experiment],
        [row(n, p) for n, p in parameters.items()],
        variables,
        list(rivals),
        called(function),
        None if derivatives is None else called(derivatives),
    )


def forget_effect(id: str) -> None:
    """Takes an effect away that `define_effect` put beside the catalogue.

    Raises:
        KeyError: There is none of that identifier.
    """
    if not _carpus.forget_effect(id):
        raise KeyError(f"no effect of Python is defined as {id}")
