// The joints alone: each follows its position command with a first-order lag, and can get stuck. All above them is
// ros_control's own: controller_manager, joint_state_controller, joint_trajectory_controller. Both are started here.
// Its log has a line per period: wall-clock time [s], speed of the fastest joint [rad/s], angles [rad].
#include <atomic>
#include <controller_manager/controller_loader_interface.h>
#include <controller_manager/controller_manager.h>
#include <cstdio>
#include <hardware_interface/joint_command_interface.h>
#include <hardware_interface/joint_state_interface.h>
#include <hardware_interface/robot_hw.h>
#include <joint_state_controller/joint_state_controller.h>
#include <joint_trajectory_controller/joint_trajectory_controller.h>
#include <ros/ros.h>
#include <std_msgs/Float64.h>
#include <thread>
#include <trajectory_interface/quintic_spline_segment.h>

using Trajectories = joint_trajectory_controller::JointTrajectoryController<
    trajectory_interface::QuinticSplineSegment<double>, hardware_interface::PositionJointInterface>;

struct Loader : controller_manager::ControllerLoaderInterface {
  Loader() : ControllerLoaderInterface("linked in") {}
  controller_interface::ControllerBaseSharedPtr createInstance(const std::string& name) override {
    if (name == "position_controllers/JointTrajectoryController") return std::make_shared<Trajectories>();
    return std::make_shared<joint_state_controller::JointStateController>();
  }
  std::vector<std::string> getDeclaredClasses() override {
    return {"position_controllers/JointTrajectoryController", "joint_state_controller/JointStateController"};
  }
  void reload() override {}
};

struct Joints : hardware_interface::RobotHW {
  std::vector<std::string> names;
  std::vector<double> position, velocity, effort, command;
  hardware_interface::JointStateInterface states;
  hardware_interface::PositionJointInterface commands;
  double lag_s = 0.02;
  FILE* log = nullptr;
  std::atomic<int> stuck{-1};

  explicit Joints(const ros::NodeHandle& node) {
    std::string path;
    node.getParam("hw/joints", names);
    node.getParam("hw/start", position);
    node.getParam("hw/lag_s", lag_s);
    if (node.getParam("hw/log", path)) log = fopen(path.c_str(), "w");
    velocity.assign(names.size(), 0.0);
    effort = velocity;
    command = position;
    for (size_t k = 0; k < names.size(); ++k) {
      states.registerHandle({names[k], &position[k], &velocity[k], &effort[k]});
      commands.registerHandle({states.getHandle(names[k]), &command[k]});
    }
    registerInterface(&states);
    registerInterface(&commands);
  }

  void move(double time_s, double dt) {
    const double share = std::min(1.0, dt / lag_s);
    double fastest = 0.0;
    for (size_t k = 0; k < names.size(); ++k) {
      const double step = static_cast<int>(k) == stuck ? 0.0 : share * (command[k] - position[k]);
      position[k] += step;
      velocity[k] = step / dt;
      fastest = std::max(fastest, std::abs(velocity[k]));
    }
    if (!log) return;
    fprintf(log, "%.4f %.6f", time_s, fastest);
    for (double angle : position) fprintf(log, " %.5f", angle);
    fputc('\n', log);
    fflush(log);
  }
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "robot_hw");
  ros::NodeHandle node;
  Joints joints(node);
  controller_manager::ControllerManager manager(&joints, node);
  manager.registerControllerLoader(std::make_shared<Loader>());
  auto stick = [&](const std_msgs::Float64::ConstPtr& message) { joints.stuck = static_cast<int>(message->data); };
  ros::Subscriber subscriber = node.subscribe<std_msgs::Float64>("hw/stuck", 1, stick);
  ros::AsyncSpinner spinner(2);
  spinner.start();
  std::thread start([&] {
    const std::vector<std::string> both{"joint_state_controller", "joint_trajectory_controller"};
    for (const std::string& name : both) manager.loadController(name);
    manager.switchController(both, {}, controller_manager_msgs::SwitchController::Request::STRICT);
  });
  double rate_hz = 250.0;
  node.getParam("hw/rate_hz", rate_hz);
  ros::Rate rate(rate_hz);
  ros::Time last = ros::Time::now();
  while (ros::ok()) {
    rate.sleep();
    const ros::Time now = ros::Time::now();
    const ros::Duration dt = now - last;
    last = now;
    if (dt.toSec() <= 0.0) continue;
    manager.update(now, dt);
    joints.move(ros::WallTime::now().toSec(), dt.toSec());
  }
  start.join();
}
