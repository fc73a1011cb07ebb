"""Nodes of ROS 1 that are in the way of a robot: e-stops, second publishers, other clients.
Debian's Python runs it.

    /usr/bin/python3 nodes.py NODE [ARGUMENT …]

It prints "ready", and "did" when it has done what it does. An e-stop reads lines: ``press``,
``release``.
"""

import sys
import threading

import rospy
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Int8


def say(word):
    """Tell whoever started the node."""
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


def estop(how):
    """An e-stop: regular (5 Hz), latched, quiet (says something when it is pressed alone), or
    int8.
    """
    kind = Int8 if how == "int8" else Bool
    publisher = rospy.Publisher("/e_stop", kind, queue_size=1, latch=how != "regular")
    pressed = [False]

    def regularly():
        rate = rospy.Rate(5)
        while not rospy.is_shutdown():
            publisher.publish(pressed[0])
            rate.sleep()

    if how == "regular":
        threading.Thread(target=regularly, daemon=True).start()
    elif how != "quiet":
        publisher.publish(1 if how == "int8" else False)
    say("ready")
    for line in sys.stdin:
        pressed[0] = line.strip() == "press"
        publisher.publish(pressed[0])
        say("did")


def states(what, rate_hz, seconds):
    """A second publisher of joint states: zeros, shifted, nan, short (the robot's names, no
    positions), wheels.
    """
    topic = "/joint_states"
    publisher = rospy.Publisher(topic, JointState, queue_size=1)
    true = rospy.wait_for_message(topic, JointState)
    rospy.sleep(0.3)
    say("ready")
    rate, end = rospy.Rate(float(rate_hz)), rospy.get_time() + float(seconds)
    while rospy.get_time() < end and not rospy.is_shutdown():
        message = JointState()
        message.header.stamp = rospy.Time.now()
        if what == "zeros":
            message.name, message.position = true.name, [0.0] * len(true.name)
        elif what == "shifted":
            message.name, message.position = true.name, [angle + 0.2 for angle in true.position]
        elif what == "nan":
            message.name, message.position = true.name[:4], [float("nan")] * 4
        elif what == "short":
            message.name, message.velocity = true.name[:4], [0.0] * 4
        elif what == "wheels":
            message.name, message.velocity = ["left_wheel", "right_wheel"], [0.5, 0.5]
        publisher.publish(message)
        rate.sleep()


def relay(what, topic):
    """The joint states again, on another topic, with stamps of 0 or two seconds old."""
    publisher = rospy.Publisher(topic, JointState, queue_size=1)

    def on_message(message):
        old = message.header.stamp - rospy.Duration(2.0)
        message.header.stamp = rospy.Time(0) if what == "unstamped" else old
        publisher.publish(message)

    rospy.Subscriber("/joint_states", JointState, on_message)
    say("ready")
    rospy.spin()


def goal(rad):
    """Another client with a goal of 3 s."""
    import actionlib
    from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
    from trajectory_msgs.msg import JointTrajectoryPoint

    client = actionlib.SimpleActionClient(
        "/joint_trajectory_controller/follow_joint_trajectory", FollowJointTrajectoryAction
    )
    client.wait_for_server()
    say("ready")
    sys.stdin.readline()
    true = rospy.wait_for_message("/joint_states", JointState)
    goal = FollowJointTrajectoryGoal()
    goal.trajectory.joint_names = true.name
    positions = [angle + float(rad) for angle in true.position]
    goal.trajectory.points = [
        JointTrajectoryPoint(positions=positions, time_from_start=rospy.Duration(3.0))
    ]
    client.send_goal(goal)
    say("did")
    client.wait_for_result()


def commands(seconds):
    """Another client that streams the pose that it found."""
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    publisher = rospy.Publisher(
        "/joint_trajectory_controller/command", JointTrajectory, queue_size=1
    )
    true = rospy.wait_for_message("/joint_states", JointState)
    say("ready")
    sys.stdin.readline()
    say("did")
    rate, end = rospy.Rate(40), rospy.get_time() + float(seconds)
    while rospy.get_time() < end:
        point = JointTrajectoryPoint(positions=true.position, time_from_start=rospy.Duration(0.06))
        publisher.publish(JointTrajectory(joint_names=true.name, points=[point]))
        rate.sleep()


def late(seconds, times="1"):
    """A controller that connects to the publisher of its commands so long after that is there for
    so many times.
    """
    from trajectory_msgs.msg import JointTrajectory

    topic = "/joint_trajectory_controller/command"
    publisher = rospy.Publisher("/late", JointTrajectory, queue_size=1)
    say("ready")
    for there in [True] + [False, True] * (int(times) - 1):
        while (topic in dict(rospy.get_published_topics())) != there:
            rospy.sleep(0.05)
    rospy.sleep(float(seconds))
    rospy.Subscriber(topic, JointTrajectory, publisher.publish, queue_size=1)
    rospy.spin()


def stuck(joint):
    """A joint that turns no more."""
    publisher = rospy.Publisher("/hw/stuck", Float64, queue_size=1, latch=True)
    say("ready")
    sys.stdin.readline()
    publisher.publish(float(joint))
    say("did")
    rospy.sleep(30.0)


def switch():
    """The manager stops the controller."""
    from controller_manager_msgs.srv import SwitchController

    service = rospy.ServiceProxy("/controller_manager/switch_controller", SwitchController)
    service.wait_for_service()
    say("ready")
    sys.stdin.readline()
    service([], ["joint_trajectory_controller"], 2, False, 0.0)
    say("did")


if __name__ == "__main__":
    rospy.init_node(f"fault_{sys.argv[1]}", anonymous=True, disable_signals=True)
    globals()[sys.argv[1]](*sys.argv[2:])
