"""One list of methods: each learns a selector that is written and read back and answers the
same.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.data.labelling import check_unseen
from stancekit.learners.leaps.kinds import KINDS
from stancekit.learners.selectors.selector import load_selector
from stancekit.learners.training.fitting import (
    KNOBS,
    METHODS,
    FitSettings,
    fit,
    learn,
    learn_selector,
)
from stancekit.planners.equilibrium.scaled import Scaled, observe
from stancekit.planners.errors import InvalidInput
from tests.refusals import refuses

SETTINGS = FitSettings(
    steps=2,
    batch=4,
    boxes=2,
    time_limit_s=1.0,
    genetic={"population": 4, "generations": 2, "terrains": 4},
    neural={"epochs": 1, "margin_epochs": 1},
)


@pytest.fixture(scope="module")
def dataset(labelled: Callable[..., Dataset]) -> Dataset:
    return labelled(20, 20, 4, shard_size=20)


@pytest.mark.parametrize("method", [name for name in METHODS.names() if name != "modes"])
def test_what_a_method_learns_can_be_written_read_and_asked(
    dataset: Dataset, tmp_path: Path, method: str
) -> None:
    learned = learn_selector(method, dataset, SETTINGS)
    path = tmp_path / f"selector{learned.suffix}"
    learned.write(path)
    again = load_selector(path)
    assert (
        (again.problem_class, again.boxes)
        == (learned.problem_class, learned.boxes)
        == ("wall-3", learned.boxes)
    )
    assert again.relaxation == learned.relaxation == ("joint" if method == "joint" else "p1")
    assert learned.boxes == (2 if method == "gradient" else 1)
    for problem in list(dataset.problems())[:3]:
        seen = observe(Scaled.of(problem))
        first, second = (one.selector.predict(seen)[0] for one in (learned, again))
        assert first.shape == ({"p1": 36, "joint": 54}[learned.relaxation] * learned.boxes,)
        np.testing.assert_allclose(first, second, atol=1e-6)
        assert np.all(np.abs(first) <= 1.0 + 1e-6)


def test_every_method_says_which_settings_made_it(dataset: Dataset) -> None:
    assert set(KNOBS) == {*METHODS.names(), "surrogate", *KINDS}
    assert fit("quantile", dataset, SETTINGS).provenance["settings"] == {"share": 0.05}
    assert SETTINGS.concerning("ga") == {
        "genetic": {"population": 4, "generations": 2, "terrains": 4}
    }


@pytest.mark.parametrize(
    ("method", "values", "message"),
    [
        (
            "ga",
            {"genetic": {"poulation": 3}},
            "genetic.poulation: expected one of population, generations, ",
        ),
        ("ga", {"genetic": {"population": "many"}}, "genetic.population: "),
        (
            "ga",
            {"genetic": {"population": 1}},
            "genetic.population: expected greater than or equal to 2, got 1",
        ),
        (
            "neural",
            {"neural": {"epoch": 3}},
            "neural.epoch: expected one of architecture, share, epochs, ",
        ),
        ("gmm", {"steps": 0}, "steps: expected greater than 0, got 0"),
        ("quantile", {"share": 0.7}, "share: expected less than 0.5, got 0.7"),
    ],
)
def test_settings_that_make_no_sense_are_told_by_key(
    method: str, values: dict[str, object], message: str
) -> None:
    with pytest.raises(InvalidInput) as error:
        FitSettings(**values).check(method)  # type: ignore[arg-type]
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(("feasible", "infeasible"), [(3, 20), (20, 1), (1, 1)])
def test_too_few_rows_are_refused_with_the_count_that_was_given(
    dataset: Dataset, feasible: int, infeasible: int
) -> None:
    some = np.concatenate([dataset.feasible[:feasible], dataset.infeasible[:infeasible]])
    with refuses(f"{feasible} feasible and {infeasible} infeasible"):
        learn("neural", dataset.select(some), SETTINGS)


def test_unknown_methods_and_too_little_data_are_refused(dataset: Dataset) -> None:
    with refuses("method", "surrogate, additive, set, or FILE.py:NAME"):
        learn("luck", dataset)  # type: ignore[arg-type]
    with refuses("data set"):
        learn("gmm", dataset.select(dataset.infeasible))


def test_rows_that_were_learned_from_calibrate_nothing(dataset: Dataset) -> None:
    train, held = dataset.split((0.6, 0.4))
    for method in ("neural", "joint"):
        with refuses("calibration"):
            learn(method, train, SETTINGS, calibration=dataset)
    assert learn_selector("neural", train, SETTINGS, calibration=held).provenance["calibration"]


OWN = """
class Chooses:
    def predict(self, observation):
        return None, None

def box(request):
    from stancekit.learners.training.fitting import fit
    from dataclasses import replace

    return replace(fit("heuristic", request.dataset), provenance={"mine": 1})

def selector(request):
    return Chooses()
"""


@pytest.mark.parametrize("name", ["box", "selector"])
def test_the_method_of_a_file_has_seen_its_rows(
    dataset: Dataset, tmp_path: Path, name: str
) -> None:
    (tmp_path / "own.py").write_text(OWN)
    learned = learn_selector(f"{tmp_path}/own.py:{name}", dataset)
    with refuses("mine"):
        check_unseen(dataset, learned.provenance, "mine")


@pytest.mark.parametrize(
    ("content", "name", "message"),
    [
        (None, "x.json", "expected a file, found nothing there"),
        (b"", "x.json", "expected some text, the file is empty"),
        (b"{}", "x.json", "format: "),
        (b"\x80\x04pickle", "x.json", "expected UTF-8 text, byte 0 is not"),
        (
            b"\x80\x04pickle",
            "x.safetensors",
            "expected a whole safetensors file, got something else",
        ),
        (
            (12).to_bytes(8, "little") + b'{"a": "b  "}',
            "x.safetensors",
            "expected format stancekit/neural/1, ",
        ),
    ],
)
def test_files_that_are_no_selectors_are_refused(
    tmp_path: Path, content: bytes | None, name: str, message: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InvalidInput) as error:
        load_selector(path)
    assert str(error.value).startswith(f"{path}: {message}")


def test_a_truncated_network_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    learned = learn_selector("neural", dataset, SETTINGS)
    learned.write(tmp_path / "whole.safetensors")
    content = (tmp_path / "whole.safetensors").read_bytes()
    for size in (4, 100, len(content) // 2, len(content) - 1):
        (tmp_path / "cut.safetensors").write_bytes(content[:size])
        with refuses("cut.safetensors"):
            load_selector(tmp_path / "cut.safetensors")
