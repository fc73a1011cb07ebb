// Named by a header of the controller, and not used by one that commands positions.
#pragma once
#include <ros/ros.h>

namespace control_toolbox {
struct Pid {
  bool init(const ros::NodeHandle&, bool = false) { return true; }
  void reset() {}
  double computeCommand(double, ros::Duration) { return 0.0; }
  double computeCommand(double, double, ros::Duration) { return 0.0; }
};
}  // namespace control_toolbox
