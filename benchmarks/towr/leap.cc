// One leap by TOWR: feet begin where they stand and land where they like on a grid of heights.
//
// Reads numbers from standard input (benchmarks/towr.py writes them, in this order) and prints one line:
//   status, processor seconds, worst constraint violation, then where each foot lands [m].
// Status is 1 where IPOPT ends with all constraints within its tolerance.
#include <ctime>
#include <iostream>
#include <memory>
#include <vector>

#include <ifopt/ipopt_solver.h>
#include <towr/models/single_rigid_body_dynamics.h>
#include <towr/nlp_formulation.h>

using Eigen::Vector3d;

namespace {

double Number() {
  double value;
  if (!(std::cin >> value)) std::exit(2);
  return value;
}

Vector3d Point() {
  const double x = Number(), y = Number(), z = Number();
  return Vector3d(x, y, z);
}

// Heights on a grid, between them bilinear.
class Grid : public towr::HeightMap {
 public:
  Grid() {
    friction_coeff_ = Number();
    x0_ = Number(), y0_ = Number(), spacing_ = Number();
    nx_ = int(Number()), ny_ = int(Number());
    for (int i = 0; i < nx_ * ny_; ++i) heights_.push_back(Number());
  }

  double GetHeight(double x, double y) const override {
    const Cell c = At(x, y);
    return (1 - c.u) * ((1 - c.v) * c.h00 + c.v * c.h01) + c.u * ((1 - c.v) * c.h10 + c.v * c.h11);
  }

  double GetHeightDerivWrtX(double x, double y) const override {
    const Cell c = At(x, y);
    return ((1 - c.v) * (c.h10 - c.h00) + c.v * (c.h11 - c.h01)) / spacing_;
  }

  double GetHeightDerivWrtY(double x, double y) const override {
    const Cell c = At(x, y);
    return ((1 - c.u) * (c.h01 - c.h00) + c.u * (c.h11 - c.h10)) / spacing_;
  }

  double GetHeightDerivWrtXY(double x, double y) const override {
    const Cell c = At(x, y);
    return (c.h11 - c.h10 - c.h01 + c.h00) / (spacing_ * spacing_);
  }

  double GetHeightDerivWrtYX(double x, double y) const override { return GetHeightDerivWrtXY(x, y); }

 private:
  struct Cell {
    double u, v, h00, h01, h10, h11;
  };

  Cell At(double x, double y) const {
    const double a = std::min(std::max((x - x0_) / spacing_, 0.0), nx_ - 1.000001);
    const double b = std::min(std::max((y - y0_) / spacing_, 0.0), ny_ - 1.000001);
    const int i = int(a), j = int(b);
    return {a - i, b - j, h(i, j), h(i, j + 1), h(i + 1, j), h(i + 1, j + 1)};
  }

  double h(int i, int j) const { return heights_[i * ny_ + j]; }

  double x0_, y0_, spacing_;
  int nx_, ny_;
  std::vector<double> heights_;
};

// A box of reach about the nominal place of every foot.
class Boxes : public towr::KinematicModel {
 public:
  explicit Boxes(int feet) : KinematicModel(feet) {
    for (auto& place : nominal_stance_) place = Point();
    max_dev_from_nominal_ = Point();
  }
};

}  // namespace

int main() {
  towr::NlpFormulation formulation;
  const double limit_s = Number(), mass_kg = Number(), force_n = Number();
  const Vector3d inertia = Point();
  const int feet = int(Number());
  formulation.model_.kinematic_model_ = std::make_shared<Boxes>(feet);
  formulation.model_.dynamic_model_ = std::make_shared<towr::SingleRigidBodyDynamics>(
      mass_kg, inertia.x(), inertia.y(), inertia.z(), 0.0, 0.0, 0.0, feet);
  formulation.initial_base_.lin.at(towr::kPos) = Point();
  formulation.final_base_.lin.at(towr::kPos) = Point();
  for (int foot = 0; foot < feet; ++foot) formulation.initial_ee_W_.push_back(Point());
  const std::vector<double> phases{Number(), Number(), Number()};  // stance, flight, stance
  formulation.terrain_ = std::make_shared<Grid>();
  for (int foot = 0; foot < feet; ++foot) {
    formulation.params_.ee_phase_durations_.push_back(phases);
    formulation.params_.ee_in_contact_at_start_.push_back(true);
  }
  formulation.params_.force_limit_in_normal_direction_ = force_n;

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
  std::cout << "\nLEAP " << (worst < 1e-3) << " " << used_s << " " << worst;
  const double end_s = solution.base_linear_->GetTotalTime();
  for (int foot = 0; foot < feet; ++foot)
    std::cout << " " << solution.ee_motion_.at(foot)->GetPoint(end_s).p().transpose();
  std::cout << std::endl;
}
