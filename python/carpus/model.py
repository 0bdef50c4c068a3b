"""Models: read, looked at, edited without loss, scaled, upgraded, written; postures, paths, forces at rest, motion."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import _carpus
from ._arrays import Arrays
from ._html import table
from .errors import of_shape

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Body", "Component", "Components", "Coordinate", "ForwardMotion", "Model", "Muscle", "Paths"]


def _text(value: Any) -> str:
    """A value as OpenSim's files have it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, (int, float, np.integer, np.floating)):
        return repr(float(value)) if isinstance(value, (float, np.floating)) else str(int(value))
    return " ".join(repr(float(v)) for v in value)


def _postures(q: ArrayLike) -> np.ndarray:
    """Postures, shape (n, c)."""
    q = np.ascontiguousarray(q, float)
    if q.ndim not in (1, 2):
        raise of_shape("q", "(n, c) or (c,)", q)
    return np.atleast_2d(q)


class Component:
    """A component of a model. Its properties have OpenSim's names and units; setting one edits the file.

    What is known of every component of its kind can be read as an attribute; any other property by `get`, as text. A
    nested object's property is written ``Class/property``.
    """

    _model: Model
    _kind: str
    name: str
    path: str
    line: int

    def __init__(self, model: Model, kind: str, name: str) -> None:
        object.__setattr__(self, "_model", model)
        object.__setattr__(self, "_kind", kind)
        object.__setattr__(self, "name", name)

    def _known(self) -> dict[str, Any]:
        return self._model._component(self._kind, self.name)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        known = self._known()
        if name in known:
            value = known[name]
            return np.array(value) if isinstance(value, list) else value
        text = self._model._file.property(known["path"], name)
        if text is None:
            raise AttributeError(f"{known['path']} has no property {name} in its file; it has {', '.join(known)}")
        return text

    def __setattr__(self, name: str, value: Any) -> None:
        self.set(name, value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._known()]

    def get(self, property: str) -> str | None:
        """The text of a property as the file has it; ``None``: the file does not give it."""
        return self._model._file.property(self._known()["path"], property)

    def set(self, property: str, value: Any) -> None:
        """Sets a property; exactly its line of the file changes. The model stays as it was if it does not take the
        value.

        Args:
            property: OpenSim's name; ``Class/property`` of a nested object.
            value: A number, a text, a truth value, or several numbers.

        Raises:
            InputError: There is no such property, or the model would be invalid.
        """
        self._model._file.set_property(self._known()["path"], property, _text(value))
        self._model._changed()

    def to_dict(self) -> dict[str, Any]:
        """What is known of it."""
        return dict(self._known())

    def __repr__(self) -> str:
        known = {k: v for k, v in self._known().items() if k not in ("path", "line")}
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in known.items())})"


class Body(Component):
    """A rigid body: ``mass`` [kg], ``mass_center`` [m], ``inertia`` (xx, yy, zz, xy, xz, yz) [kg·m²]."""

    mass: float
    mass_center: np.ndarray
    inertia: np.ndarray


class Coordinate(Component):
    """A coordinate: ``default_value`` [rad or m], ``range``, ``clamped``, ``locked``, ``motion_type``, ``joint``."""

    default_value: float
    default_speed_value: float
    range: np.ndarray
    clamped: bool
    locked: bool
    motion_type: str
    joint: str


class Muscle(Component):
    """A muscle: ``max_isometric_force`` [N], ``optimal_fiber_length`` [m], ``tendon_slack_length`` [m],
    ``pennation_angle_at_optimal`` [rad], ``max_contraction_velocity`` [optimal fibre lengths/s], ``class``, and what
    else its class has.
    """

    max_isometric_force: float
    optimal_fiber_length: float
    tendon_slack_length: float
    pennation_angle_at_optimal: float
    max_contraction_velocity: float

    def set(self, property: str, value: Any) -> None:
        if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
            self._model._file.set_muscle_properties([(self.name, property, float(value))])
            self._model._changed()
        else:
            super().set(property, value)


Kind = TypeVar("Kind", bound=Component)


class Components(Mapping[str, Kind]):
    """The components of a kind, by name, in the order of the file."""

    def __init__(self, model: Model, kind: str, of: type[Kind]) -> None:
        self._model, self._kind, self._of = model, kind, of

    def __getitem__(self, name: str) -> Kind:
        self._model._component(self._kind, name)
        return self._of(self._model, self._kind, name)

    def __iter__(self) -> Iterator[str]:
        return (c["name"] for c in self._model._components(self._kind))

    def __len__(self) -> int:
        return len(self._model._components(self._kind))

    def to_pandas(self) -> pd.DataFrame:
        """A data frame with a row per component."""
        import pandas as pd

        rows = self._model._components(self._kind)
        return pd.DataFrame(rows, columns=None if rows else ["name"]).set_index("name")

    def __repr__(self) -> str:
        return f"<{len(self)} {self._kind}: {', '.join(self)}>"


@dataclass(frozen=True)
class Paths(Arrays):
    """Paths of muscles in postures."""

    muscles: list[str]
    """Names of the muscles (m)."""
    length: np.ndarray
    """Lengths [m], shape (n, m)."""
    moment_arm: np.ndarray | None
    """Moment arms [m] about the coordinate asked for, positive where tension increases it, shape (n, m)."""

    def to_pandas(self) -> pd.DataFrame:
        """A data frame with a row per posture; columns ``length`` and ``moment_arm`` of every muscle."""
        import pandas as pd

        parts = {"length": pd.DataFrame(self.length, columns=self.muscles)}
        if self.moment_arm is not None:
            parts["moment_arm"] = pd.DataFrame(self.moment_arm, columns=self.muscles)
        return pd.concat(parts, axis=1)


@dataclass(frozen=True)
class ForwardMotion(Arrays):
    """A motion from forces."""

    time: np.ndarray
    """Times [s], shape (n,)."""
    coordinates: list[str]
    """Names of the coordinates (c)."""
    muscles: list[str]
    """Names of the muscles (m)."""
    q: np.ndarray
    """Coordinates [rad or m], shape (n, c)."""
    u: np.ndarray
    """Speeds [rad/s or m/s], shape (n, c)."""
    activation: np.ndarray
    """Activations, shape (n, m)."""
    fiber_length: np.ndarray
    """Fibre lengths [m], shape (n, m); not a number for muscles with a rigid tendon."""

    def to_pandas(self) -> pd.DataFrame:
        """A data frame with the time as index and OpenSim's names of states as columns."""
        import pandas as pd

        columns = {f"{name}/value": self.q[:, i] for i, name in enumerate(self.coordinates)}
        columns |= {f"{name}/speed": self.u[:, i] for i, name in enumerate(self.coordinates)}
        columns |= {f"{name}/activation": self.activation[:, i] for i, name in enumerate(self.muscles)}
        columns |= {f"{name}/fiber_length": self.fiber_length[:, i] for i, name in enumerate(self.muscles)}
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time"))


class Model:
    """An OpenSim model. An edit changes its value in the file's text and no other byte.

    Example:
        >>> model = carpus.Model.bundled()
        >>> model.muscles["FCR"].max_isometric_force *= 1.1
        >>> model.write("stronger.osim")  # doctest: +SKIP
    """

    def __init__(self, file: _carpus.Model) -> None:
        self._file = file
        self._cache: dict[str, list[dict[str, Any]]] = {}

    # Files

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Model:
        """Reads a model file of any format from 1.9 to 4.6.

        Raises:
            InputError: It cannot be read as a model; all problems, each with its line.
        """
        return cls(_carpus.Model.read(os.fspath(path)))

    @classmethod
    def parse(cls, text: bytes | str, name: str = "model.osim") -> Model:
        """A model of the bytes of a file.

        Args:
            text: The bytes.
            name: What messages call it.
        """
        return cls(_carpus.Model.parse(text.encode() if isinstance(text, str) else text, name))

    @classmethod
    def bundled(cls) -> Model:
        """The wrist with five muscles that comes with Carpus."""
        return cls(_carpus.Model.bundled())

    def to_bytes(self) -> bytes:
        """The bytes of the file; those that were not edited are those that were read."""
        return self._file.bytes()

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, completely or not at all."""
        self._file.write(os.fspath(path))

    def copy(self) -> Model:
        """A copy that can be edited by itself."""
        return Model(self._file.copy())

    # What is in it

    def _changed(self) -> None:
        self._cache.clear()

    def _components(self, kind: str) -> list[dict[str, Any]]:
        if kind not in self._cache:
            text = self._file.components(kind)
            assert text is not None, kind
            self._cache[kind] = json.loads(text)
        return self._cache[kind]

    def _component(self, kind: str, name: str) -> dict[str, Any]:
        for component in self._components(kind):
            if component["name"] == name:
                return component
        names = ", ".join(c["name"] for c in self._components(kind))
        raise KeyError(f"the model has no {name} among its {kind}: {names}")

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.info()["model"]

    @property
    def bodies(self) -> Components[Body]:
        """The bodies, by name."""
        return Components(self, "bodies", Body)

    @property
    def coordinates(self) -> Components[Coordinate]:
        """The coordinates, by name."""
        return Components(self, "coordinates", Coordinate)

    @property
    def joints(self) -> Components[Component]:
        """The joints, by name."""
        return Components(self, "joints", Component)

    @property
    def muscles(self) -> Components[Muscle]:
        """The muscles, by name."""
        return Components(self, "muscles", Muscle)

    @property
    def forces(self) -> Components[Component]:
        """Forces that are no muscles, by name."""
        return Components(self, "forces", Component)

    @property
    def constraints(self) -> Components[Component]:
        """The constraints, by name."""
        return Components(self, "constraints", Component)

    @property
    def markers(self) -> Components[Component]:
        """The markers, by name."""
        return Components(self, "markers", Component)

    def info(self) -> dict[str, Any]:
        """What ``carpus info --json`` says: counts, coordinates, muscles, and what was not understood."""
        return json.loads(self._file.info())

    # Edits

    def set_muscle_properties(self, values: Mapping[str, Mapping[str, float]]) -> None:
        """Sets properties of several muscles, all or none.

        Args:
            values: By muscle and property, in the file's units: ``{"FCR": {"optimal_fiber_length": 0.06}}``.
        """
        changes = [(muscle, p, float(v)) for muscle, properties in values.items() for p, v in properties.items()]
        self._file.set_muscle_properties(changes)
        self._changed()

    def add_force(self, xml: str) -> None:
        """Adds a force, given as one element, at the end of the force set."""
        self._file.add_force(xml)
        self._changed()

    def remove(self, *paths: str) -> None:
        """Removes components by their absolute paths, as ``/forceset/ECRL``."""
        self._file.remove_components(list(paths))
        self._changed()

    def scaled(
        self,
        factors: Mapping[str, float | tuple[float, float, float]],
        *,
        mass: float | None = None,
        preserve_mass_distribution: bool = False,
    ) -> tuple[Model, dict[str, Any]]:
        """The model scaled as OpenSim's Scale Tool does it.

        Args:
            factors: By body: one factor, or one along each of x, y, z.
            mass: Of the scaled model [kg]; without it masses grow with volumes.
            preserve_mass_distribution: Whether bodies keep their share of the mass.

        Returns:
            The scaled model; masses, path lengths before and after, and what was not scaled.
        """
        of = [(body, [float(v) for v in np.broadcast_to(np.asarray(f, float), 3)]) for body, f in factors.items()]
        file, said = self._file.scaled(of, mass, preserve_mass_distribution)
        return Model(file), json.loads(said)

    def upgraded(self) -> tuple[Model, list[tuple[int, str]]]:
        """The model in the format of OpenSim 4.6, and what was left out: line and component."""
        file, left_out = self._file.upgraded()
        return Model(file), left_out

    # Computations

    @property
    def coordinate_names(self) -> list[str]:
        """Names of the coordinates, in the order of every posture."""
        return self._file.coordinate_names()

    @property
    def muscle_names(self) -> list[str]:
        """Names of the muscles, in the order of every array."""
        return self._file.muscle_names()

    def posture(self, **values: float) -> np.ndarray:
        """The default posture with some coordinates set; those that follow others are set by these.

        Args:
            values: By coordinate [rad or m].

        Returns:
            All coordinates [rad or m], shape (c,).
        """
        return self._file.posture([(name, float(value)) for name, value in values.items()])

    def postures(self, coordinate: str, values: ArrayLike, **held: float) -> np.ndarray:
        """Postures in which one coordinate moves.

        Args:
            coordinate: That moves.
            values: Its values [rad or m], shape (n,).
            held: Other coordinates [rad or m].

        Returns:
            Coordinates [rad or m], shape (n, c).
        """
        values = np.asarray(values, float)
        q = np.repeat(self.posture(**held)[None, :], len(values), axis=0)
        q[:, self.coordinate_names.index(coordinate)] = values
        return q

    def paths(self, q: ArrayLike, *, about: str | None = None) -> Paths:
        """Lengths of all muscles' paths, and their moment arms. Uses all cores.

        Args:
            q: Postures [rad or m], shape (n, c) or (c,); `posture` and `postures` make them.
            about: The coordinate about which moment arms are wanted.
        """
        q = _postures(q)
        length, moment_arm = self._file.paths(q, about)
        return Paths(self.muscle_names, length, moment_arm)

    def poses(self, q: ArrayLike) -> np.ndarray:
        """Poses of all bodies in ground.

        Args:
            q: Postures [rad or m], shape (n, c) or (c,).

        Returns:
            Homogeneous transforms X_GB, shape (n, bodies, 4, 4), bodies in the order of `bodies`.
        """
        return self._file.poses(_postures(q))

    def equilibrium(
        self,
        activation: float = 0.01,
        *,
        about: str | list[str] | None = None,
        muscles: list[str] | None = None,
        allow_unsupported: bool = False,
        **set: float,
    ) -> pd.DataFrame:
        """Muscles at rest in a posture, as ``carpus equilibrium`` does it.

        Args:
            activation: Of every muscle, 0 to 1.
            about: Coordinates about which moments are given; without any those that are set.
            muscles: Names; without any all.
            allow_unsupported: Leave out muscles whose class is not computed.
            set: Coordinates that are held [rad or m]; the others are at their defaults.

        Returns:
            A data frame with a row per muscle: lengths [m], forces [N], pennation [deg], moment arms [m] and moments
                [N·m].
        """
        import pandas as pd

        about = [about] if isinstance(about, str) else list(about or [])
        held = [(name, float(value)) for name, value in set.items()]
        text = self._file.equilibrium(activation, held, about, muscles or [], allow_unsupported)
        rows = []
        for row in json.loads(text)["muscles"]:
            for moment in row.pop("moments"):
                row[f"{moment['coordinate']}_moment_arm_m"] = moment["moment_arm_m"]
                row[f"{moment['coordinate']}_moment_n_m"] = moment["moment_n_m"]
            rows.append(row)
        return pd.DataFrame(rows).set_index("muscle")

    def forward(
        self,
        time: ArrayLike,
        excitation: ArrayLike = 0.01,
        *,
        q: ArrayLike | None = None,
        u: ArrayLike | None = None,
        activation: float = 0.01,
        accuracy: float = 1e-5,
        allow_unsupported: bool = False,
    ) -> ForwardMotion:
        """Motion from forces: integrates the equations of motion with the muscles' own dynamics.

        Args:
            time: Times at which the state is wanted [s], shape (n,), ascending; the first is the start.
            excitation: Of every muscle: one number, shape (m,) or, linear between the times, (n, m).
            q: Coordinates at the start [rad or m], shape (c,); without them the default posture.
            u: Speeds at the start, shape (c,); without them 0.
            activation: Of every muscle at the start; fibres start in equilibrium.
            accuracy: Error allowed per step.
            allow_unsupported: Go on without forces that are not computed.

        Raises:
            InputError: A force that is not computed; a motion that cannot be integrated.
        """
        time = np.ascontiguousarray(time, float)
        if time.ndim != 1:
            raise of_shape("time", "(n,)", time)
        start = self.posture() if q is None else np.ascontiguousarray(q, float)
        speed = np.zeros_like(start) if u is None else np.ascontiguousarray(u, float)
        for name, values in (("q", start), ("u", speed)):
            if values.shape != (len(self.coordinate_names),):
                raise of_shape(name, f"({len(self.coordinate_names)},)", values)
        given, shape = np.asarray(excitation, float), (time.size, len(self.muscle_names))
        try:
            excitation = np.ascontiguousarray(np.broadcast_to(given, shape))
        except ValueError:
            raise of_shape("excitation", f"a number, {shape[1:]} or {shape}", given) from None
        found = self._file.forward(time, start, speed, activation, excitation, accuracy, allow_unsupported)
        return ForwardMotion(time=time, coordinates=self.coordinate_names, **found)

    def __repr__(self) -> str:
        return f"<Model {self.name}: {len(self.coordinates)} coordinates, {len(self.muscles)} muscles>"

    def _repr_html_(self) -> str:
        rows = [
            [m["name"], m["max_isometric_force"], m["optimal_fiber_length"], m["tendon_slack_length"]]
            for m in self._components("muscles")
        ]
        header = ["muscle", "max_isometric_force [N]", "optimal_fiber_length [m]", "tendon_slack_length [m]"]
        return f"<b>{self.name}</b>{table(header, rows)}"
