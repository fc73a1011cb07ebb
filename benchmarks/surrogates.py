"""The surrogates that ship: labelled, learned, tested, and written with their cards.

    python benchmarks/surrogates.py [--classes wall-3] [--write] [--out out/surrogates]
    python benchmarks/surrogates.py --cards            # the table of docs/measured/screening.md

Rows and surrogates that are in the folder already are not made again. Networks learn from balanced rows, and from
rows as they come, which have trivially infeasible ones; they are calibrated on three tenths of these and
on further rows as they come, and tested on rows of other seeds. With one version of torch and one
kind of CPU the files are the same again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import ROOT, Options, launch
from screening import figures
from torch import __version__ as torch_version

import stancekit
from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import software
from stancekit.learners.surrogates.surrogate import (
    LabelledBatch,
    Surrogate,
    SurrogateSettings,
    fit_surrogate,
)
from stancekit.learners.zoo import card_of, shipped
from stancekit.planners.files.writing import write_bytes, write_text

FOLDER = ROOT / "learners" / "surrogates"


@dataclass(frozen=True, kw_only=True)
class Rows:
    """A data set: numbers of feasible and infeasible rows, or, natural, the sum of both as they come."""

    rows: tuple[int, int]
    seed: int
    natural: bool = False

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{'natural-' * self.natural}{self.rows[0]}-{self.rows[1]}-seed-{self.seed}"


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """The data of a class; a share of the rows to learn from calibrates, too."""

    learn: tuple[Rows, ...]
    calibrate: Rows
    test: tuple[Rows, ...]
    share: float = 0.3


RECIPES = {
    "wall-3": Recipe(
        learn=(Rows(rows=(8000, 8000), seed=0), Rows(rows=(3000, 3000), seed=1, natural=True)),
        calibrate=Rows(rows=(6000, 6000), seed=3, natural=True),
        test=(
            Rows(rows=(3000, 3000), seed=101),
            Rows(rows=(2000, 2000), seed=203, natural=True),
            Rows(rows=(6000, 6000), seed=204, natural=True),
        ),
    ),
    "wall-5": Recipe(
        learn=(Rows(rows=(4000, 4000), seed=0), Rows(rows=(4000, 4000), seed=3, natural=True)),
        calibrate=Rows(rows=(7000, 7000), seed=1, natural=True),
        test=(Rows(rows=(3000, 3000), seed=202), Rows(rows=(4000, 4000), seed=203, natural=True)),
    ),
}
LIMITS = (
    "Draws of one law of the default hexapod, one triangle per foot; other robots, classes, bodies and loads are refused.",
    "Errors hold per true class over problems as they are drawn, with 95 % over the calibration.",
    "Patches beyond the calibration are 'ask', and so is a batch of 64 or more that is not drawn as the class is; fewer "
    "problems cannot tell.",
    "Nothing is proved.",
)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """What to make of them."""

    out: Path = Path("out/surrogates")
    classes: tuple[str, ...] = tuple(RECIPES)
    write: bool = False
    """Put them, with their cards, into learners/surrogates."""
    cards: bool = False
    """Print the table of the cards, and make nothing."""


def main(options: Arguments) -> None:
    """Make them, and say what they are good for."""
    if options.cards:
        print("\n".join(table()))
        return
    for name in options.classes:
        recipe, folder = RECIPES[name], options.out / name
        surrogate = made(name, recipe, folder)
        test = LabelledBatch.of([labelled(name, rows, folder) for rows in recipe.test])
        found = list(figures(surrogate, test))
        path = folder / f"surrogate-{name}.safetensors"
        surrogate.save(path)
        for row in found:
            options.say({"class": name} | row)
        if options.write:
            content = path.read_bytes()
            card = {
                "method": "surrogate",
                "problem_class": name,
                "legs": list(surrogate.legs),
                "sha256": hashlib.sha256(content).hexdigest(),
                "learned": [rows.name for rows in recipe.learn],
                "calibrated": recipe.calibrate.name,
                "tested": [rows.name for rows in recipe.test],
                **{key: surrogate.provenance[key] for key in ("learned_from", "calibrated_on")},
                "figures": found,
                "limits": list(LIMITS),
                "software": software() | {"torch": torch_version},
            }
            write_bytes(FOLDER / path.name, content)
            write_text(FOLDER / f"{path.stem}.json", json.dumps(card, indent=1) + "\n")


def made(name: str, recipe: Recipe, folder: Path) -> Surrogate:
    """The surrogate of a class, learned and calibrated."""
    path = folder / f"surrogate-{name}.safetensors"
    if path.exists():
        return Surrogate.read(path)
    return fit_surrogate(
        [labelled(name, rows, folder) for rows in recipe.learn],
        SurrogateSettings(calibration=recipe.share),
        calibration=labelled(name, recipe.calibrate, folder),
    )


def labelled(name: str, rows: Rows, folder: Path) -> Dataset:
    """A data set of the recipe, made where it is not there."""
    path = folder / rows.name
    return stancekit.label(name, path, rows=rows.rows, natural=rows.natural, seed=rows.seed)


def table() -> Iterator[str]:
    """Markdown: a row per surrogate and stated error."""
    yield (
        "| name | stated | truly feasible, called infeasible | truly infeasible, called feasible | "
        "trivially so, called feasible | decided of each | µs |"
    )
    yield "|---|---|---|---|---|---|---|"
    for name, file in shipped("surrogates").items():
        rows = card_of(file)["figures"]
        for error in sorted({row["error"] for row in rows}):
            mine = {row["truly"]: row for row in rows if row["error"] == error}
            cells = [
                f"{row['wrong']} of {row['rows']:,}, up to {100 * row['at_most']:.2f} %"
                if (row := mine.get(kind))
                else "–"
                for kind in ("feasible", "infeasible", "trivial")
            ]
            decided = ", ".join(f"{100 * row['decided']:.0f} %" for row in mine.values())
            each_us = np.mean([row["us"] for row in mine.values()])
            yield f"| `{name}` | {100 * error:g} % | {' | '.join(cells)} | {decided} | {each_us:.0f} |"


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
