// Stand-in for libfranka's header of the same name: only what the example uses. Gravity pulls joint
// 2 by 20 N m; no joint moves another.
#pragma once
#include <array>

namespace franka {

struct RobotState {
  std::array<double, 7> q{};
  std::array<double, 7> dq{};
  std::array<double, 7> tau_J_d{};
};

class Model {
 public:
  std::array<double, 7> gravity(const RobotState&) const { return {0, 20, 0, 0, 0, 0, 0}; }
  std::array<double, 7> coriolis(const RobotState&) const { return {}; }
  std::array<double, 49> mass(const RobotState&) const {
    std::array<double, 49> out{};
    for (std::size_t j = 0; j < 7; ++j) out[8 * j] = 0.5;
    return out;
  }
};

}  // namespace franka
