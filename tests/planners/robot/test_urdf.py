"""The URDF of the robot: what a reader of XML, and pinocchio, find in it."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from stancekit.planners.robot import hexapod
from stancekit.planners.robot.kinematics import link_lengths
from stancekit.planners.robot.robot_file import FOOT_RADIUS_M, Servo, drawn_urdf
from tests.refusals import refuses


def parsed(**options: bool) -> ElementTree.Element:
    return ElementTree.fromstring(drawn_urdf(hexapod(), **options))


def test_it_has_four_joints_a_limb_and_a_foot_that_is_a_sphere() -> None:
    root = parsed()
    moving = [
        joint.get("name") for joint in root.findall("joint") if joint.get("type") == "revolute"
    ]
    assert moving == list(hexapod().joint_names)
    assert len(moving) == 24
    for name in (leg.foot for leg in hexapod().legs.legs):
        sphere = root.find(f"link[@name='{name}']/collision/geometry/sphere")
        assert sphere is not None
        assert float(sphere.get("radius", "")) == FOOT_RADIUS_M


def test_all_links_together_weigh_what_the_robot_does_and_nearly_all_of_it_is_in_the_body() -> None:
    masses = {
        link.get("name"): float(link.find("inertial/mass").get("value"))
        for link in parsed().findall("link")
    }
    assert sum(masses.values()) == pytest.approx(hexapod().mass_kg, rel=1e-9)
    assert masses["body"] > 0.85 * hexapod().mass_kg


def test_shoulders_are_where_the_planners_have_them() -> None:
    root = parsed()
    for limb in hexapod().limbs:
        origin = root.find(f"joint[@name='{limb.name}_yaw']/origin")
        assert origin is not None
        np.testing.assert_allclose(
            [float(x) for x in origin.get("xyz", "").split()], limb.shoulder_m, atol=1e-9
        )


def test_a_straight_limb_is_longer_than_the_reach_and_a_foot() -> None:
    for limb in hexapod().limbs:
        assert link_lengths(limb).sum() > limb.reach_m + FOOT_RADIUS_M


def test_every_inertia_is_one_that_a_body_can_have() -> None:
    links = parsed().findall("link")
    assert len(links) == 31
    for link in links:
        inertia = link.find("inertial/inertia")
        assert inertia is not None
        a, b, c = sorted(float(inertia.get(axis, "")) for axis in ("ixx", "iyy", "izz"))
        assert a > 0.0
        assert a + b >= c * (1.0 - 1e-9)


def test_pinocchio_reads_limits_and_masses_as_they_were_meant() -> None:
    pin = pytest.importorskip("pinocchio")
    servo = Servo(torque_nm=12.0, velocity_rad_s=3.0)
    model = pin.buildModelFromXML(drawn_urdf(hexapod(), servo), pin.JointModelFreeFlyer())
    assert list(model.names)[2:] == list(hexapod().joint_names)
    np.testing.assert_allclose(model.lowerPositionLimit[7:], np.tile(servo.lower_rad, 6))
    np.testing.assert_allclose(model.upperPositionLimit[7:], np.tile(servo.upper_rad, 6))
    np.testing.assert_allclose(model.velocityLimit[6:], 3.0)
    assert pin.computeTotalMass(model) == pytest.approx(10.0)


def test_a_servo_without_torque_is_refused() -> None:
    with refuses("torque_nm"):
        Servo(torque_nm=0.0)
