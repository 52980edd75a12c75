// Holds a Franka arm where it stands, shakes its joints and compensates their friction as a file of
// stiction-envs says: final.yaml, or final.csv, which has dither or else compensation.
//
//   dither_hold ROBOT-IP final.yaml [SECONDS]
//
// NOT COMPILED AGAINST LIBFRANKA IN THIS PROJECT'S CI, AND NEVER RUN ON A ROBOT BY IT. Tests compile
// and run it against a stand-in of the few calls below. Written for libfranka 0.9 and later:
//
//   g++ -std=c++17 -O2 main.cpp -o dither_hold -lfranka -lpthread
//
// BEFORE YOU RUN IT, check and be sure that
//  - nobody and nothing is within reach of the arm, and the stop button is in your hand;
//  - mass, centre of mass and inertia of tool and load are set (Desk, or Robot::setLoad): the robot
//    compensates gravity with them, and an arm with a wrong load sinks or rises when this starts;
//  - the arm is still, away from its joints' limits, and touches nothing: here it is held by weak
//    springs, not by its position controller;
//  - the table was tuned for THIS robot and this load. Begin with its amplitudes divided by ten
//    (kShare below) and 3 s, listen, and raise it step by step;
//  - a compensation of more than the joint's true friction does not come to rest: raise it slowly;
//  - frequencies are not those of the table or cell on which the robot stands;
//  - the limits below suit you: what is beyond them is refused before anything moves.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>

#include <franka/exception.h>
#include <franka/model.h>
#include <franka/robot.h>

#include "compensation.hpp"
#include "dither.hpp"

using Joints = std::array<double, 7>;

// Assumed, for caution: no source asks for these values.
constexpr double kShare = 0.1;         // of dither and compensation: raise it to 1 by hand
constexpr double kSoft = 1.0;          // s in which both fade in, and out before the end
constexpr double kMostSeconds = 60.0;  // longest run
constexpr double kMostDrift = 0.1;     // rad from where the arm stood: stop
constexpr double kMostSpeed = 0.5;     // rad/s: stop
// Of the robot (Franka Control Interface documentation).
constexpr double kMostRate = 1000.0;  // N m/s
// Largest dither and compensation, assumed: a tenth of what each joint can do (87 and 12) [N m].
constexpr Joints kMostTorque = {8.7, 8.7, 8.7, 8.7, 1.2, 1.2, 1.2};
// Springs and dampers that hold the arm: libfranka's joint_impedance_control.cpp.
constexpr Joints kStiffness = {600, 600, 600, 600, 250, 150, 50};  // N m/rad
constexpr Joints kDamping = {50, 50, 50, 50, 30, 25, 15};          // N m s/rad

int main(int argc, char** argv) {
  try {
    if (argc < 3 || argc > 4) throw std::runtime_error("usage: dither_hold IP final.yaml [SECONDS]");
    const double seconds = argc == 4 ? stiction::detail::number(argv[3], "SECONDS") : 5.0;
    if (!(seconds > 2 * kSoft && seconds <= kMostSeconds)) {
      throw std::runtime_error("SECONDS: expected more than 2 and at most 60");
    }
    std::ifstream file(argv[2]);
    if (!file) throw std::runtime_error(std::string(argv[2]) + ": cannot be read");
    const std::string name = argv[2];
    const bool yaml = name.size() > 5 && name.substr(name.size() - 5) == ".yaml";
    auto treatment = stiction::read_treatment<7>(file, yaml);
    const auto& dither = treatment.dither;
    auto& compensation = treatment.compensation;
    for (std::size_t j = 0; j < 7; ++j) {
      const auto& d = dither.joints[j];
      std::cout << "joint " << j + 1 << ": " << kShare * d.amplitude_nm << " N m at "
                << d.frequency_hz << " Hz, offset " << kShare * d.offset_nm << " N m, compensated "
                << kShare * compensation.joints[j].gain << " N m\n";
      if (dither.most(j) + compensation.joints[j].gain > kMostTorque[j]) {
        throw std::runtime_error("joint " + std::to_string(j + 1) + ": more than " +
                                 std::to_string(kMostTorque[j]) + " N m: lower it or kMostTorque");
      }
      if (d.frequency_hz >= 500.0) throw std::runtime_error("expected less than 500 Hz");
    }

    franka::Robot robot(argv[1]);
    franka::Model model = robot.loadModel();
    // Stops on contact, assumed: raise them if the arm stops with nothing near.
    const Joints torques = {20, 20, 20, 20, 10, 10, 10};
    const std::array<double, 6> forces = {20, 20, 20, 20, 20, 20};
    robot.setCollisionBehavior(torques, torques, forces, forces);

    std::cout << "The arm will shake for " << seconds << " s. Stop button in hand? Press Enter.\n";
    if (std::cin.get() != '\n') throw std::runtime_error("not confirmed: nothing moved");

    double time = 0.0;
    Joints start{};
    Joints before{};
    bool started = false;
    const auto callback = [&](const franka::RobotState& state,
                              franka::Duration period) -> franka::Torques {
      time += period.toSec();  // 0 at first; more than 1 ms after a lost packet
      if (!started) start = state.q;
      started = true;
      const double fade = kShare * stiction::soft(time / kSoft) *
                          stiction::soft((seconds - time) / kSoft);
      Joints wanted{};
      const Joints gravity = model.gravity(state), coriolis = model.coriolis(state);
      const std::array<double, 49> mass = model.mass(state);  // column by column
      const double cycle = period.toSec() > 0.0 ? period.toSec() : 1e-3;
      for (std::size_t j = 0; j < 7; ++j) {
        const double off = start[j] - state.q[j];
        // An exception ends the control loop; libfranka tells the robot to stop.
        if (!(std::abs(off) <= kMostDrift)) throw std::runtime_error("the arm drifts: stopped");
        if (!(std::abs(state.dq[j]) <= kMostSpeed)) throw std::runtime_error("too fast: stopped");
        // The arm is to stand still: no speed is wanted. Observers run from the first cycle on.
        stiction::Seen seen;
        seen.speed = state.dq[j];
        seen.error = off;
        seen.gravity = gravity[j];
        seen.torque = state.tau_J_d[j] - coriolis[j];
        for (std::size_t m = 0; m < 7; ++m) {
          seen.pushed += mass[7 * m + j] * (state.dq[m] - before[m]);
        }
        const double added = compensation.torque(j, seen, cycle) +
                             dither.torque(j, time, state.dq[j]);
        if (!std::isfinite(added)) throw std::runtime_error("not a number: stopped");
        // Gravity is not in here: the robot adds it.
        wanted[j] = kStiffness[j] * off - kDamping[j] * state.dq[j] +
                    fade * std::clamp(added, -kMostTorque[j], kMostTorque[j]);
      }
      before = state.dq;
      franka::Torques command(stiction::limit_rate(wanted, state.tau_J_d, kMostRate));
      return time >= seconds ? franka::MotionFinished(command) : command;
    };
    // libfranka's rate limiter as a second guard, and libfranka's low-pass of 100 Hz, through which
    // stiction-envs simulates its Panda; without it the upper frequencies shake harder than tuned.
    robot.control(callback, true, 100.0);
    std::cout << "done\n";
    return 0;
  } catch (const franka::Exception& error) {
    std::cerr << "robot: " << error.what() << "\n";
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
  }
  return 1;
}
