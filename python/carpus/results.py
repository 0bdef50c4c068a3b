"""Results: typed, as data frames, as pages, as the files of the command."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _carpus
from ._arrays import Arrays, over_time
from ._html import moments, table
from .model import Model

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "CohortDiagnosis",
    "Comparison",
    "Diagnosis",
    "Evaluation",
    "Identification",
    "ModelWithEffects",
    "Personalization",
    "Plan",
    "Result",
    "Sensitivity",
    "SimulatedTrial",
    "Simulation",
    "StudyReport",
]

_USES = {"held_out": "held out", "train": "training", "mvc": "MVC"}
_FIGURES = 6


class Result:
    """A result: what the command writes, in memory."""

    def __init__(self, answer: _carpus.Answer) -> None:
        self._answer = answer

    @cached_property
    def _dict(self) -> dict[str, Any]:
        return json.loads(self._answer.json())

    def to_dict(self) -> dict[str, Any]:
        """The content of the result's JSON file; the book describes its keys."""
        return self._dict

    def to_pandas(self) -> pd.DataFrame:
        """The result's main table as a data frame; its ``to_csv`` and ``to_parquet`` write it."""
        raise NotImplementedError

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Writes the files of the command: the same bytes for the same study, seed and ``command``.

        Args:
            folder: The folder of the results; those of the participant P01 come into its folder ``P01``.

        Raises:
            InputError: The folder cannot be written to, or holds what is not of this study and command.
        """
        self._answer.write(os.fspath(folder))
        return Path(folder)

    def report(self) -> str:
        """The result's report, a page of HTML that needs no network."""
        page = self._answer.report()
        if page is None:
            raise NotImplementedError(f"{type(self).__name__} has no page in memory: write() makes it")
        return page

    def __repr__(self) -> str:
        try:
            return f"{type(self).__name__}\n{self.to_pandas().to_string()}"
        except ImportError:
            return f"<{type(self).__name__}>"

    def _repr_html_(self) -> str:
        return self.to_pandas()._repr_html_()


@dataclass(frozen=True)
class SimulatedTrial(Arrays):
    """A simulated trial; n samples, m muscles."""

    time: np.ndarray
    """Time [s], shape (n,)."""
    moment: np.ndarray
    """Moment about the dynamometer's coordinate [N·m], shape (n,)."""
    fiber_length: np.ndarray
    """[m], shape (m, n)."""
    fiber_velocity: np.ndarray
    """[m/s], shape (m, n)."""
    tendon_force: np.ndarray
    """[N], shape (m, n)."""
    muscle_moment: np.ndarray
    """Moment of every muscle [N·m], shape (m, n)."""
    muscles: list[str]
    """Names of the muscles (m)."""

    def to_pandas(self) -> pd.DataFrame:
        """A data frame with the time [s] as index: the moment, then every series of every muscle, as
        ``FCR/tendon_force``.
        """
        columns = {"moment": self.moment}
        for i, muscle in enumerate(self.muscles):
            for name in ("fiber_length", "fiber_velocity", "tendon_force", "muscle_moment"):
                columns[f"{muscle}/{name}"] = getattr(self, name)[i]
        return over_time(self.time, columns)


class _OfModels(Result):
    """A result of one participant with errors of models."""

    @property
    def participant(self) -> str:
        """Name of the participant."""
        return self._results["participant"]["id"]

    @property
    def _results(self) -> dict[str, Any]:
        return self._dict

    @property
    def warnings(self) -> list[dict[str, Any]]:
        """What a person should know before trusting it."""
        return self._results["warnings"]

    @property
    def errors(self) -> pd.DataFrame:
        """Mean errors of every model for each use of the trials, as a data frame: NRMSE and largest error [1, of the
        measured range], XCORR and sum [1] (equations 3.1 to 3.4 of the book), RMSE [N·m], Pearson's r, R².
        """
        import pandas as pd

        rows = [
            {"use": label, "model": model["label"], "trials": e["trials"], **e["errors"]}
            for use, label in _USES.items()
            for model in self._results["models"]
            for e in model["errors"]
            if e["use"] == use
        ]
        columns = None if rows else ["use", "model", "trials"]
        return pd.DataFrame(rows, columns=columns).set_index(["use", "model"])

    @property
    def trial_errors(self) -> pd.DataFrame:
        """Errors of every model in every trial, as a data frame."""
        import pandas as pd

        rows = [
            {"trial": t["id"], "use": t["use"], "model": model, **errors}
            for t in self._results["trials"]
            for model, errors in t["errors"].items()
        ]
        return pd.DataFrame(rows, columns=None if rows else ["trial", "model", "use"]).set_index(["trial", "model"])

    def to_pandas(self) -> pd.DataFrame:
        return self.errors

    def moments(self, trial: str) -> pd.DataFrame:
        """Measured and simulated moments [N·m] of a trial as ``results.json`` has them, as a data frame with the time
        [s] as index.
        """
        import pandas as pd

        for t in self._results["trials"]:
            if t["id"] == trial:
                series = t["series"]
                columns = {"measured": series["measured_n_m"], **series["simulated_n_m"]}
                return pd.DataFrame(columns, index=pd.Index(series["time_s"], name="time_s"))
        raise KeyError(trial)

    def plot(self, trials: Sequence[str] | None = None) -> Any:
        """Measured and simulated moments, drawn by matplotlib; returns the figure.

        Args:
            trials: Names; without any the held-out ones.
        """
        import matplotlib.pyplot as plt

        chosen = list(trials) if trials is not None else [t["id"] for t in self._figured()]
        columns = min(3, max(1, len(chosen)))
        rows = -(-len(chosen) // columns)
        figure, axes = plt.subplots(
            rows, columns, figsize=(4 * columns, 2.4 * rows), squeeze=False, layout="constrained"
        )
        for axis, name in zip(axes.flat, chosen, strict=False):
            frame = self.moments(name)
            for column in frame:
                style = {"color": "0.6", "linewidth": 3} if column == "measured" else {}
                axis.plot(frame.index, frame[column], label=column, **style)
            axis.set_title(name, fontsize=9)
            axis.set_xlabel("time [s]")
            axis.set_ylabel("moment [N·m]")
        for axis in axes.flat[len(chosen) :]:
            axis.set_visible(False)
        axes.flat[0].legend(fontsize=8)
        # A notebook shows the returned figure; an open one it would show once more.
        plt.close(figure)
        return figure

    def _figured(self) -> list[dict[str, Any]]:
        trials = self._results["trials"]
        return ([t for t in trials if t["use"] == "held_out"] or trials)[:_FIGURES]

    def _repr_html_(self) -> str:
        models = self._results["models"]
        drawn = [models[0], models[-1]] if len(models) > 1 else models
        figures = []
        for t in self._figured():
            series = t["series"]
            curves = [("measured", series["measured_n_m"], "measured")]
            for i, model in enumerate(drawn):
                simulated = series["simulated_n_m"].get(model["id"])
                if simulated is not None:
                    kind = "before" if i == 0 and len(drawn) > 1 else "after"
                    curves.append((model["label"], simulated, kind))
            figures.append(moments(t["id"], series["time_s"], curves))
        legend = ", ".join(
            [
                "grey: measured",
                *(
                    f"{'dashed' if i == 0 and len(drawn) > 1 else 'blue'}: {escape(m['label'])}"
                    for i, m in enumerate(drawn)
                ),
            ]
        )
        errors = self.errors
        head = "" if errors.empty else errors._repr_html_()
        return f"{head}<p>{legend}</p><div>{''.join(figures)}</div>"


class Simulation(_OfModels):
    """Simulated trials, by name: ``simulation["trial"]``. It has moments and no errors: these are a comparison's."""

    def __init__(self, answer: _carpus.Answer, names: list[str], muscles: list[str]) -> None:
        super().__init__(answer)
        self._names = names
        self._muscles = muscles

    def __getitem__(self, trial: str) -> SimulatedTrial:
        found = self._answer.trial(self._names.index(trial)) if trial in self._names else None
        if found is None:
            raise KeyError(f"there is no trial {trial}: {', '.join(self._names)}")
        return SimulatedTrial(**found, muscles=list(self._muscles))

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def to_pandas(self) -> pd.DataFrame:
        """Errors as `errors`; of a simulation measured and simulated moments [N·m] of all trials as `moments`, with
        trial and time [s] as index.
        """
        import pandas as pd

        if type(self) is not Simulation:
            return self.errors
        return pd.concat({name: self.moments(name) for name in self}, names=["trial"])

    def __repr__(self) -> str:
        if type(self) is not Simulation:
            return super().__repr__()
        return f"<Simulation of {self.participant}: {len(self)} trials>"


class Comparison(Simulation):
    """Errors of the model as it is, and where they are."""

    @property
    def residuals(self) -> list[dict[str, Any]]:
        """How residuals depend on angle, time and others."""
        return self._dict["residuals"]


class Personalization(Simulation):
    """A personalized model."""

    @property
    def model(self) -> Model:
        """The lab's model with the fitted values; all other bytes are those of the file."""
        found = self._answer.model()
        assert found is not None
        return Model(found)

    @property
    def parameters(self) -> pd.DataFrame:
        """Fitted values as a data frame: before, after, bounds, standard deviation of the logarithm, share that the
        data contribute, 90 % interval; in the unit of the column ``unit``.
        """
        return _parameters(self._dict["parameters"])


class Diagnosis(_OfModels):
    """A diagnosis of a participant's trials."""

    @property
    def _results(self) -> dict[str, Any]:
        return self._dict["results"]

    @property
    def diagnosis(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``."""
        return self._dict["diagnosis"]

    @property
    def verdict(self) -> str:
        """``identified``, ``two_effects``, ``dominant``, ``several``, ``cannot_tell``, ``nothing_detectable``,
        ``negligible``, ``unknown`` or ``implausible``.
        """
        return self.diagnosis["verdict"]

    @property
    def explanations(self) -> list[list[str]]:
        """Sets of effects that explain the data, by identifier."""
        return [e["effects"] for e in self.diagnosis["explanations"]]

    @property
    def effects(self) -> list[str]:
        """Effects that are missing: of the explanations, or the largest where many things are a little wrong."""
        named = [e["effect"] for e in self.diagnosis["effects"]]
        return named or list(dict.fromkeys(id for e in self.explanations for id in e))

    @property
    def candidates(self) -> pd.DataFrame:
        """Every effect that was considered, as a data frame, the most probable first: probability, score, p-values,
        held-out error."""
        import pandas as pd

        columns = ["effect", "probability", "score", "score_p_value", "p_value", "held_out_error"]
        frame = pd.DataFrame([{k: c.get(k) for k in columns} for c in self.diagnosis["candidates"]])
        return frame.set_index("effect").sort_values("probability", ascending=False, na_position="last")

    @property
    def parameters(self) -> pd.DataFrame:
        """Sizes of the effects of the explanations, as a data frame: value, 95 % interval, unit, plausible range."""
        import pandas as pd

        rows = []
        for e in self.diagnosis["effects"] or self.diagnosis["explanations"]:
            label = " + ".join(e["effects"]) if "effects" in e else e["effect"]
            for name, p in e["parameters"].items():
                low, high = p["ci95"]
                rows.append(
                    {
                        "effects": label,
                        "parameter": name,
                        "value": p["value"],
                        "lower": low,
                        "upper": high,
                        "unit": p["unit"],
                    }
                )
        columns = ["effects", "parameter", "value", "lower", "upper", "unit"]
        return pd.DataFrame(rows, columns=columns).set_index(["effects", "parameter"])

    def to_pandas(self) -> pd.DataFrame:
        return self.candidates

    def __repr__(self) -> str:
        named = f": {', '.join(self.effects)}" if self.effects else ""
        return f"<Diagnosis of {self.participant}: {self.verdict}{named}>"

    def _repr_html_(self) -> str:
        named = f": {', '.join(map(escape, self.effects))}" if self.effects else ""
        sizes = self.parameters._repr_html_() if self.effects else ""
        return f"<p><b>{self.verdict}</b>{named}</p>{sizes}{super()._repr_html_()}"


class CohortDiagnosis(Result):
    """What several participants' diagnoses say together: effects that they share, in other sizes. Those of the
    participants by name: ``found["P01"]``.
    """

    def __init__(self, answer: _carpus.Answer, diagnoses: dict[str, Diagnosis]) -> None:
        super().__init__(answer)
        self.diagnoses = diagnoses
        """By participant, in the study's order."""

    def __getitem__(self, participant: str) -> Diagnosis:
        return self.diagnoses[participant]

    def __iter__(self) -> Iterator[str]:
        return iter(self.diagnoses)

    def __len__(self) -> int:
        return len(self.diagnoses)

    @property
    def effects(self) -> list[str]:
        """Effects that the cohort has, by identifier, the most certain first."""
        return [e["effect"] for e in self._dict["effects"]]

    @property
    def others(self) -> pd.Series:
        """Probability of every other effect, beside those, as a series, the most probable first."""
        import pandas as pd

        series = pd.Series(self._dict["others"], name="probability", dtype=float)
        return series.rename_axis("effect").sort_values(ascending=False)

    @property
    def participants(self) -> pd.DataFrame:
        """Every participant and effect of the cohort as a data frame: probability that the participant has it; size by
        its own trials alone and with the others as prior knowledge, with 95 % intervals; deviation from the
        population's mean [standard deviations].
        """
        import pandas as pd

        rows = [
            {
                "effect": e["effect"],
                "parameter": name,
                "participant": m["participant"],
                "probability": m["probability"],
                "deviation": m["deviation"],
                **_interval("alone", size["alone"]),
                **_interval("pooled", size["pooled"]),
                "unit": e["parameters"][name]["unit"],
            }
            for e in self._dict["effects"]
            for m in e["participants"]
            for name, size in m["parameters"].items()
        ]
        columns = ["probability", "deviation", *_interval("alone"), *_interval("pooled"), "unit"]
        keys = ["effect", "parameter", "participant"]
        return pd.DataFrame(rows, columns=keys + columns).set_index(keys)

    def to_pandas(self) -> pd.DataFrame:
        """Effects that the participants share, as a data frame with a row per amplitude: probability, share of the
        population that has the effect, mean and spread over those that have it, 95 % intervals.
        """
        import pandas as pd

        rows = [
            {
                "effect": e["effect"],
                "parameter": name,
                "probability": e["probability"],
                **_interval("prevalence", e["prevalence"]),
                **_interval("mean", size["mean"]),
                **_interval("spread", size["spread"]),
                "unit": size["unit"],
            }
            for e in self._dict["effects"]
            for name, size in e["parameters"].items()
        ]
        columns = ["probability", *_interval("prevalence"), *_interval("mean"), *_interval("spread"), "unit"]
        keys = ["effect", "parameter"]
        return pd.DataFrame(rows, columns=keys + columns).set_index(keys)

    def __repr__(self) -> str:
        return f"<CohortDiagnosis of {', '.join(self.diagnoses)}: {', '.join(self.effects) or 'nothing shared'}>"

    def _repr_html_(self) -> str:
        verdicts = [[name, d.verdict, ", ".join(d.effects)] for name, d in self.diagnoses.items()]
        shared = self.to_pandas()._repr_html_() if self.effects else "<p>no effect that they share</p>"
        return f"{shared}{table(['participant', 'alone', 'effects'], verdicts)}"


class ModelWithEffects(_OfModels):
    """A model with effects, step by step."""

    @property
    def ledger(self) -> dict[str, Any]:
        """The content of ``ledger.json``: every step with its errors and the sizes of its effects."""
        return self._dict["ledger"]

    @property
    def model(self) -> Model:
        """The model with all effects that its file can have."""
        found = self._answer.model()
        assert found is not None
        return Model(found)

    def to_pandas(self) -> pd.DataFrame:
        """The steps as a data frame: error [share of the MVC moment] on training and held-out trials."""
        import pandas as pd

        rows = [{k: s.get(k) for k in ("id", "label", "train", "held_out", "p_value")} for s in self.ledger["steps"]]
        return pd.DataFrame(rows).set_index("id")

    def __repr__(self) -> str:
        return f"ModelWithEffects\n{self.to_pandas().to_string()}"


class Identification(Result):
    """What the trials say about muscle parameters."""

    @property
    def parameters(self) -> pd.DataFrame:
        """Every parameter as a data frame: most likely value, interval, median, and whether the data determine it."""
        import pandas as pd

        rows = []
        for p in self._dict["parameters"]:
            flat = {k: v for k, v in p.items() if not isinstance(v, (dict, list))}
            for k, v in p.items():
                if isinstance(v, dict):
                    flat |= {f"{k}_{inner}": w for inner, w in v.items() if not isinstance(w, (dict, list))}
                elif isinstance(v, list) and len(v) == 2 and k != "curve":
                    flat |= {f"{k}_lower": v[0], f"{k}_upper": v[1]}
            rows.append(flat)
        return pd.DataFrame(rows)

    @property
    def draws(self) -> pd.DataFrame:
        """Draws from the posterior as a data frame: natural logarithms of the factors of the model's values, a column
        per parameter."""
        import pandas as pd

        found = self._answer.draws()
        assert found is not None
        rows, names = found
        return pd.DataFrame(rows, columns=names)

    @property
    def next_trials(self) -> list[dict[str, Any]]:
        """Candidates for the next trial, the most informative first."""
        return self._dict.get("next_trials", [])

    def to_pandas(self) -> pd.DataFrame:
        return self.parameters


class Plan(Result):
    """What further trials would do."""

    def to_pandas(self) -> pd.DataFrame:
        """Every experiment as a data frame: how far apart explanations are now and then [standard deviations]."""
        import pandas as pd

        return pd.DataFrame(self._dict["experiments"])


class Evaluation(Result):
    """Errors of models in held-out conditions, over participants."""

    def to_pandas(self) -> pd.DataFrame:
        """Errors of every model in every condition of every participant, as a data frame."""
        import pandas as pd

        return pd.json_normalize(self._dict["errors"])

    @property
    def anova(self) -> Any:
        """Tests of the differences between models."""
        return self._dict["anova"]


class Groups(Result):
    """What differs between groups of participants, or before and after."""

    def to_pandas(self) -> pd.DataFrame:
        """Every difference of every quantity as a data frame: estimate, interval, test, size."""
        import pandas as pd

        rows = []
        for d in self._dict["differences"]:
            ends = {k: v for k, v in d.items() if k.endswith("interval_95")}
            row = {k: v for k, v in d.items() if k not in ends}
            for name, interval in ends.items():
                row[f"{name}_lower"], row[f"{name}_upper"] = interval or (None, None)
            rows.append(row)
        return pd.DataFrame(rows)


class Sensitivity(Result):
    """Which muscle parameters the trials respond to."""

    def to_pandas(self) -> pd.DataFrame:
        """Morris' indices as a data frame: participant, condition, muscle, property, μ*, σ."""
        import pandas as pd

        rows = []
        for c in self._dict["conditions"]:
            for index in c["morris"]["indices"]:
                muscle, _, property = index["name"].rpartition(".")
                about = {k: c[k] for k in ("participant", "contraction", "effort_percent")}
                rest = {k: v for k, v in index.items() if k != "name" and not isinstance(v, (dict, list))}
                rows.append({**about, "muscle": muscle, "property": property, **rest})
        return pd.DataFrame(rows)


@dataclass(frozen=True)
class StudyReport:
    """What came of a whole study."""

    report: str
    """The page; empty of a task."""
    steps: list[dict[str, Any]] = field(default_factory=list)
    """The steps: ``id``, ``title``, and why it was not run."""
    units_found_finished: int = 0
    """Units of work that an earlier run had finished."""
    units_computed: int = 0
    """Units of work that were computed."""

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary."""
        return vars(self)

    def to_pandas(self) -> pd.DataFrame:
        """The steps as a data frame."""
        import pandas as pd

        return pd.DataFrame(self.steps).set_index("id")

    def _repr_html_(self) -> str:
        rows = [[s["id"], s["title"], s["not_run"] or "done"] for s in self.steps]
        return f"<p>{escape(self.report)}</p>{table(['step', 'title', ''], rows)}"


def _interval(name: str, of: dict[str, Any] | None = None) -> dict[str, Any]:
    """A value and the ends of its 95 % interval, as columns."""
    low, high = (None, None) if of is None else of["ci95"]
    return {name: None if of is None else of["value"], f"{name}_lower": low, f"{name}_upper": high}


def _parameters(rows: list[dict[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    flat = []
    for p in rows:
        interval = p.get("interval") or {}
        plain = {k: v for k, v in p.items() if k != "interval"}
        flat.append({**plain, "interval_lower": interval.get("lower"), "interval_upper": interval.get("upper")})
    return pd.DataFrame(flat).set_index(["muscle", "property"])
