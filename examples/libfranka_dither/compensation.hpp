// Friction compensation of stiction-envs (compensation.csv, final.yaml) for a 1 kHz torque loop, and
// a reader of final.yaml. C++17, no dependencies; tests hold it against the Python laws to 1e-12
// (stiction_envs/control/laws has their formulas and sources).
//
// Nothing here allocates or throws after the file has been read.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <istream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "dither.hpp"

namespace stiction {

// What a controller has of one joint in one cycle.
struct Seen {
  double wanted_speed = 0.0;  // of the reference [rad/s]
  double speed = 0.0;         // measured [rad/s]
  double error = 0.0;         // reference less angle [rad]
  double gravity = 0.0;       // torque of the robot's model [N m]
  double torque = 0.0;        // command of the last cycle, without gravity, less Coriolis torque [N m]
  double pushed = 0.0;        // M (dq - dq a cycle ago), all joints summed [N m s]
};

enum class Law { none, feedforward, push, lugre_observer, momentum_observer };

struct JointCompensation {
  double gain = 0.0;  // [N m]; 0: not compensated
  double speed = 1.0, error = 1.0, load = 0.0, viscous = 0.0, coulomb = 1.0, stiffness = 1.0;
  double damping = 0.0, injection = 0.0, rate = 1.0, share = 0.0;
  double state = 0.0;  // of the observers; 0 at the start

  double torque(Law law, const Seen& s, double period) {
    if (gain <= 0.0) return 0.0;
    const double per_speed = 1.0 / speed;
    switch (law) {
      case Law::none:
        return 0.0;
      case Law::feedforward:
        return gain * std::tanh(s.wanted_speed * per_speed);
      case Law::push: {
        const double fade = s.speed * per_speed;
        const double sign = std::tanh(s.error * (1.0 / error)) * std::exp(-fade * fade);
        return (gain + load * std::abs(s.gravity)) * sign;
      }
      case Law::lugre_observer: {
        const double v = s.speed, ratio = v * per_speed, z = state;
        const double level = coulomb + (gain - coulomb) * std::exp(-ratio * ratio);
        const double decay = std::abs(v) * stiffness / level, correction = injection * s.error;
        const double change = v - decay * z + correction, most = gain / stiffness;
        const double a = std::max(decay * period, 1e-15), e = std::expm1(-a);
        const double after = z + (e * z - e / a * period * v) + correction * period;
        state = std::clamp(after, -most, most);
        return stiffness * z + damping * change + viscous * v;
      }
      case Law::momentum_observer:
        state -= std::expm1(-rate * period) * (s.pushed / period - s.torque - state);
        return -share * std::clamp(state, -gain, gain);
    }
    return 0.0;
  }
};

template <std::size_t N>
struct Compensation {
  Law law = Law::none;
  std::array<JointCompensation, N> joints{};

  double torque(std::size_t j, const Seen& seen, double period) {
    return joints[j].torque(law, seen, period);
  }
};

namespace detail {

struct Column {
  const char* name;
  double JointCompensation::* number;
  bool positive;
};

inline std::vector<Column> columns(Law law) {
  using J = JointCompensation;
  const Column speed = {"speed_rad_s", &J::speed, true};
  switch (law) {
    case Law::none:
      return {};
    case Law::feedforward:
      return {speed};
    case Law::push:
      return {speed, {"error_rad", &J::error, true}, {"load_gain", &J::load, false}};
    case Law::lugre_observer:
      return {speed, {"viscous_nms_rad", &J::viscous, false}, {"coulomb_nm", &J::coulomb, true},
              {"stiffness_nm_rad", &J::stiffness, true}, {"damping_nms_rad", &J::damping, false},
              {"injection_1_s", &J::injection, false}};
    case Law::momentum_observer:
      return {{"rate_1_s", &J::rate, true}, {"share", &J::share, false}};
  }
  return {};
}

inline Law law(const std::string& name, const std::string& where) {
  static const std::map<std::string, Law> known = {
      {"feedforward", Law::feedforward},       {"push", Law::push},
      {"lugre_observer", Law::lugre_observer}, {"momentum_observer", Law::momentum_observer}};
  const auto found = known.find(name);
  if (found == known.end()) throw std::runtime_error(where + ": unknown kind '" + name + "'");
  return found->second;
}

// A group of a file of final.yaml's layout as a table: a line a joint, what is said once in each.
inline std::string group_as_table(std::istream& file, const std::string& group) {
  std::vector<std::pair<std::size_t, std::string>> path;  // indentation and key of open maps
  std::vector<std::string> joints, header;
  std::map<std::string, std::map<std::string, std::string>> cells;
  std::vector<std::pair<std::string, std::string>> shared;
  const auto bare = [](std::string text) {
    const auto first = text.find_first_not_of(" '\""), last = text.find_last_not_of(" '\"\r");
    return first == std::string::npos ? std::string() : text.substr(first, last - first + 1);
  };
  std::string line;
  while (std::getline(file, line)) {
    const auto start = line.find_first_not_of(' ');
    if (start == std::string::npos || line[start] == '#' || line[start] == '\r') continue;
    while (!path.empty() && path.back().first >= start + (line[start] == '-' ? 1 : 0)) {
      path.pop_back();
    }
    const bool inside = path.size() >= 3 && path[1].second == "ros__parameters" &&
                        path[2].second == group;
    if (line[start] == '-') {
      if (inside && path.size() == 4 && path[3].second == "joints") {
        joints.push_back(bare(line.substr(start + 1)));
      }
      continue;
    }
    const auto colon = line.find(':', start);
    if (colon == std::string::npos) throw std::runtime_error("no YAML of stiction-envs: " + line);
    const std::string key = bare(line.substr(start, colon - start));
    const std::string value = bare(line.substr(colon + 1));
    if (value.empty()) {
      path.emplace_back(start, key);
    } else if (inside && path.size() == 3) {
      shared.emplace_back(key, value);
    } else if (inside && path.size() == 4) {
      cells[path[3].second][key] = value;
      if (std::find(header.begin(), header.end(), key) == header.end()) header.push_back(key);
    }
  }
  if (joints.empty()) return "";
  std::string table;
  for (const auto& key : header) table += (table.empty() ? "" : ",") + key;
  for (const auto& one : shared) table += "," + one.first;
  for (const auto& joint : joints) {
    std::string row;
    for (const auto& key : header) row += (row.empty() ? "" : ",") + cells[joint][key];
    for (const auto& one : shared) row += "," + one.second;
    table += "\n" + row;
  }
  return table + "\n";
}

}  // namespace detail

// Read compensation.csv: joint,kind,gain_nm and all columns of the kind.
// Throws std::runtime_error with one line for whatever is wrong, so that nothing moves.
template <std::size_t N>
Compensation<N> read_gains(std::istream& file) {
  Compensation<N> out;
  std::array<bool, N> seen{};
  std::vector<std::string> header;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::vector<std::string> cells = detail::cells(line);
    if (cells.size() == 1 && cells[0].empty()) continue;
    const std::string here = "line " + std::to_string(number);
    if (header.empty()) {
      header = cells;
      continue;
    }
    if (cells.size() != header.size()) {
      throw std::runtime_error(here + ": expected one value a column");
    }
    std::map<std::string, std::string> row;
    for (std::size_t i = 0; i < cells.size(); ++i) row[header[i]] = cells[i];
    if (row.size() != header.size()) throw std::runtime_error("a column is there twice");
    const auto take = [&](const std::string& name) {
      const auto found = row.find(name);
      if (found == row.end()) throw std::runtime_error(here + ": expected a column " + name);
      const std::string text = found->second;
      row.erase(found);
      return text;
    };
    const Law law = detail::law(take("kind"), here);
    if (out.law != Law::none && out.law != law) {
      throw std::runtime_error(here + ": expected one kind");
    }
    out.law = law;
    const double joint = detail::number(take("joint"), here + ": joint");
    if (!(joint >= 1.0 && joint <= double(N)) || joint != std::floor(joint)) {
      throw std::runtime_error(here + ": joint: expected 1 to " + std::to_string(N));
    }
    JointCompensation c;
    c.gain = detail::number(take("gain_nm"), here + ": gain_nm");
    if (c.gain < 0.0) throw std::runtime_error(here + ": gain_nm: expected >= 0");
    for (const auto& column : detail::columns(law)) {
      const std::string where = here + ": " + column.name;
      const double value = detail::number(take(column.name), where);
      if (value < 0.0 || (column.positive && value == 0.0)) {
        throw std::runtime_error(where + ": expected " + (column.positive ? "> 0" : ">= 0"));
      }
      c.*column.number = value;
    }
    if (c.share > 1.0) throw std::runtime_error(here + ": share: expected <= 1");
    if (!row.empty()) throw std::runtime_error(here + ": " + row.begin()->first + ": unknown column");
    const std::size_t j = std::size_t(joint) - 1;
    if (seen[j]) throw std::runtime_error(here + ": joint occurs twice");
    seen[j] = true;
    out.joints[j] = c;
  }
  if (out.law == Law::none) throw std::runtime_error("empty table: expected a header and rows");
  return out;
}

template <std::size_t N>
struct Treatment {
  Dither<N> dither;
  Compensation<N> compensation;
};

// Read final.yaml, dither, compensation or both; a final.csv, one of them, where ``yaml`` is false.
template <std::size_t N>
Treatment<N> read_treatment(std::istream& file, bool yaml) {
  Treatment<N> out;
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  if (!yaml) {
    std::istringstream table(text);
    if (text.substr(0, text.find('\n')).find("gain_nm") != std::string::npos) {
      out.compensation = read_gains<N>(table);
    } else {
      out.dither = read_table<N>(table);
    }
    return out;
  }
  bool any = false;
  for (const char* group : {"dither", "compensation"}) {
    std::istringstream whole(text);
    const std::string found = detail::group_as_table(whole, group);
    if (found.empty()) continue;
    any = true;
    std::istringstream table(found);
    if (group == std::string("dither")) {
      out.dither = read_table<N>(table);
    } else {
      out.compensation = read_gains<N>(table);
    }
  }
  if (!any) throw std::runtime_error("neither dither nor compensation: expected a final.yaml");
  return out;
}

}  // namespace stiction
