"""The page of an environment, Gymnasium's form: its sections, and tables that say what the code
has.
"""

import dataclasses
import inspect
import re

import gymnasium
import pytest

import stancekit.envs
from stancekit.envs import leap_choice, refinement, selection, traverse, warped_gait

SECTIONS = (
    "Description",
    "Observation Space",
    "Action Space",
    "Reward",
    "Starting State",
    "Episode End",
    "Info",
    "Arguments",
    "Version History",
)
SIZES = {"N": 3, "E": 4}
OF_LEAPS = {"P": 8, "R": 8, "M": 9}
OF_TRAVERSE = {"H": 2, "N": 6, "R": 1, "U": 4}
SETTINGS = {
    selection.EnvelopeSelectionEnv: selection.SelectionSettings,
    refinement.EnvelopeRefinementEnv: refinement.RefinementSettings,
    traverse.TraverseEnv: traverse.TraverseSettings,
    warped_gait.WarpedGaitEnv: warped_gait.GaitEnvSettings,
    leap_choice.LeapChoiceEnv: leap_choice.LeapChoiceSettings,
}
IDS = sorted(name for name in gymnasium.registry if name.startswith("stancekit/"))


def pages() -> list[tuple[str, type[gymnasium.Env]]]:
    return [
        (name, gymnasium.envs.registration.load_env_creator(gymnasium.spec(name).entry_point))
        for name in IDS
    ]


def table(page: str, section: str) -> list[list[str]]:
    """The rows of the table of a section, the first two columns of each."""
    (text,) = re.findall(rf"^## {section}$(.*?)(?=^## |\Z)", page, re.S | re.M)
    rows = [
        line.strip().strip("|").split("|") for line in text.splitlines() if line.startswith("|")
    ]
    return [[cell.strip() for cell in row[:2]] for row in rows[2:]]


@pytest.mark.parametrize(("name", "kind"), pages())
def test_a_page_has_all_sections_in_their_order(name, kind):
    page = inspect.getdoc(kind)
    assert tuple(re.findall(r"^## (.*)$", page, re.M)) == SECTIONS
    assert f"- v{gymnasium.spec(name).version}: " in page


@pytest.mark.parametrize(("name", "kind"), pages())
def test_the_arguments_are_the_real_ones_with_their_defaults(name, kind):
    known = {**vars(selection), **vars(traverse), **vars(warped_gait)}
    message = {
        argument: eval(default, known)
        for argument, default in table(inspect.getdoc(kind), "Arguments")
    }
    taken = inspect.signature(kind).parameters.values()
    real = {p.name: p.default for p in taken if p.kind is not p.VAR_KEYWORD}
    if len(real) < len(taken):
        settings = SETTINGS[kind]
        last = real.pop("render_mode")
        real |= {each.name: each.default for each in dataclasses.fields(settings)} | {
            "render_mode": last
        }
    assert message == real
    assert list(message) == list(real)


@pytest.mark.parametrize(("name", "kind"), pages())
def test_the_observation_is_the_real_one(name, kind):
    env = gymnasium.make(name).unwrapped
    sizes = {traverse.TraverseEnv: OF_TRAVERSE, leap_choice.LeapChoiceEnv: OF_LEAPS}.get(
        kind, SIZES
    )
    message = {
        key: eval(shape, dict(sizes))
        for key, shape in table(inspect.getdoc(kind), "Observation Space")
    }
    assert message == {key: box.shape for key, box in env.observation_space.spaces.items()}


def test_all_environments_were_looked_at():
    assert stancekit.envs is not None
    assert len(IDS) == 5
