// Stand-in for libfranka's header of the same name: only what the example uses, with the signatures
// of libfranka 0.9. The arm stands still; its joint 3 moves off by DRIFT rad/s, its joint 5 has the
// speed SPEED. Every torque that is commanded goes to standard error as "tau t dq1 tau1..tau7".
#pragma once
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>

#include "exception.h"
#include "model.h"

namespace franka {

class Duration {
 public:
  explicit Duration(uint64_t milliseconds) : milliseconds_(milliseconds) {}
  double toSec() const noexcept { return static_cast<double>(milliseconds_) / 1000.0; }

 private:
  uint64_t milliseconds_;
};

struct Torques {
  Torques(const std::array<double, 7>& torques) noexcept : tau_J(torques) {}
  std::array<double, 7> tau_J{};
  bool motion_finished = false;
};

inline Torques MotionFinished(Torques command) noexcept {
  command.motion_finished = true;
  return command;
}

class Robot {
 public:
  explicit Robot(const std::string& address) {
    if (address == "nowhere") throw Exception("no connection");
  }
  void setCollisionBehavior(const std::array<double, 7>&, const std::array<double, 7>&,
                            const std::array<double, 6>&, const std::array<double, 6>&) {}
  Model loadModel() { return Model(); }
  void control(std::function<Torques(const RobotState&, Duration)> callback,
               bool limit_rate = true, double cutoff_frequency = 100.0) {
    if (!limit_rate || cutoff_frequency != 100.0) throw Exception("unexpected arguments");
    RobotState state;
    state.q = {0, -0.8, 0, -2.4, 0, 1.6, 0.8};
    const double drift = number("DRIFT");
    state.dq[4] = number("SPEED");
    for (int k = 0; k < 100000; ++k) {
      const bool lost = k == 700;  // one packet lost: its time comes with the next
      const Torques command = callback(state, Duration(k == 0 ? 0 : lost ? 2 : 1));
      std::fprintf(stderr, "tau %d", k + (k >= 700));
      for (double x : command.tau_J) std::fprintf(stderr, " %.17g", x);
      std::fprintf(stderr, "\n");
      if (command.motion_finished) return;
      state.tau_J_d = command.tau_J;
      state.q[2] += drift / 1000.0;
    }
    throw Exception("never ended");
  }

 private:
  static double number(const char* name) {
    const char* text = std::getenv(name);
    return text ? std::atof(text) : 0.0;
  }
};

}  // namespace franka
