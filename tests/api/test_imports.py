"""What is imported where: the large packages only by what needs them."""

import subprocess
import sys

import pytest

LARGE = ("casadi", "pyarrow", "cvxpy", "matplotlib", "torch")
SOLVE = """
problem = stancekit.sample("wall-3", rng=8)[0]
outcome = stancekit.solve(problem)
assert outcome.status.value == "infeasible"
"""
EXPLAIN = """
assert stancekit.verify(outcome.certificate).accepted
assert stancekit.explain(outcome.certificate).relaxations
"""
ENVIRONMENT = """
import gymnasium
env = gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


def loaded_by(code: str) -> list[str]:
    """Those of the large packages that a fresh interpreter has loaded after it ran the code."""
    code = (
        f"import sys, stancekit\n{code}\nprint(*(name for name in {LARGE} if name in sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.split()


@pytest.mark.parametrize(
    "code", ["", SOLVE, SOLVE + EXPLAIN, ENVIRONMENT], ids=["import", "solve", "explain", "env"]
)
def test_neither_the_import_nor_a_first_answer_loads_a_large_package(code: str) -> None:
    assert loaded_by(code) == []


def test_a_plan_of_a_climb_loads_no_large_package() -> None:
    assert loaded_by("assert stancekit.plan('stairs', frames=2).solution is not None") == []


def test_a_package_is_loaded_by_what_needs_it() -> None:
    assert loaded_by(SOLVE + "stancekit.draw(problem)") == ["matplotlib"]
