// Dither of an amplitude table of stiction-envs (final.csv) for a 1 kHz torque loop. C++17, no
// dependencies; tests hold it against the Python waveforms to 1e-12.
//
//   torque = A * w(2*pi*f*t) * exp(-(dq/gate)^2) + offset       [N m], gate 0: never gated
//
// Nothing here allocates or throws after the table has been read.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <istream>
#include <locale>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace stiction {

constexpr double kTwoPi = 6.283185307179586;

enum class Waveform { sine, square, triangle, chirp };  // "random" needs Python's generator: refused

// w(angle): mean 0, |w| <= 1. The same arithmetic as stiction_envs/dither/waveforms.py.
inline double shape(Waveform waveform, double angle) {
  double x = angle * (1.0 / kTwoPi);  // in periods
  switch (waveform) {
    case Waveform::sine:
      return std::sin(angle);
    case Waveform::square:
      x += 1e-6;  // edges that fall on a sample must not flip with its last bits
      return x - std::floor(x) < 0.5 ? 1.0 : -1.0;
    case Waveform::triangle:
      x += 0.25;
      return 1.0 - 4.0 * std::abs(x - std::floor(x) - 0.5);
    case Waveform::chirp:  // 0.75 f to 1.25 f and back in 64 periods
      x -= 64.0 * std::nearbyint(x / 64.0);
      return std::sin(x * (0.75 + 0.5 / 64.0 * std::abs(x)) * kTwoPi);
  }
  return 0.0;
}

struct JointDither {
  double frequency_hz = 0.0;
  double amplitude_nm = 0.0;
  double offset_nm = 0.0;  // constant, not gated
  double gate_rad_s = 0.0;
  Waveform waveform = Waveform::sine;
};

template <std::size_t N>
struct Dither {
  std::array<JointDither, N> joints{};

  // Torque of joint j (from 0) at time t [s] and joint speed dq [rad/s].
  double torque(std::size_t j, double t, double dq) const {
    const JointDither& d = joints[j];
    double tau = 0.0;
    if (d.amplitude_nm > 0.0) tau = d.amplitude_nm * shape(d.waveform, kTwoPi * d.frequency_hz * t);
    if (d.gate_rad_s > 0.0) {
      const double g = dq * (1.0 / d.gate_rad_s);
      tau *= std::exp(-(g * g));
    }
    return tau + d.offset_nm;
  }

  // Largest |torque| of joint j [N m].
  double most(std::size_t j) const {
    return joints[j].amplitude_nm + std::abs(joints[j].offset_nm);
  }
};

// 0 to 1, without a jump in slope, while x goes from 0 to 1.
inline double soft(double x) {
  return 0.5 - 0.5 * std::cos(0.5 * kTwoPi * std::clamp(x, 0.0, 1.0));
}

// What franka::limitRate does: no joint's torque changes by more than `rate` * 1 ms.
template <std::size_t N>
std::array<double, N> limit_rate(const std::array<double, N>& wanted,
                                 const std::array<double, N>& last, double rate = 1000.0) {
  std::array<double, N> out{};
  for (std::size_t j = 0; j < N; ++j) {
    out[j] = last[j] + std::clamp(wanted[j] - last[j], -rate * 1e-3, rate * 1e-3);
  }
  return out;
}

namespace detail {

inline std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> out(1);
  for (char c : line) {
    if (c == ',') {
      out.emplace_back();
    } else if (c != ' ' && c != '\t' && c != '\r') {
      out.back() += c;
    }
  }
  return out;
}

inline double number(const std::string& cell, const std::string& where) {
  std::istringstream text(cell);
  text.imbue(std::locale::classic());  // a decimal point wherever this runs
  double value = 0.0;
  if (!(text >> value) || !text.eof() || !std::isfinite(value)) {
    throw std::runtime_error(where + " is '" + cell + "': expected a finite number");
  }
  return value;
}

inline Waveform waveform(const std::string& name, const std::string& where) {
  static const std::map<std::string, Waveform> known = {{"sine", Waveform::sine},
                                                        {"square", Waveform::square},
                                                        {"triangle", Waveform::triangle},
                                                        {"chirp", Waveform::chirp}};
  const auto found = known.find(name);
  if (found == known.end()) {
    throw std::runtime_error(where + " is '" + name + "': expected sine, square, triangle or chirp");
  }
  return found->second;
}

}  // namespace detail

// Read a table: joint,frequency_hz,amplitude_nm with optional waveform,offset_nm,gate_rad_s.
// Throws std::runtime_error with one line for whatever is wrong, so that nothing moves.
template <std::size_t N>
Dither<N> read_table(std::istream& file) {
  Dither<N> out;
  std::array<bool, N> seen{};
  std::vector<std::string> header;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::vector<std::string> cells = detail::cells(line);
    if (cells.size() == 1 && cells[0].empty()) continue;
    const std::string here = "line " + std::to_string(number);
    if (header.empty()) {
      header = cells;
      for (const char* name : {"joint", "frequency_hz", "amplitude_nm"}) {
        if (std::count(header.begin(), header.end(), name) != 1) {
          throw std::runtime_error(here + ": expected one column " + name);
        }
      }
      continue;
    }
    if (cells.size() != header.size()) {
      throw std::runtime_error(here + ": expected one value a column");
    }
    JointDither d;
    double joint = 0.0;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string where = here + ": " + header[i];
      const auto value = [&] { return detail::number(cells[i], where); };
      if (header[i] == "joint") {
        joint = value();
      } else if (header[i] == "frequency_hz") {
        d.frequency_hz = value();
      } else if (header[i] == "amplitude_nm") {
        d.amplitude_nm = value();
      } else if (header[i] == "offset_nm") {
        d.offset_nm = value();
      } else if (header[i] == "gate_rad_s") {
        d.gate_rad_s = cells[i].empty() ? 0.0 : value();
      } else if (header[i] == "waveform") {
        d.waveform = detail::waveform(cells[i], where);
      } else {
        throw std::runtime_error(where + ": unknown column");
      }
    }
    if (!(joint >= 1.0 && joint <= double(N)) || joint != std::floor(joint)) {
      throw std::runtime_error(here + ": joint: expected 1 to " + std::to_string(N));
    }
    if (d.amplitude_nm < 0.0 || d.gate_rad_s < 0.0 || d.frequency_hz < 0.0 ||
        (d.amplitude_nm > 0.0 && d.frequency_hz == 0.0)) {
      throw std::runtime_error(here + ": expected no negative number, and a frequency");
    }
    const std::size_t j = std::size_t(joint) - 1;
    if (seen[j]) throw std::runtime_error(here + ": joint occurs twice");
    seen[j] = true;
    out.joints[j] = d;
  }
  if (header.empty()) throw std::runtime_error("empty table: expected a header and rows");
  return out;
}

}  // namespace stiction
