"""Studies and participants: every use case of Carpus."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from . import _carpus
from ._arrays import Arrays, over_time
from ._html import table
from .errors import Diagnostic, InputError, of_shape, warn, whole
from .model import Model
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
    Sensitivity,
    Simulation,
    StudyReport,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "Participant", "Recorded", "Session", "Study", "Trial", "demo"]

PARAMETERS = ("max_isometric_force", "optimal_fiber_length", "tendon_slack_length", "pennation_angle_at_optimal")
"""The last axis of every array of muscle parameters: [N], [m], [m], [rad]."""


def _known(value: float | str | None) -> float | str | None:
    """A number or a text, or ``None`` where a data frame has none."""
    if isinstance(value, str):
        return value or None
    return None if value is None or np.isnan(value) else float(value)


def _count(name: str, value: int | None) -> int | None:
    """A whole number that may be left out."""
    return None if value is None else whole(name, value)


def _priors(
    given: str | os.PathLike[str] | pd.DataFrame | None,
) -> str | list[tuple[str, str, float, float, bool]] | None:
    """Prior knowledge: the file, or the rows of a data frame."""
    if given is None:
        return None
    if isinstance(given, (str, os.PathLike)):
        return os.fspath(given)
    missing = [c for c in ("muscle", "property", "mean", "sd") if c not in given]
    units = list(given["unit"]) if "unit" in given else ["file"] * len(given)
    wrong = [u for u in units if u not in ("file", "model")]
    if missing or wrong:
        text = f"priors: expected the columns muscle, property, mean, sd; missing: {', '.join(missing)}"
        if wrong:
            text = f"priors: expected the unit file or model, found {wrong[0]}"
        raise InputError([Diagnostic("error", None, None, text, None)])
    rows = zip(given["muscle"], given["property"], given["mean"], given["sd"], units, strict=True)
    return [(m, p, float(mean), float(sd), unit == "model") for m, p, mean, sd, unit in rows]


@dataclass(frozen=True)
class Participant:
    """What is known of a participant of a study in memory.

    Attributes:
        name: Name.
        mass: Body mass [kg].
        height: Body height [m].
        mvc_flexion: Largest voluntary flexion moment [N·m], positive.
        mvc_extension: Largest voluntary extension moment [N·m], positive.
        person: Who was measured, where one person is several participants.
        group: The group that the person belongs to.
        visit: When the person was measured.
    """

    name: str
    mass: float | None = None
    height: float | None = None
    mvc_flexion: float | None = None
    mvc_extension: float | None = None
    person: str | None = None
    group: str | None = None
    visit: str | None = None


@dataclass
class Trial:
    """A recorded trial of a study in memory; n samples.

    Attributes:
        name: A name that no other trial of the participant has.
        time: Time [s], shape (n,), ascending.
        angle: Angle of the dynamometer's coordinate [rad], shape (n,).
        moment: Measured moment [N·m], positive in the coordinate's positive direction, shape (n,).
        excitation: Excitation of every active muscle, 0 to 1: shape (muscles, n) in the study's order, or by muscle.
        contraction: ``isometric``, ``isotonic``, ``passive``, ``mvc`` or ``freehand``.
        direction: ``flexion``, ``extension`` or ``none``.
        use: ``train``, ``test`` (held out from every fit) or ``mvc``.
        participant: Whose it is.
        effort_percent: Effort asked for [% of the maximum].
        posture: Angle asked for [rad].
        repetition: Number of the repetition.
        start_time: When it began since the session began [s].
        arm_flipped: Whether the forearm is turned over.
        held: Other coordinates held in this trial, in place of the study's ``posture`` [deg, or m of a translation].
    """

    name: str
    time: ArrayLike
    angle: ArrayLike
    moment: ArrayLike
    excitation: ArrayLike | Mapping[str, ArrayLike]
    contraction: str = "isometric"
    direction: str = "none"
    use: str = "train"
    participant: str = "P01"
    effort_percent: float | None = None
    posture: float | None = None
    repetition: int | None = None
    start_time: float | None = None
    arm_flipped: bool = False
    held: Mapping[str, float] | None = None

    @classmethod
    def from_frame(
        cls,
        name: str,
        frame: Any,
        muscles: Sequence[str] | Mapping[str, str],
        *,
        time: str = "time_s",
        angle: str = "angle_deg",
        moment: str = "moment_n_m",
        **about: Any,
    ) -> Trial:
        """A trial of a data frame.

        Args:
            name: Name of the trial.
            frame: A row per sample.
            muscles: Columns with the excitations of the muscles of the same names; or the column of every muscle.
            time, angle, moment: Columns [s], [deg where the name ends with ``_deg``, else rad], [N·m].
            about: Further attributes of the trial.
        """
        columns = dict(muscles) if isinstance(muscles, Mapping) else {m: m for m in muscles}
        degrees = np.asarray(frame[angle], float)
        return cls(
            name,
            np.asarray(frame[time], float),
            np.deg2rad(degrees) if angle.endswith("_deg") else degrees,
            np.asarray(frame[moment], float),
            {muscle: np.asarray(frame[column], float) for muscle, column in columns.items()},
            **about,
        )

    def _given(self, muscles: Sequence[str]) -> dict[str, Any]:
        if isinstance(self.excitation, Mapping):
            missing = [m for m in muscles if m not in self.excitation]
            if missing:
                raise KeyError(f"trial {self.name}: no excitation of {', '.join(missing)}")
            excitation = [np.asarray(self.excitation[m], float) for m in muscles]
        else:
            excitation = list(np.atleast_2d(np.asarray(self.excitation, float)))
        return {
            "participant": self.participant,
            "name": self.name,
            "contraction": self.contraction,
            "direction": self.direction,
            "usage": self.use,
            "effort_percent": _known(self.effort_percent),
            "posture": _known(self.posture),
            "held": [(c, float(v)) for c, v in (self.held or {}).items()],
            "repetition": None if _known(self.repetition) is None else int(self.repetition or 0),
            "start_time": _known(self.start_time),
            "arm_flipped": self.arm_flipped,
            "time": np.asarray(self.time, float),
            "angle": np.asarray(self.angle, float),
            "moment": np.asarray(self.moment, float),
            "excitation": excitation,
        }


@dataclass(frozen=True)
class Recorded(Arrays):
    """A trial as it was recorded, and what of it does not depend on muscle parameters; n samples, m muscles."""

    time: np.ndarray
    """Time [s], shape (n,)."""
    angle: np.ndarray
    """Angle [rad], shape (n,)."""
    moment: np.ndarray
    """Measured moment [N·m], shape (n,)."""
    excitation: np.ndarray
    """Shape (m, n)."""
    activation: np.ndarray
    """Shape (m, n)."""
    path_length: np.ndarray
    """[m], shape (m, n)."""
    moment_arm: np.ndarray
    """[m], positive where tension increases the coordinate, shape (m, n)."""
    muscles: list[str]
    """Names of the muscles (m)."""

    def to_pandas(self) -> pd.DataFrame:
        """A data frame with the time [s] as index: angle, moment, then every series of every muscle, as
        ``FCR/activation``.
        """
        columns = {"angle": self.angle, "moment": self.moment}
        for i, muscle in enumerate(self.muscles):
            for name in ("excitation", "activation", "path_length", "moment_arm"):
                columns[f"{muscle}/{name}"] = getattr(self, name)[i]
        return over_time(self.time, columns)


@dataclass(frozen=True)
class Batch(Arrays):
    """Moments of many sets of muscle parameters."""

    moment: np.ndarray
    """Moments [N·m] of all trials, one after the other: shape (sets, samples)."""
    trials: dict[str, slice]
    """Where the samples of every trial are."""
    measured: np.ndarray
    """Measured moments [N·m], shape (samples,)."""

    def __getitem__(self, trial: str) -> np.ndarray:
        """Moments of a trial [N·m], shape (sets, n); a view."""
        return self.moment[:, self.trials[trial]]

    def rmse(self) -> np.ndarray:
        """Root mean square error [N·m] of every set in every trial, shape (sets, trials)."""
        squared = (self.moment - self.measured) ** 2
        return np.sqrt(np.stack([squared[:, s].mean(axis=1) for s in self.trials.values()], axis=1))

    def to_pandas(self) -> pd.DataFrame:
        """Root mean square errors [N·m] as a data frame: a row per set, a column per trial."""
        import pandas as pd

        return pd.DataFrame(self.rmse(), columns=list(self.trials)).rename_axis("set")


class Session:
    """A participant's model and trials in memory; every use case is a method. Long ones show progress, stop at Ctrl-C,
    and let other threads of Python go on.
    """

    def __init__(self, study: Study, session: _carpus.Session) -> None:
        self.study = study
        self._session = session
        self._trials: list[dict[str, Any]] = json.loads(session.trials())
        self._names = [t["name"] for t in self._trials]

    @property
    def participant(self) -> str:
        """Name of the participant."""
        return self._session.participant

    @property
    def muscles(self) -> list[str]:
        """Names of the active muscles, in the order of every array."""
        return self._session.muscles()

    @property
    def warnings(self) -> list[Diagnostic]:
        """What a person should know before trusting results."""
        return self._session.warnings()

    @property
    def model(self) -> Model:
        """A copy of the participant's model."""
        return Model(self._session.model())

    @property
    def trial_names(self) -> list[str]:
        """Names of the trials, in the order of recording."""
        return list(self._names)

    def trials(self) -> pd.DataFrame:
        """A data frame with a row per trial: contraction, direction, use, effort, posture, other coordinates held in it
        alone [deg, or m of a translation], samples.
        """
        import pandas as pd

        return pd.DataFrame(self._trials).set_index("name")

    def recorded(self, trial: str) -> Recorded:
        """A trial's series."""
        found = self._session.recorded(self._place(trial))
        assert found is not None
        return Recorded(**found, muscles=self.muscles)

    def _place(self, trial: str) -> int:
        if trial not in self._names:
            raise KeyError(f"there is no trial {trial}: {', '.join(self._names)}")
        return self._names.index(trial)

    # Use cases

    def compare(self, *, seed: int = 1) -> Comparison:
        """Errors of the model as it is, as ``carpus compare``."""
        return Comparison(self._session.compare(whole("seed", seed)), self._names, self.muscles)

    def personalize(self, *, intervals: bool = True, seed: int = 1) -> Personalization:
        """Fits the active muscles' parameters to the trials with use = train, as ``carpus personalize``.

        Args:
            intervals: Whether every fitted value gets a 90 % interval.
            seed: Of everything random; the same seed gives the same bytes.

        Raises:
            InputError: The trials do not suit the model.
            KeyboardInterrupt: Ctrl-C.
        """
        return Personalization(self._session.personalize(whole("seed", seed), intervals), self._names, self.muscles)

    def identify(
        self,
        *,
        properties: Sequence[str] | None = None,
        tie: Mapping[str, Sequence[str]] | None = None,
        priors: str | os.PathLike[str] | pd.DataFrame | None = None,
        level: float = 0.9,
        draws: int = 2000,
        seed: int = 1,
    ) -> Identification:
        """Intervals and posterior of muscle parameters, and which trial to record next, as ``carpus identify``.

        Args:
            properties: OpenSim's names; without any lengths and forces.
            tie: Muscles that have one factor, by the name of the group.
            priors: A table of prior knowledge: a CSV file, or a data frame with the columns muscle, property, mean, sd
                (in the model file's unit; with unit = model, multiples of the model's value).
            level: Of the intervals.
            draws: From the posterior.
            seed: Of the draws.
        """
        tied = [(name, list(muscles)) for name, muscles in (tie or {}).items()]
        wanted = None if properties is None else list(properties)
        draws, seed = whole("draws", draws, 2), whole("seed", seed)
        return Identification(self._session.identify(wanted, tied, _priors(priors), level, draws, seed))

    def diagnose(self, candidates: Sequence[str] = (), *, baselines: bool = False, seed: int = 1) -> Diagnosis:
        """Which physical effects are missing from the model, as ``carpus diagnose``.

        Args:
            candidates: Identifiers of the effects that may be named; without any the whole catalogue and those defined
                beside it.
            baselines: Whether what simpler methods need to compare themselves is written, too.
            seed: Of everything random.
        """
        return Diagnosis(self._session.diagnose(list(candidates), baselines, whole("seed", seed)))

    def add_effects(
        self,
        effects: Sequence[str] | None = None,
        *,
        diagnosis: Diagnosis | None = None,
        i_choose: bool = False,
        seed: int = 1,
    ) -> ModelWithEffects:
        """The model with effects, one after the other, as ``carpus effect add`` and ``carpus effect auto``.

        Args:
            effects: Identifiers; without any those that the diagnosis names.
            diagnosis: Of this session; without one it is made.
            i_choose: Whether you insist on effects that the diagnosis does not support; this is recorded.
            seed: Of everything random.
        """
        known = None if diagnosis is None else diagnosis._answer
        chosen = None if effects is None else list(effects)
        return ModelWithEffects(self._session.add_effects(chosen, known, i_choose, whole("seed", seed)))

    def plan(self, rivals: Sequence[str] = (), *, diagnosis: Diagnosis | None = None, seed: int = 1) -> Plan:
        """Which further trials would tell explanations apart, as ``carpus plan``.

        Args:
            rivals: Effects to tell apart, at least two; without any those that the diagnosis leaves.
            diagnosis: Of this session; without one it is made.
            seed: Of everything random.
        """
        known = None if diagnosis is None else diagnosis._answer
        return Plan(self._session.plan(list(rivals), known, whole("seed", seed)))

    # Arrays of parameters

    @property
    def parameters(self) -> np.ndarray:
        """The model's muscle parameters, shape (muscles, 4): maximum isometric force [N], optimal fibre length [m],
        tendon slack length [m], pennation angle at optimal fibre length [rad]. A copy that can be changed and given to
        `simulate`.
        """
        return self._session.parameters()

    def _chosen(self, trials: Sequence[str] | None, use: str | None) -> list[int]:
        if trials is not None:
            return [self._place(t) for t in trials]
        return [i for i, t in enumerate(self._trials) if use is None or t["use"] == use]

    def _sets(self, parameters: ArrayLike) -> tuple[np.ndarray, bool]:
        sets = np.ascontiguousarray(parameters, float)
        shape = (len(self.muscles), len(PARAMETERS))
        if sets.ndim not in (2, 3) or sets.shape[-2:] != shape:
            raise of_shape("parameters", f"{shape} or (sets, {shape[0]}, {shape[1]})", sets)
        return (sets[None], True) if sets.ndim == 2 else (sets, False)

    @overload
    def simulate(self, parameters: None = None, *, seed: int = 1) -> Simulation: ...

    @overload
    def simulate(
        self, parameters: ArrayLike, *, trials: Sequence[str] | None = None, use: str | None = None, seed: int = 1
    ) -> Batch: ...

    def simulate(
        self,
        parameters: ArrayLike | None = None,
        *,
        trials: Sequence[str] | None = None,
        use: str | None = None,
        seed: int = 1,
    ) -> Simulation | Batch:
        """Simulates trials.

        Args:
            parameters: Without them the model as it is, every trial, with fibre lengths and forces: a `Simulation`, as
                ``carpus simulate``. With them, shape (sets, muscles, 4) or (muscles, 4) as `parameters`: moments on
                all cores, a `Batch`.
            trials: Names of trials; without any all.
            use: Only trials of a use: ``train``, ``test`` or ``mvc``.
            seed: Written into a simulation's results; nothing in it is random.

        Raises:
            InputError: Another shape; a muscle whose forces cannot be balanced.
        """
        if parameters is None:
            if trials is not None or use is not None:
                text = "trials and use choose among the trials of a batch: expected parameters with them, found none"
                hint = "session.simulate(session.parameters, use=…) simulates some trials with the model's own values"
                raise InputError([Diagnostic("error", None, None, text, hint)])
            return Simulation(self._session.simulate(whole("seed", seed)), self._names, self.muscles)
        sets, _ = self._sets(parameters)
        places = self._chosen(trials, use)
        slices, first = {}, 0
        for i in places:
            slices[self._names[i]] = slice(first, first + self._trials[i]["samples"])
            first += self._trials[i]["samples"]
        return Batch(self._session.moments(sets, places), slices, self._measured(places))

    def _measured(self, places: Sequence[int]) -> np.ndarray:
        recorded = [self._session.recorded(i) for i in places]
        measured = [r["moment"] for r in recorded if r is not None]
        return np.concatenate(measured) if measured else np.zeros(0)

    def jacobian(
        self, parameters: ArrayLike | None = None, *, trials: Sequence[str] | None = None, use: str | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Moments and their exact derivatives by the muscle parameters: those of the discrete solution.

        Args:
            parameters: Shape (muscles, 4); without them the model's.
            trials, use: As in `simulate`.

        Returns:
            Moments [N·m], shape (samples,); derivatives, shape (samples, muscles, 4).
        """
        sets, is_one = self._sets(self.parameters if parameters is None else parameters)
        if not is_one:
            raise of_shape("parameters", f"{sets.shape[1:]}", sets)
        return self._session.jacobian(sets[0], self._chosen(trials, use))

    def loss(
        self, parameters: ArrayLike, *, trials: Sequence[str] | None = None, use: str | None = "train"
    ) -> tuple[Any, np.ndarray]:
        """Mean squared error of the moments and its exact gradient; for optimizers and samplers.

        Args:
            parameters: Shape (muscles, 4), or (sets, muscles, 4) on all cores.
            trials, use: As in `simulate`; by default the trials with use = train.

        Returns:
            The error [(N·m)²], a number or shape (sets,); its gradient in the shape of ``parameters``.
        """
        sets, is_one = self._sets(parameters)
        value, gradient = self._session.loss(sets, self._chosen(trials, use))
        return (float(value[0]), gradient[0]) if is_one else (value, gradient)

    def __repr__(self) -> str:
        return f"<Session {self.participant}: {len(self._names)} trials, muscles {', '.join(self.muscles)}>"

    def _repr_html_(self) -> str:
        counts: dict[tuple[str, str, str], int] = {}
        for t in self._trials:
            key = (t["contraction"], t["direction"], t["use"])
            counts[key] = counts.get(key, 0) + 1
        rows = [[*key, count] for key, count in counts.items()]
        return f"<b>{self.participant}</b>{table(['contraction', 'direction', 'use', 'trials'], rows)}"


class Study:
    """An open study. `demo` opens the bundled one, `Study.from_memory` makes one of arrays."""

    def __init__(self, study: _carpus.Study) -> None:
        self._study = study

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        participants: Sequence[str] = (),
        model: str | os.PathLike[str] | None = None,
        effects: str | os.PathLike[str] | None = None,
        own_effects: Sequence[str | os.PathLike[str]] = (),
        allow_unsupported: bool = False,
        scale_models: bool = False,
        command: str | None = None,
    ) -> Study:
        """Opens a study and checks its tables; trials are read and checked when a participant is loaded.

        Args:
            path: The ``study.toml``, or the folder it is in.
            participants: That are asked for; without any all.
            model: In place of those that the study names.
            effects: A file ``effects.toml`` that lies beside the model.
            own_effects: Files that define effects beside the catalogue.
            allow_unsupported: Go on without components of a model that would change the result.
            scale_models: Scale models to the participants as ``[scaling]`` says.
            command: What results name as the command that made them; without it the request itself.

        Raises:
            InputError: All problems of the study, each with file, line and hint.
        """
        opened = _carpus.Study.open(
            os.fspath(path),
            list(participants),
            None if model is None else os.fspath(model),
            None if effects is None else os.fspath(effects),
            [os.fspath(p) for p in own_effects],
            allow_unsupported,
            scale_models,
            command,
        )
        return cls(opened)

    @classmethod
    def from_memory(
        cls,
        model: Model,
        trials: Sequence[Trial],
        *,
        coordinate: str,
        muscles: Sequence[str],
        participants: Sequence[Participant] | None = None,
        posture: Mapping[str, float] | None = None,
        include: Sequence[str] | None = None,
        damping: float = 0.0,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        name: str = "study",
    ) -> Study:
        """A study of arrays, without files. Trials get the checks that a trial's file gets.

        Args:
            model: Of all participants.
            trials: In the order of recording.
            coordinate: OpenSim coordinate about which the dynamometer measures.
            muscles: That EMG drives; all others are disabled.
            participants: Without any the names that the trials have.
            posture: Coordinates held in every trial [deg, or m of a translation]; a trial may have ``held`` of its own.
            include: What the simulated moment sums: ``muscles``, ``passive``, ``gravity``, ``inertia``; without it
                muscles and passive.
            damping: Viscous drag of the machine [N·m·s/rad].
            bounds: How far personalization may go: by property the least and the greatest share of the model's value.
            name: Name of the study.

        Raises:
            InputError: All problems, together.
        """
        if not trials:
            text, hint = "trials: expected at least one, found none", "carpus.Trial(…) makes one of arrays"
            raise InputError([Diagnostic("error", None, None, text, hint)])
        if participants is None:
            participants = [Participant(p) for p in dict.fromkeys(t.participant for t in trials)]
        settings = {
            "name": name,
            "coordinate": coordinate,
            "muscles": list(muscles),
            "posture": [(c, float(v)) for c, v in (posture or {}).items()],
            "include": None if include is None else list(include),
            "damping": float(damping),
            "bounds": [(p, [float(low), float(high)]) for p, (low, high) in (bounds or {}).items()],
        }
        given = [{k: v if k == "name" else _known(v) for k, v in vars(p).items()} for p in participants]
        opened = _carpus.Study.from_memory(settings, given, [t._given(muscles) for t in trials], model._file)
        return cls(opened)

    @property
    def name(self) -> str:
        """Name of the study."""
        return self._study.name

    @property
    def folder(self) -> Path:
        """Its folder."""
        return Path(self._study.folder)

    @property
    def participants(self) -> list[str]:
        """Names of the participants that are asked for."""
        return self._study.participants()

    @property
    def warnings(self) -> list[Diagnostic]:
        """What a person should look at, of the study's tables."""
        return self._study.warnings()

    def load(self, participant: str | None = None) -> Session:
        """Reads a participant's model and trials with all checks.

        Args:
            participant: Name; may be left out where there is one.

        Raises:
            InputError: The model, the trials, or one does not suit the other.
        """
        names = self.participants
        if participant is None:
            if len(names) != 1:
                raise KeyError(f"expected one of the participants {', '.join(names)}")
            participant = names[0]
        session = Session(self, self._study.load(participant))
        for warning in session.warnings:
            warn(warning)
        return session

    def __iter__(self) -> Iterator[Session]:
        """The participants, one after the other, loaded."""
        return (self.load(name) for name in self.participants)

    def __len__(self) -> int:
        return len(self.participants)

    def check(self) -> list[Diagnostic]:
        """Reads every participant's model and trials.

        Returns:
            All warnings.

        Raises:
            InputError: What is wrong with the first participant that cannot be read.
        """
        found = {str(w): w for w in self.warnings}
        for name in self.participants:
            session = Session(self, self._study.load(name))
            found.update((str(w), w) for w in session.warnings)
        return list(found.values())

    def diagnose(self, candidates: Sequence[str] = (), *, baselines: bool = False, seed: int = 1) -> CohortDiagnosis:
        """Which physical effects are missing for every participant, and which of them the participants share, as
        ``carpus diagnose`` of a study with several participants.

        A participant that cannot be diagnosed is left out, with a warning.

        Args:
            candidates, baselines, seed: As `Session.diagnose`.

        Raises:
            InputError: Fewer than two participants could be diagnosed.
        """
        chosen, diagnoses, failed = list(candidates), {}, []
        seed = whole("seed", seed)
        if len(self.participants) < 2:
            text = f"expected at least two participants, found {', '.join(self.participants)}"
            hint = "one participant is diagnosed by study.load().diagnose()"
            raise InputError([Diagnostic("error", None, None, text, hint)])
        for name in self.participants:
            try:
                diagnoses[name] = self.load(name).diagnose(chosen, baselines=baselines, seed=seed)
            except InputError as error:
                failed += [d for d in error.diagnostics if d not in failed]
        answer = self._study.cohort([d._answer for d in diagnoses.values()], chosen, baselines, seed)
        if answer is None:
            raise InputError(failed)
        for diagnostic in failed:
            warn(diagnostic)
        return CohortDiagnosis(answer, diagnoses)

    def evaluate(self, models: Sequence[str | os.PathLike[str]] = (), *, seed: int = 1) -> Evaluation:
        """Models on held-out trials, over participants, as ``carpus evaluate``.

        Args:
            models: Folders of models: ``DIR/P01/NAME.osim``; without any the study's own models alone.
            seed: Written into the results; nothing in it is random.
        """
        return Evaluation(self._study.evaluate([os.fspath(m) for m in models], whole("seed", seed)))

    def groups(
        self, results: Sequence[str | os.PathLike[str]] = (), *, values: Sequence[str | os.PathLike[str]] = ()
    ) -> Groups:
        """What differs between groups of participants, or before and after, as ``carpus groups``.

        Args:
            results: Folders that `Identification.write` or `CohortDiagnosis.write` wrote for this study.
            values: Tables with a column ``participant`` and columns of numbers.

        Raises:
            InputError: Participants of one group and visit only; results that are not of the study.
        """
        return Groups(self._study.groups([os.fspath(r) for r in results], [os.fspath(v) for v in values]))

    def sensitivity(
        self, *, starts: int = 25, sobol: int | None = None, resamples: int = 1000, seed: int = 1
    ) -> Sensitivity:
        """Which muscle parameters the trials respond to, as ``carpus sensitivity``.

        Args:
            starts: Of Morris' screening.
            sobol: Rows of a Sobol' analysis, if one is wanted.
            resamples: Of the bootstrap.
            seed: Of everything random.
        """
        starts, resamples, seed = whole("starts", starts, 1), whole("resamples", resamples), whole("seed", seed)
        return Sensitivity(self._study.sensitivity(starts, _count("sobol", sobol), resamples, seed))

    def study(
        self,
        out: str | os.PathLike[str],
        *,
        steps: Sequence[str] = (),
        starts: int | None = None,
        sobol: int | None = None,
        bayesian_evaluations: int | None = None,
        sqp_iterations: int | None = None,
        priors: str | os.PathLike[str] | None = None,
        seed: int = 1,
        task: str | None = None,
    ) -> StudyReport:
        """All steps of a study and one report, as ``carpus study``; a run that was stopped goes on where it was.

        Several processes or machines share the work, and a folder: each does a task, and the same call without a task
        then finds all units finished and makes the report.

        Args:
            out: The folder of the results.
            steps: By name; without any all.
            starts, sobol, bayesian_evaluations, sqp_iterations: How hard to work; without them as the command.
            priors: A table of prior knowledge.
            seed: Of everything random.
            task: ``"I/N"``, only the I-th of N parts of the participants; without a report and steps in the answer.

        Raises:
            InputError: The study, an unknown step, the folder; a task of which some units could not be done.
        """
        table = None if priors is None else os.fspath(priors)
        said = self._study.whole_study(
            os.fspath(out),
            list(steps),
            _count("starts", starts),
            _count("sobol", sobol),
            _count("bayesian_evaluations", bayesian_evaluations),
            _count("sqp_iterations", sqp_iterations),
            table,
            whole("seed", seed),
            task,
        )
        return StudyReport(**json.loads(said))

    def __repr__(self) -> str:
        return f"<Study {self.name}: {', '.join(self.participants)}>"


def demo() -> Study:
    """The bundled study: one participant, 28 trials, five muscles, simulated by OpenSim with EMG noise and hidden
    parameters."""
    return Study(_carpus.Study.bundled())
