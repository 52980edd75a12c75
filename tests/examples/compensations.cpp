// Reads a final.yaml (its file is the argument) and, from standard input, one row a cycle of what
// each joint sees, six numbers times seven; prints the seven torques of each.
#include <cstdio>
#include <fstream>
#include <iostream>

#include "compensation.hpp"

int main(int, char** argv) {
  try {
    std::ifstream file(argv[1]);
    const std::string name = argv[1];
    auto compensation =
        name.back() == 'l' ? stiction::read_treatment<7>(file, true).compensation
                           : stiction::read_gains<7>(file);
    for (;;) {
      for (std::size_t j = 0; j < 7; ++j) {
        stiction::Seen s;
        if (!(std::cin >> s.wanted_speed >> s.speed >> s.error >> s.gravity >> s.torque >>
              s.pushed)) {
          return 0;
        }
        std::printf("%.17g ", compensation.torque(j, s, 1e-3));
      }
      std::printf("\n");
    }
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
