// A walk of ANYmal over level ground by TOWR's own model of it, as TOWR's ROS example asks for one.
//
// Arguments: combo of gaits (0: walk and stand, 1: trot, ...), seconds, metres ahead, rows per second, CPU seconds.
// Prints "WALK" with status, processor seconds, worst constraint violation and mass; then a line per row: time, base
// position, roll, pitch, yaw, and for LF, RF, LH, RH whether it stands, its position and its force.
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <memory>

#include <ifopt/ipopt_solver.h>
#include <towr/initialization/gait_generator.h>
#include <towr/models/robot_model.h>
#include <towr/models/single_rigid_body_dynamics.h>
#include <towr/nlp_formulation.h>
#include <towr/terrain/examples/height_map_examples.h>

int main(int, char** argument) {
  const int combo = std::atoi(argument[1]);
  const double seconds = std::atof(argument[2]), ahead_m = std::atof(argument[3]);
  const double rate_hz = std::atof(argument[4]), limit_s = std::atof(argument[5]);
  towr::NlpFormulation formulation;
  formulation.terrain_ = std::make_shared<towr::FlatGround>(0.0);
  formulation.model_ = towr::RobotModel(towr::RobotModel::Anymal);
  const auto stance = formulation.model_.kinematic_model_->GetNominalStanceInBase();
  const double height_m = -stance.front().z();
  formulation.initial_base_.lin.at(towr::kPos).z() = height_m;
  formulation.final_base_.lin.at(towr::kPos) << ahead_m, 0.0, height_m;
  for (auto place : stance) {
    place.z() = 0.0;
    formulation.initial_ee_W_.push_back(place);
  }
  auto gait = towr::GaitGenerator::MakeGaitGenerator(4);
  gait->SetCombo(static_cast<towr::GaitGenerator::Combos>(combo));
  for (int foot = 0; foot < 4; ++foot) {
    formulation.params_.ee_phase_durations_.push_back(gait->GetPhaseDurations(seconds, foot));
    formulation.params_.ee_in_contact_at_start_.push_back(gait->IsInContactAtStart(foot));
  }

  ifopt::Problem nlp;
  towr::SplineHolder solution;
  for (auto c : formulation.GetVariableSets(solution)) nlp.AddVariableSet(c);
  for (auto c : formulation.GetConstraints(solution)) nlp.AddConstraintSet(c);
  for (auto c : formulation.GetCosts()) nlp.AddCostSet(c);
  ifopt::IpoptSolver solver;
  solver.SetOption("jacobian_approximation", "exact");
  solver.SetOption("max_cpu_time", limit_s);
  solver.SetOption("print_level", 0);
  const std::clock_t begun = std::clock();
  solver.Solve(nlp);
  const double used_s = double(std::clock() - begun) / CLOCKS_PER_SEC;

  double worst = 0.0;
  const Eigen::VectorXd values = nlp.EvaluateConstraints(nlp.GetOptVariables()->GetValues().data());
  const auto bounds = nlp.GetBoundsOnConstraints();
  for (int i = 0; i < values.size(); ++i)
    worst = std::max({worst, bounds[i].lower_ - values[i], values[i] - bounds[i].upper_});
  std::cout.precision(17);
  std::cout << "\nWALK " << (worst < 1e-3) << " " << used_s << " " << worst << " "
            << formulation.model_.dynamic_model_->m() << "\n";
  for (int row = 0; row / rate_hz <= seconds + 1e-9; ++row) {
    const double t = std::min(row / rate_hz, seconds - 1e-9);
    std::cout << row / rate_hz << " " << solution.base_linear_->GetPoint(t).p().transpose() << " "
              << solution.base_angular_->GetPoint(t).p().transpose();
    for (int foot = 0; foot < 4; ++foot)
      std::cout << " " << solution.phase_durations_.at(foot)->IsContactPhase(t) << " "
                << solution.ee_motion_.at(foot)->GetPoint(t).p().transpose() << " "
                << solution.ee_force_.at(foot)->GetPoint(t).p().transpose();
    std::cout << "\n";
  }
}
