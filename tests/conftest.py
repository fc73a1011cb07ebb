"""What tests share: drawn and made-up scenes, and the model of paper E written a second time."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import cvxpy as cp
import joblib
import numpy as np
import pytest
from _pytest.runner import runtestprotocol
from hypothesis import settings

from stancekit import Motion
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.learners.data import executors
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.robot import hexapod
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from tests.emulators.pulse import Pulse
from tests.refusals import assert_refusals_say, heard

settings.register_profile("the same examples in every run", derandomize=True, deadline=None)
settings.load_profile("the same examples in every run")


REAL_TIME = ("tests/runner/", "tests/cli/test_run.py", "tests/emulators/")
"""Tests of hosts and robots that have milliseconds to answer each other."""
LATE_S, TRIES = 0.03, 3
"""A test of these that fails while the computer kept a thread waiting for longer says nothing: it
is tried again."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Try a test of real time again where the computer, and not the robot, was late; what is wrong
    fails each time.
    """
    if not item.nodeid.startswith(REAL_TIME):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for turn in range(TRIES):
        with Pulse() as pulse:
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        if (
            turn + 1 == TRIES
            or not any(report.failed for report in reports)
            or pulse.worst_s < LATE_S
        ):
            break
        late = f"tried again: the computer kept a thread waiting for {1e3 * pulse.worst_s:.0f} ms"
        item.warn(pytest.PytestWarning(late))
        item._initrequest()  # type: ignore[attr-defined]  # fixtures of its own anew
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_configure() -> None:
    """What is imported and collected stays: the collector of cycles does not look at it, then or
    later.
    """
    gc.disable()


def pytest_collection_finish() -> None:
    """From here on there is garbage."""
    gc.freeze()
    gc.set_threshold(20_000)
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _what_takes_long_to_make_is_kept(
    tmp_path_factory: pytest.TempPathFactory, pytestconfig: pytest.Config
) -> Iterator[None]:
    """Workspaces are measured once, by whichever test asks first in any process, and not kept in
    the user's folder. Machine code is kept from run to run: numba makes it anew for other sources.
    Worker processes stay for those who ask next.
    """
    mine = tmp_path_factory.getbasetemp()
    kept = (mine.parent if "PYTEST_XDIST_WORKER" in os.environ else mine) / "legs"
    kept.mkdir(exist_ok=True)
    if pytestconfig.pluginmanager.has_plugin("cacheprovider"):
        with suppress(FileExistsError):
            (kept / "numba").symlink_to(pytestconfig.cache.mkdir("numba"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STANCEKIT_CACHE", str(kept))
        patch.setattr(executors, "_IDLE_S", 3600)
        yield


@pytest.fixture(scope="session")
def refusals_met() -> Iterator[dict[str, bool]]:
    """Messages of errors since the test began."""
    messages = dict[str, bool]()
    with heard(messages):
        yield messages


@pytest.fixture(autouse=True)
def _every_refusal_says_where_what_was_expected_and_what_came(
    refusals_met: dict[str, bool],
) -> Iterator[None]:
    """Fail a test that meets an ``InvalidInput`` of another form."""
    refusals_met.clear()
    yield
    assert_refusals_say(refusals_met)


@pytest.fixture(scope="session")
def programs() -> Programs:
    """The programs as rows, once a process."""
    return Programs()


@pytest.fixture(scope="session")
def drawn() -> Callable[[str, int], Problem]:
    """``drawn(name, seed)``: the first problem that a distribution draws from this seed."""
    return cache(lambda name, seed: DISTRIBUTIONS[name].sample(np.random.default_rng(seed)))


@pytest.fixture(scope="session")
def course_plan() -> Callable[[str, int], Motion]:
    """``course_plan(name, frames)``: the plan of a built-in course, made once."""

    @cache
    def plan(name: str, frames: int) -> Motion:
        outcome = TwoStage().solve(read_course(name, frames=frames))
        assert outcome.solution is not None
        return outcome.solution

    return plan


@pytest.fixture(scope="session")
def mixed() -> Callable[[int, tuple[int, ...]], Problem]:
    """``mixed(seed, corners)``: limbs on uneven ground, one polygon of so many corners each."""
    return cache(_mixed)


@pytest.fixture(scope="session")
def written() -> Callable[[Problem], Written]:
    """Paper E §II written from the problem's own numbers, contact by contact, sharing no line with
    the planners.
    """
    return Written


def _mixed(seed: int, corners: tuple[int, ...]) -> Problem:
    rng = np.random.default_rng(seed)
    contacts = []
    for limb, count in zip(
        hexapod().select(("RF", "LR", "LF", "RR", "RM", "LM")), corners, strict=False
    ):
        normal = np.array([*rng.uniform(-0.5, 0.5, 2), 1.0])
        normal = normal / np.linalg.norm(normal)
        first = np.cross(normal, [0.3, 1.0, 0.2])
        first = first / np.linalg.norm(first)
        angle = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
        border = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(normal, first))
        centre = 1.8 * limb.shoulder_m + [0.0, 0.0, -0.2] + rng.uniform(-0.12, 0.12, 3)
        patch = Patch(
            vertices_m=centre + rng.uniform(0.03, 0.08) * border,
            normal=normal,
            shear_reference=rng.normal(size=3) * [1.0, 1.0, 0.3],
            friction=rng.uniform(0.1, 0.8),
        )
        shear = rng.uniform(0.2, 1.0, 4)
        contacts.append(
            Contact(
                leg=limb.name,
                shoulder_m=limb.shoulder_m,
                reach_m=limb.reach_m,
                patch=patch,
                force_min=[0.0, *-shear[:2]],
                force_max=[rng.uniform(0.5, 1.0), *shear[2:]],
            )
        )
    return Problem.posture(
        contacts=tuple(contacts), mass_kg=10.0, com_nominal_m=np.zeros(3), com_radius_m=0.05
    )


@dataclass(eq=False)
class Written:
    """Variables and convex constraints of one posture problem (all but the bilinear one),
    non-dimensional.

    positions: p of E2, shape (N, 3); forces: f of E3, shape (N, 3). ``on_patches`` is separate, for
    toes held.
    """

    problem: Problem
    com: cp.Variable = field(default_factory=lambda: cp.Variable(3))
    rotation: cp.Variable = field(default_factory=lambda: cp.Variable(3))

    def __post_init__(self) -> None:
        problem, length = self.problem, self.problem.length_scale_m
        count = len(problem.contacts)
        self.weight = problem.mass_kg * problem.gravity_m_s2 / problem.force_scale_n
        self.toes, self.forces = cp.Variable((count, 3)), cp.Variable((count, 3))
        self.shares = [cp.Variable(len(contact.patch.vertices_m)) for contact in problem.contacts]
        self.vertices = [contact.patch.vertices_m / length for contact in problem.contacts]
        self.frames = [frame_of(contact.patch) for contact in problem.contacts]
        self.body = [
            cp.norm(self.com - problem.com_nominal_m[0] / length)
            <= problem.com_radius_m[0] / length,
            cp.abs(self.rotation) <= problem.tilt_limit_rad,
        ]
        self.on_patches, self.in_reach, self.in_cones = [], [], []
        net = -self.weight * np.array([0.0, 0.0, 1.0])
        for i, contact in enumerate(problem.contacts):
            toe, f, share = self.toes[i], self.forces[i], self.shares[i]
            turned = (
                cross_with(contact.shoulder_m / length) @ self.rotation * -1.0
            )  # Θ × v = −v × Θ
            leg = toe - self.com - contact.shoulder_m / length - turned
            self.on_patches += [toe == self.vertices[i].T @ share, cp.sum(share) == 1, share >= 0]
            self.in_reach.append(cp.norm(leg) <= contact.reach_m / length)
            self.in_cones += [cp.norm(f[1:]) <= contact.patch.friction * f[0]]
            self.in_cones += [f >= contact.force_min, f <= contact.force_max]
            net = net + self.frames[i] @ f
        self.balance = net == 0

    @property
    def convex(self) -> list[cp.Constraint]:
        """All constraints of P̄."""
        return [*self.body, *self.on_patches, *self.in_reach, *self.in_cones, self.balance]

    def moment_of(self, toes: np.ndarray) -> cp.Expression:
        """Σ (q − c) × C f with the toes q held, c × e_z linear because of the balance of forces."""
        arms = [
            cross_with(toe) @ frame @ self.forces[i]
            for i, (toe, frame) in enumerate(zip(toes, self.frames, strict=True))
        ]
        return sum(arms) - self.weight * cross_with(np.array([0.0, 0.0, -1.0])) @ self.com


def frame_of(patch: Patch) -> np.ndarray:
    """R_WC: n, then y = z × n, then z, the shear reference in the plane."""
    n, reference = patch.normal, patch.shear_reference
    z = np.cross(n, np.cross(reference, n))
    z = z / np.linalg.norm(z)
    return np.column_stack([n, np.cross(z, n), z])


def cross_with(v: np.ndarray) -> np.ndarray:
    """The matrix of v × ·."""
    return np.cross(v, np.eye(3)).T


@pytest.fixture(scope="session")
def timed() -> dict[str, Any]:
    """What plans came to that were timed before, by everything that it depends on."""
    return {}


@pytest.fixture
def each_plan_is_timed_once(timed: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of one plan, on one kind of world, at one pace, share its postures, its time
    parametrisation and whether its bodies collide, most of a run's work.
    """
    from stancekit.runner import prepared
    from stancekit.runner.motion import time_parametrization

    resolve, parametrize, collide = (
        time_parametrization.resolved,
        time_parametrization.parametrize,
        prepared.motion_bodies,
    )

    def body(kinematics: Any) -> tuple[Any, ...]:
        return kinematics.robot, kinematics.servo, kinematics.gravity_m_s2, kinematics.near_rad

    def once(
        make: Callable[..., Any], key: tuple[Any, ...], *arguments: Any, **options: Any
    ) -> Any:
        asked = str(joblib.hash((make.__name__, key)))
        if asked not in timed:
            timed[asked] = make(*arguments, **options)
        return timed[asked]

    def postures(motion: Any, kinematics: Any) -> Any:
        if motion.path is None:
            return resolve(motion, kinematics)
        key = (motion.path.plan.digest, motion.seconds, body(kinematics))
        return once(resolve, key, motion, kinematics)

    def paced(motion: Any, kinematics: Any, can: Any, **options: Any) -> Any:
        return once(
            parametrize,
            (
                motion.path.plan.digest,
                (motion.pace, motion.bound_by, motion.seconds),
                motion.at(motion.knots_s),
                body(kinematics),
                can,
                options,
            ),
            motion,
            kinematics,
            can,
            **options,
        )

    def collision(plan: Any, rows: Any, kinematics: Any) -> Any:
        key = (plan.digest, rows.angles_rad, body(kinematics))
        return once(collide, key, plan, rows, kinematics)

    for module, name, kept in (
        (time_parametrization, "resolved", postures),
        (time_parametrization, "parametrize", paced),
        (prepared, "parametrize", paced),
        (prepared, "motion_bodies", collision),
    ):
        monkeypatch.setattr(module, name, kept)


@pytest.fixture(scope="session")
def written_gaits() -> dict[str, Any]:
    """Programs of gaits that were written down before, by task and settings."""
    return {}


@pytest.fixture
def each_gait_is_written_once(
    written_gaits: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Walks of one task, in charts without a map of the terrain, share their program and what IPOPT
    compiled of it, which answers every solve as if it were the first.
    """
    from stancekit.planners.gait.charts import CHARTS
    from stancekit.planners.gait.method import attempt

    write = attempt.formulate

    def once(task: Any, settings: Any, flattened: Any, programs: Any) -> Any:
        if not CHARTS.get(settings.chart).scales:
            return write(task, settings, flattened, programs)
        asked = str(joblib.hash((task, settings)))
        if asked not in written_gaits:
            written_gaits[asked] = write(task, settings, flattened, programs)
        return written_gaits[asked]

    monkeypatch.setattr(attempt, "formulate", once)


@pytest.fixture(scope="session")
def gl() -> None:
    """Pass a test over where MuJoCo's renderer finds no GL library, which ``test_film`` asserts the
    message of.
    """
    from stancekit.planners.errors import InvalidInput
    from stancekit.views.film import check_film

    try:
        check_film("film.mp4")
    except InvalidInput as error:
        pytest.skip(str(error))
