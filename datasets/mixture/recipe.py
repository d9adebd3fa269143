"""Recipes: the data of trainings, as YAML or as frozen records.

    recipe: 1
    title: Does other robots' data help?
    sources:                      # queries; what several trainings share is written once
      humanoid: {robots: [h1], controllers: [path]}
      quadruped: {robots: [aliengo], controllers: [path], fraction: 0.5}
    mixtures:                     # what to train on: sources with weights
      alone: [humanoid]
      both: {humanoid: 1.0, quadruped: 2.0}
    comparison:                   # for `vlnpe ablate`, see `comparison.py`
      tests: {h1: {robot: h1, controller: speed}}
      claims: [{text: the quadruped's data helps, more: both, less: alone}]

A source without `data` looks for datasets in all runs under the folder given to the command.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

from ...formats.core.errors import FileFormatError, InputError, UnknownNameError, brief, check_name
from ...formats.core.rollout import EndReason
from ...formats.untrusted.yaml_document import read_yaml
from .comparison import Claim, Comparison, Row, Test

VERSION = 1
OUTCOMES = tuple(str(reason) for reason in EndReason)
SHARES = ("size", "equal")
NO_HOLDOUT = "none"
HOLDOUTS = ("auto", "split", "scene", "trajectory", NO_HOLDOUT)
EVERYTHING = ("**/lerobot/*",)
OWN_VIEW = "ego"
# Fields whose defaults do not show their types.
_NUMBERS = ("camera_height_m", "camera_pitch_deg")
_TEXTS = ("title", "text", "more", "less")


@dataclass(frozen=True)
class Source:
    """A query for episodes. An empty tuple means no restriction.

    Attributes:
        data: dataset folders, or patterns of them, relative to the folder searched.
        robots, controllers, lights, splits, scenes: labels of episodes. Without `splits` a mixture
            leaves out what its publisher holds out (`val_seen`, `val_unseen`, `test`).
        cameras: views; by default the robot's own alone, as those beside it or above it show what
            no robot sees.
        outcomes: end reasons; by default the successful ones alone.
        fraction: part of the trajectories, 0 … 1; chosen by their names, so that the same ones are
            taken from every robot, and a larger fraction contains a smaller one.
    """

    data: tuple[str, ...] = EVERYTHING
    robots: tuple[str, ...] = ()
    controllers: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    cameras: tuple[str, ...] = (OWN_VIEW,)
    splits: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = (str(EndReason.SUCCESS),)
    fraction: float = 1.0

    @property
    def collected(self) -> str:
        """The requirements on a collection in words: `robot h1, light CL`; may be empty."""
        conditions = {
            "robot": self.robots,
            "controller": self.controllers,
            "light": self.lights,
            "camera": () if self.cameras == (OWN_VIEW,) else self.cameras,
        }
        return ", ".join(
            f"{what} {' or '.join(names)}" for what, names in conditions.items() if names
        )


@dataclass(frozen=True)
class Mixture:
    """The sources of one training and their shares.

    Attributes:
        weights: weight of each source by name.
        shares: `size`: a source's share of the draws is its weight times its number of items
            (episodes or frames), as if the datasets were joined; `equal`: its weight alone.
    """

    weights: Mapping[str, float]
    shares: str = "size"


@dataclass(frozen=True)
class Recipe:
    """Named sources and the mixtures made of them.

    Attributes:
        title: the question that it answers.
        sources: by name.
        mixtures: by name, in the order of the table's rows.
        comparison: what `vlnpe ablate` compares; None if nothing.
        holdout: what trainings hold out: published splits (`val_seen`, `val_unseen`), whole
            scenes, trajectories, or `auto`: published splits where there are any, else scenes
            where there are several. `none` trains on everything.
        holdout_fraction: how much of it.
        seed: seed of the order of the draws, and the first of a comparison's.
        train: settings of the trainings, see `vlnpe.learning.config`.
    """

    title: str
    sources: Mapping[str, Source]
    mixtures: Mapping[str, Mixture]
    comparison: Comparison | None = None
    holdout: str = "auto"
    holdout_fraction: float = 0.25
    seed: int = 0
    train: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.mixtures:
            raise InputError("a recipe needs at least one mixture")
        for name, source in self.sources.items():
            _check_names(f"outcome in the source {name!r}:", source.outcomes, OUTCOMES)
            if not 0.0 < source.fraction <= 1.0:
                raise InputError(
                    f"source {name!r}: fraction {source.fraction}; valid: above 0, up to 1"
                )
        _check_names("holdout", [self.holdout], HOLDOUTS)
        if self.comparison is not None:
            trained = [row.mixture for row in self.comparison.rows.values() if row.mixture]
            _check_names("mixture in a row of the comparison:", trained, self.mixtures)
        if not 0.0 < self.holdout_fraction < 1.0:
            raise InputError(f"holdout_fraction {self.holdout_fraction}; valid: between 0 and 1")
        for name, mixture in self.mixtures.items():
            _check_names(f"source in the mixture {name!r}:", mixture.weights, self.sources)
            _check_names(f"shares in the mixture {name!r}:", [mixture.shares], SHARES)
            for source, weight in mixture.weights.items():
                if not (math.isfinite(weight) and weight > 0):
                    raise InputError(
                        f"mixture {name!r}: weight {weight} of {source!r}; valid: above 0"
                    )
            if not mixture.weights:
                raise InputError(f"mixture {name!r} has no source; valid: at least one")


def read_recipe(path: Path) -> Recipe:
    """Read a recipe.

    Raises:
        FileFormatError: not readable, no YAML mapping, or beyond a limit; a key, name or value that
            is not valid, with the valid ones.
    """
    value = read_yaml(path)
    try:
        return recipe_of(value)
    except FileFormatError:
        raise
    except InputError as error:
        raise FileFormatError(path, str(error)) from error


def recipe_of(value: Any) -> Recipe:
    """Return a recipe from the values of its YAML.

    Raises:
        InputError: a key, name or value that is not valid.
    """
    top = _mapping("a recipe", value)
    version = top.pop("recipe", None)
    if version is None:
        raise InputError(f"has no version; a recipe begins with the line `recipe: {VERSION}`")
    if version != VERSION:
        raise InputError(f"recipe: version {brief(version)}; valid: {VERSION}")
    sources = {
        str(name): _record(Source, f"source {brief(name)}", entry)
        for name, entry in _mapping("sources", top.pop("sources", None)).items()
    }
    mixtures = {
        str(name): _mixture(str(name), entry)
        for name, entry in _mapping("mixtures", top.pop("mixtures", None)).items()
    }
    if "comparison" in top:
        top["comparison"] = _comparison(top["comparison"], mixtures)
    top.setdefault("title", "")
    return _record(Recipe, "recipe", top | {"sources": sources, "mixtures": mixtures})


def _comparison(value: Any, mixtures: Mapping[str, Mixture]) -> Comparison:
    top = _mapping("comparison", value)
    rows = top.pop("rows", {name: {"mixture": name} for name in mixtures})
    claims = top.pop("claims", [])
    if not isinstance(claims, list):
        raise InputError(f"comparison: claims: {brief(claims)}; valid: a list")
    top |= {
        "tests": {
            str(name): _record(Test, f"test {brief(name)}", entry)
            for name, entry in _mapping("comparison: tests", top.get("tests")).items()
        },
        "rows": {
            str(name): _record(Row, f"row {brief(name)}", entry)
            for name, entry in _mapping("comparison: rows", rows).items()
        },
        "claims": tuple(_record(Claim, "a claim", entry) for entry in claims),
    }
    return _record(Comparison, "comparison", top)


def _mixture(name: str, value: Any) -> Mixture:
    """Return a mixture: a list of sources, weights by source, or `sources` beside `shares`."""
    shares = "size"
    if isinstance(value, dict) and "sources" in value:
        extra = set(value) - {"sources", "shares"}
        if extra:
            raise UnknownNameError(
                f"key in the mixture {brief(name)}:",
                str(min(extra, key=str)),
                ("sources", "shares"),
            )
        value, shares = value["sources"], value.get("shares", shares)
    if isinstance(value, list):
        value = dict.fromkeys(map(str, value), 1.0)
    weights = _mapping(f"mixture {brief(name)}", value)
    return Mixture(
        {
            str(k): _number(f"mixture {brief(name)}: weight of {brief(k)}", v)
            for k, v in weights.items()
        },
        str(shares),
    )


def _record[T](kind: type[T], what: str, value: Any) -> T:
    """Return a record from a mapping, with values checked against the types of its defaults."""
    given = _mapping(what, value if value is not None else {})
    valid = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    for key, entry in given.items():
        check_name(f"key in {what}:", key, valid)
        default = valid[key].default
        where = f"{what}: {key}"
        if isinstance(entry, tuple):
            continue  # read already
        if isinstance(default, tuple):
            given[key] = _strings(where, entry)
        elif isinstance(default, float) or key in _NUMBERS:
            given[key] = _number(where, entry)
        elif isinstance(default, int):
            if not isinstance(entry, int) or isinstance(entry, bool) or entry < 0:
                raise InputError(f"{where}: {brief(entry)}; valid: a whole number of at least 0")
        elif key == "train":
            given[key] = _mapping(where, entry or {})
        elif (isinstance(default, str) or key in _TEXTS) and not isinstance(entry, str):
            raise InputError(f"{where}: {brief(entry)}; valid: text")
    missing = [n for n, f in valid.items() if f.default is MISSING and n not in given]
    needed = [n for n in missing if valid[n].default_factory is MISSING]
    if needed:
        raise InputError(f"{what} lacks {', '.join(needed)}")
    return kind(**given)


def _mapping(what: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{what}: {brief(value)}; valid: a mapping of names to values")
    return dict(value)


def _strings(what: str, value: Any) -> tuple[str, ...]:
    entries: Sequence[Any] = value if isinstance(value, list) else [value]
    if not all(isinstance(entry, str) and entry for entry in entries):
        raise InputError(f"{what}: {brief(value)}; valid: a name, or a list of names")
    return tuple(entries)


def _number(what: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{what}: {brief(value)}; valid: a number")
    return float(value)


def _check_names(kind: str, names: Any, valid: Any) -> None:
    for name in names:
        check_name(kind, name, valid)
